//! Which effects a diagnosis looks for: those that a structure can take and that the events can show.

use super::{case::Case, longer_window::are_standard};
use crate::{
    identification::intake::LONGER_WINDOW,
    load_model::{
        Structure,
        effect::{Declaration, Kind, Needs},
        effects,
    },
};

/// A stream of 49.95 frames/s has 50.
pub(super) const RATE_TOLERANCE: f64 = 1.01;

/// Effects that may be added to a structure and that these events can show. What residuals near edges look like is no word
/// against what the voltages show of the window by themselves.
pub(super) fn addable(structure: &Structure, case: &Case<'_>) -> Vec<&'static str> {
    let (_, shown) = by_rate(structure, &case.options.excluded, case.rate_fps());
    let names = shown.into_iter().map(|declaration| declaration.name);
    names
        .filter(|name| *name != LONGER_WINDOW || !are_standard(&case.judged))
        .collect()
}

/// Instruments that may be added and that these events cannot show: what an instrument does at edges is not told from
/// where the edges are, unless there are samples enough to hold both.
pub(super) fn hidden_by_rate(structure: &Structure, case: &Case<'_>) -> Vec<&'static Declaration> {
    by_rate(structure, &case.options.excluded, case.rate_fps()).0
}

/// What may be added to a structure: instruments that need more frames per second than there are, and than a dip of
/// any kind does, and the rest.
fn by_rate(
    structure: &Structure,
    excluded: &[String],
    rate_fps: f64,
) -> (Vec<&'static Declaration>, Vec<&'static Declaration>) {
    let may = |d: &&Declaration| {
        !excluded.iter().any(|name| name == d.name) && structure.with(d.name).is_ok()
    };
    let all = effects::catalogue().iter().map(|e| e.declaration());
    let at_edges =
        |d: &Declaration| d.kind == Kind::Instrument && d.needs.rate_fps > Needs::A_DIP.rate_fps;
    all.filter(may)
        .partition(|d| at_edges(d) && d.needs.rate_fps > RATE_TOLERANCE * rate_fps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instruments_are_looked_for_where_there_are_samples_enough() {
        let unseen = |rate_fps: f64| -> Vec<&str> {
            let (unseen, shown) = by_rate(&Structure::zip_im(), &[], rate_fps);
            let motors = shown.iter().any(|d| d.name == "double_cage_rotor");
            assert!(motors, "effects of the load are looked for at any rate");
            unseen.iter().map(|d| d.name).collect()
        };
        assert!(unseen(60.0).is_empty() && unseen(49.95).is_empty());
        assert_eq!(unseen(30.0), ["phasor_window"]);
        assert_eq!(unseen(10.0), ["phasor_window"]);
        let excluded = ["phasor_window".to_owned()];
        let (unseen, shown) = by_rate(&Structure::zip_im(), &excluded, 30.0);
        assert!(unseen.is_empty() && shown.iter().all(|d| d.name != "phasor_window"));
    }
}
