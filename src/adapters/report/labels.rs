//! Where labels go, so that they cover neither each other nor what they name.

/// Height of a label, pixels: its font and the space between lines.
const HEIGHT_PX: f64 = 16.0;
/// Mean width of a character of the font over its size of 13 pixels; on the wide side.
const CHARACTER_PX: f64 = 7.4;
/// Space left around a mark.
const MARK_PX: f64 = 6.0;
/// Distance between the rings of places that are tried around a mark, pixels.
const RING_PX: f64 = 11.0;
/// Rings that are tried.
const RINGS: usize = 14;
/// Directions of a ring, best first: right, left, above, below, then between.
const DIRECTIONS: [(f64, f64); 12] = [
    (1.0, 0.0),
    (-1.0, 0.0),
    (0.0, -1.0),
    (0.0, 1.0),
    (0.7, -0.7),
    (0.7, 0.7),
    (-0.7, -0.7),
    (-0.7, 0.7),
    (0.92, -0.38),
    (0.92, 0.38),
    (-0.92, -0.38),
    (-0.92, 0.38),
];

/// A rectangle in pixels; `y` grows downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rectangle {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

/// A label in its place, pixels.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Placed {
    /// Left end of the text and its middle line.
    pub(super) at: (f64, f64),
    /// A line from the mark to the label, where the label had to go further away.
    pub(super) leader: Option<[(f64, f64); 2]>,
}

impl Rectangle {
    fn around((x, y): (f64, f64), half: f64) -> Self {
        Self {
            left: x - half,
            top: y - half,
            right: x + half,
            bottom: y + half,
        }
    }

    /// How much of two rectangles is common, square pixels.
    fn overlap(&self, other: &Self) -> f64 {
        let width = self.right.min(other.right) - self.left.max(other.left);
        let height = self.bottom.min(other.bottom) - self.top.max(other.top);
        width.max(0.0) * height.max(0.0)
    }

    /// Whether it lies within a panel of this size.
    fn within(&self, (width, height): (f64, f64)) -> bool {
        self.left >= 0.0 && self.top >= 0.0 && self.right <= width && self.bottom <= height
    }
}

/// Places every label beside its mark, in the order given: at the nearest place inside the panel
/// where it covers nothing, or where it covers least. `marks` are other points not to be covered.
pub(super) fn place(
    labels: &[((f64, f64), &str)],
    marks: &[(f64, f64)],
    panel: (f64, f64),
) -> Vec<Placed> {
    let mut taken: Vec<Rectangle> = labels
        .iter()
        .map(|(at, _)| at)
        .chain(marks)
        .map(|&at| Rectangle::around(at, MARK_PX - 1.0))
        .collect();
    let mut placed = Vec::with_capacity(labels.len());
    for &(mark, text) in labels {
        let (ring, label) = nearest_free(mark, text, &taken, panel);
        taken.push(label);
        let middle = f64::midpoint(label.top, label.bottom);
        let end = if label.left > mark.0 {
            (label.left, middle)
        } else if label.right < mark.0 {
            (label.right, middle)
        } else if label.top > mark.1 {
            (mark.0, label.top)
        } else {
            (mark.0, label.bottom)
        };
        placed.push(Placed {
            at: (label.left, middle),
            leader: (ring > 0).then_some([mark, end]),
        });
    }
    placed
}

fn nearest_free(
    mark: (f64, f64),
    text: &str,
    taken: &[Rectangle],
    panel: (f64, f64),
) -> (usize, Rectangle) {
    let mut best = (f64::INFINITY, 0, Rectangle::around(mark, 0.0));
    for ring in 0..RINGS {
        for direction in DIRECTIONS {
            let label = at_distance(mark, direction, ring as f64 * RING_PX, text);
            let mut covered: f64 = taken.iter().map(|other| label.overlap(other)).sum();
            if !label.within(panel) {
                // Cut off is worse than covered.
                covered += 1e6;
            }
            if covered <= 0.0 {
                return (ring, label);
            }
            if covered < best.0 {
                best = (covered, ring, label);
            }
        }
    }
    (best.1, best.2)
}

/// The label's rectangle in `direction` of the mark, `further` pixels away than beside it.
fn at_distance(mark: (f64, f64), direction: (f64, f64), further: f64, text: &str) -> Rectangle {
    let width = CHARACTER_PX * text.chars().count() as f64;
    let reach = (
        MARK_PX + further + width / 2.0,
        MARK_PX + further + HEIGHT_PX / 2.0,
    );
    let centre = (
        mark.0 + direction.0 * reach.0,
        mark.1 + direction.1 * reach.1,
    );
    Rectangle {
        left: centre.0 - width / 2.0,
        right: centre.0 + width / 2.0,
        top: centre.1 - HEIGHT_PX / 2.0,
        bottom: centre.1 + HEIGHT_PX / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PANEL: (f64, f64) = (600.0, 300.0);

    fn boxes(labels: &[((f64, f64), &str)]) -> Vec<Rectangle> {
        let placed = place(labels, &[], PANEL);
        let rectangle = |(placed, (_, text)): (&Placed, &((f64, f64), &str))| Rectangle {
            left: placed.at.0,
            right: placed.at.0 + CHARACTER_PX * text.chars().count() as f64,
            top: placed.at.1 - HEIGHT_PX / 2.0,
            bottom: placed.at.1 + HEIGHT_PX / 2.0,
        };
        placed.iter().zip(labels).map(rectangle).collect()
    }

    #[test]
    fn a_lone_label_stands_right_of_its_mark() {
        let placed = place(&[((100.0, 100.0), "07")], &[], PANEL);
        assert_eq!(placed[0].at, (106.0, 100.0));
        assert_eq!(placed[0].leader, None);
    }

    #[test]
    fn crowded_labels_do_not_cover_each_other_and_stay_inside() {
        let labels: Vec<_> = (0..12)
            .map(|k| ((590.0, 20.0 + f64::from(k)), "event_07"))
            .collect();
        let boxes = boxes(&labels);
        for (k, a) in boxes.iter().enumerate() {
            assert!(a.within(PANEL), "{a:?}");
            for b in &boxes[..k] {
                assert!(a.overlap(b) < 1e-9, "{a:?} {b:?}");
            }
        }
        assert!(
            place(&labels, &[], PANEL)
                .iter()
                .any(|p| p.leader.is_some())
        );
    }

    #[test]
    fn too_many_labels_are_placed_all_the_same() {
        let labels = vec![((300.0, 150.0), "a long name of an event"); 400];
        assert_eq!(place(&labels, &[], PANEL).len(), 400);
        assert!(place(&[], &[], PANEL).is_empty());
    }
}
