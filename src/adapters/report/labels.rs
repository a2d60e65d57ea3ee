//! Where labels go, so that they cover neither each other nor what they name.

/// Height of a label, pixels: its font and the space between lines.
const HEIGHT_PX: f64 = 16.0;
/// Mean width of a character of the font over its size of 13 pixels; on the wide side.
const CHARACTER_PX: f64 = 7.4;
/// Space left around a mark.
const MARK_PX: f64 = 6.0;
/// Distance between the rings of places that are tried around a mark, pixels.
const RING_PX: f64 = 11.0;
/// Distance between the points by which a curve is known, pixels.
const CURVE_STEP_PX: f64 = 3.0;
/// Rings that are tried.
const RINGS: usize = 24;
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

    /// Its point nearest to another point.
    fn nearest_to(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (
            x.clamp(self.left, self.right),
            y.clamp(self.top, self.bottom),
        )
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

/// What labels should not cover, in pixels.
#[derive(Clone, Debug, Default)]
pub(super) struct Obstacles {
    /// Other marks.
    pub(super) marks: Vec<(f64, f64)>,
    /// Curves, as points joined by straight lines.
    pub(super) curves: Vec<Vec<(f64, f64)>>,
}

/// Places every label beside its mark, in the order given: where it covers least and is not far,
/// other labels and marks weighing most, being cut off at the panel's rim more than all.
pub(super) fn place(
    labels: &[((f64, f64), &str)],
    obstacles: &Obstacles,
    panel: (f64, f64),
) -> Vec<Placed> {
    let marks = labels.iter().map(|(at, _)| at).chain(&obstacles.marks);
    let mut solid: Vec<Rectangle> = marks
        .filter(|at| at.0.is_finite() && at.1.is_finite())
        .map(|&at| Rectangle::around(at, MARK_PX - 1.0))
        .collect();
    let thin: Vec<Rectangle> = (obstacles.curves.iter())
        .flat_map(|curve| along(curve))
        .filter(|at| at.0.is_finite() && at.1.is_finite())
        .map(|at| Rectangle::around(at, CURVE_STEP_PX / 2.0))
        .collect();
    let mut placed = Vec::with_capacity(labels.len());
    for &(mark, text) in labels {
        let (ring, label) = best_place(mark, text, (&solid, &thin), panel);
        solid.push(label);
        placed.push(Placed {
            at: (label.left, f64::midpoint(label.top, label.bottom)),
            leader: (ring > 0).then(|| [mark, label.nearest_to(mark)]),
        });
    }
    placed
}

/// Points every few pixels along a curve.
fn along(curve: &[(f64, f64)]) -> impl Iterator<Item = (f64, f64)> {
    curve.windows(2).flat_map(|ends| {
        let (from, to) = (ends[0], ends[1]);
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let steps = (dx.hypot(dy) / CURVE_STEP_PX).clamp(1.0, 1000.0).ceil();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to 1..=1000, of a curve that leads nowhere 1"
        )]
        let count = steps as usize;
        (0..=count).map(move |k| {
            let share = k as f64 / steps;
            (from.0 + share * dx, from.1 + share * dy)
        })
    })
}

fn best_place(
    mark: (f64, f64),
    text: &str,
    (solid, thin): (&[Rectangle], &[Rectangle]),
    panel: (f64, f64),
) -> (usize, Rectangle) {
    let mut best = (f64::INFINITY, 0, Rectangle::around(mark, 0.0));
    for ring in 0..RINGS {
        for (preference, direction) in DIRECTIONS.into_iter().enumerate() {
            let further = ring as f64 * RING_PX;
            let label = at_distance(mark, direction, further, text);
            let covered = |others: &[Rectangle]| -> f64 {
                others.iter().map(|other| label.overlap(other)).sum()
            };
            let rim = if label.within(panel) { 0.0 } else { 1e6 };
            let cost = rim
                + 100.0 * covered(solid)
                + covered(thin)
                + further
                // Only between places that are as good.
                + 0.01 * preference as f64;
            if cost < best.0 {
                best = (cost, ring, label);
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
        let placed = place(labels, &Obstacles::default(), PANEL);
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
        let placed = place(&[((100.0, 100.0), "07")], &Obstacles::default(), PANEL);
        assert_eq!(placed[0].at, (106.0, 100.0));
        assert_eq!(placed[0].leader, None);
    }

    #[test]
    fn a_label_leaves_a_curve_that_runs_through_it() {
        let obstacles = Obstacles {
            curves: vec![vec![(100.0, 100.0), (300.0, 100.0)]],
            ..Obstacles::default()
        };
        let placed = place(&[((100.0, 100.0), "start")], &obstacles, PANEL);
        assert!((placed[0].at.1 - 100.0).abs() > HEIGHT_PX / 2.0 || placed[0].at.0 < 70.0);
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
            place(&labels, &Obstacles::default(), PANEL)
                .iter()
                .any(|p| p.leader.is_some())
        );
    }

    #[test]
    fn too_many_labels_are_placed_all_the_same() {
        let labels = vec![((300.0, 150.0), "a long name of an event"); 60];
        assert_eq!(place(&labels, &Obstacles::default(), PANEL).len(), 60);
        assert!(place(&[], &Obstacles::default(), PANEL).is_empty());
    }
}
