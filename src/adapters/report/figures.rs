//! The figures of a diagnosis or an improvement as files of their own, for texts about a site.

use super::{
    diagnosis_tables::role,
    failure_figures,
    figure::{Figure, ReportError},
    staircase::staircase,
};
use crate::diagnosis::{Diagnosis, EventFailure, Improvement, misfit_root_floor};

/// A figure and the name of its file, without extension.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedFigure {
    /// Letters, digits, `-`, `_` and `.` only.
    pub name: String,
    /// The file.
    pub svg: String,
}

/// Severity ladder, residual against voltage, and every event as a whole and close up.
///
/// # Errors
///
/// [`ReportError::Drawing`] when a figure cannot be drawn.
pub fn diagnosis_figures(diagnosis: &Diagnosis) -> Result<Vec<NamedFigure>, ReportError> {
    figures(diagnosis, None)
}

/// The staircase, and the figures of the last diagnosis with the model of the first step beside.
///
/// # Errors
///
/// [`ReportError::Drawing`] when a figure cannot be drawn.
pub fn improvement_figures(improvement: &Improvement) -> Result<Vec<NamedFigure>, ReportError> {
    let before = match improvement.steps.as_slice() {
        [first, _, ..] => Some(first.failures.as_slice()),
        // Nothing came before a single step.
        _ => None,
    };
    let mut all = vec![named("staircase", &staircase(improvement))?];
    all.extend(figures(&improvement.last, before)?);
    Ok(all)
}

fn figures(
    diagnosis: &Diagnosis,
    before: Option<&[EventFailure]>,
) -> Result<Vec<NamedFigure>, ReportError> {
    let failures = &diagnosis.failures;
    let untouched = |event: &str| role(&diagnosis.events, event) == "untouched";
    let ladder = failure_figures::ladder(failures, before, &untouched, misfit_root_floor());
    let together: Vec<&EventFailure> = failures.iter().collect();
    let scatter = failure_figures::against_voltage("against-voltage", &together);
    let mut all = vec![
        named("severity", &ladder)?,
        named("against-voltage", &scatter)?,
    ];
    for failure in failures {
        let same = |other: &&EventFailure| other.event == failure.event;
        let earlier = before.and_then(|before| before.iter().find(same));
        let of_event = failure_figures::event_figures(&failure.event, failure, earlier);
        for (figure, span) in of_event.iter().zip(["whole", "close"]) {
            all.push(named(&format!("{}-{span}", failure.event), figure)?);
        }
    }
    Ok(all)
}

fn named(name: &str, figure: &Figure) -> Result<NamedFigure, ReportError> {
    // Events are named by whoever sent them: no name leads out of the directory.
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    Ok(NamedFigure {
        name: name.replace(|c| !plain(c), "-"),
        svg: figure.document()?,
    })
}

#[cfg(test)]
mod tests {
    use super::{super::diagnosis_fixture as fixture, *};

    #[test]
    fn an_improvement_has_a_file_for_every_figure_of_its_page() {
        let mut improvement = fixture::improvement();
        let events = improvement.last.failures.len();
        improvement.last.failures[0].event = "../up/event 1".to_owned();
        let figures = improvement_figures(&improvement).unwrap();
        let names: Vec<&str> = figures.iter().map(|f| f.name.as_str()).collect();
        assert_eq!(names[..3], ["staircase", "severity", "against-voltage"]);
        assert!(names.contains(&"..-up-event-1-whole"), "{names:?}");
        assert!((3 + events..=3 + 2 * events).contains(&names.len()));
        assert!(figures.iter().all(|f| f.svg.starts_with("<svg xmlns=")));
        let alone = diagnosis_figures(&fixture::diagnosis()).unwrap();
        assert_eq!(alone[0].name, "severity");
    }
}
