//! The report of an improvement: the staircase, before and after on events not fitted, and the last
//! diagnosis.

use maud::{Markup, html};

use super::{
    diagnosis, diagnosis_tables,
    figure::{Ink, ReportError},
    number::significant,
    page::{self, drawn, legend, tile},
    staircase::{staircase, step_in_words},
};
use crate::diagnosis::{Diagnosis, EventFailure, Improvement, ImprovementStep};

/// The report of an improvement as one HTML document. The same input gives the same bytes.
///
/// # Errors
///
/// [`ReportError::Drawing`] when a figure cannot be drawn.
pub fn render_improvement(
    improvement: &Improvement,
    software_version: &str,
) -> Result<String, ReportError> {
    let last = &improvement.last;
    let before: Option<&[EventFailure]> = match improvement.steps.as_slice() {
        [first, _, ..] => Some(&first.failures),
        // Nothing came before a single step.
        _ => None,
    };
    let body = html! {
        (head(improvement))
        (steps(improvement)?)
        (diagnosis::where_it_fails(last, before)?)
        (diagnosis::in_the_structure(last))
        (diagnosis::candidates(last, "What is still missing"))
        (diagnosis::unexplained(last))
        (diagnosis::untestable(last))
        (rounds(improvement))
        (diagnosis::events(last, before)?)
    };
    let title = format!("Improvement of {}", improvement.site);
    Ok(page::page(&title, &body, software_version))
}

fn head(improvement: &Improvement) -> Markup {
    let last = &improvement.last;
    html! {
        header {
            p.kicker { "Improvement" }
            h1 { (improvement.site) }
            p { "Structure: " strong { (last.structure.join(" + ")) } ". " (diagnosis::sets(last)) }
            (diagnosis::verdict(last))
            @if let (Some(first), Some(end)) = (improvement.steps.first(), improvement.steps.last()) {
                dl.tiles {
                    @for (name, of) in QUOTED {
                        (tile(name, &html! {
                            (significant(of(first), 3)) " → " (significant(of(end), 3))
                        }))
                    }
                    (tile("Noise floor of a perfect model", &html! { (significant(last.noise_floor, 3)) }))
                    (tile("Parameters", &html! { (first.parameter_count) " → " (end.parameter_count) }))
                }
                p.bases { "Errors of the events " (quoted(last)) "." }
            }
            (diagnosis::left_out(last))
        }
    }
}

type OfStep = fn(&ImprovementStep) -> f64;
const QUOTED: [(&str, OfStep); 3] = [
    ("Residual over noise", |step| {
        step.errors.quoted().error_to_noise
    }),
    ("ε of P, %", |step| step.errors.quoted().eps_p_percent),
    ("ε of Q, %", |step| step.errors.quoted().eps_q_percent),
];

/// Which events the quoted errors come from.
fn quoted(last: &Diagnosis) -> &'static str {
    if !last.events.untouched.is_empty() {
        "that neither the fit nor the gate has seen"
    } else if !last.events.gate.is_empty() {
        "held out of the fit"
    } else {
        "fitted"
    }
}

fn steps(improvement: &Improvement) -> Result<Markup, ReportError> {
    let figure = staircase(improvement);
    Ok(html! {
        section {
            h2 { "Staircase" }
            figure {
                figcaption {
                    p { "Structure after structure. An added effect is right when the error falls on events that \
                         the fit has not seen, and the model is complete when it reaches the noise floor."
                        @if !improvement.last.events.gate.is_empty() {
                            " Fitted and gate: of fits without the gate's events."
                        } }
                    ul.legend {
                        (legend("dot", Ink::Measured, "fitted"))
                        (legend("ring", Ink::Rival, "gate"))
                        (legend("triangle", Ink::Model, "untouched"))
                        (legend("line", Ink::Onset, "noise floor"))
                    }
                }
                (drawn(&figure)?)
            }
            (diagnosis_tables::steps(improvement))
        }
    })
}

/// The rivals of every round but the last.
fn rounds(improvement: &Improvement) -> Markup {
    html! { @if !improvement.diagnoses.is_empty() {
        section {
            h2 { "How it came to this" }
            @for (round, index, step) in rounds_with_steps(improvement) {
                details {
                    summary { "Step " (index) ", " (step_in_words(step, index == 0)) ": " (round.summary) }
                    ul { @for reason in &round.reasons { li { (reason) } } }
                    @if !round.candidates.is_empty() { (diagnosis_tables::rivals(round)) }
                }
            }
        }
    } }
}

/// Every round but the last, with the step whose structure it judged and that step's number: a step that
/// exchanged one effect for another has no round unless it is the last.
fn rounds_with_steps(
    improvement: &Improvement,
) -> impl Iterator<Item = (&Diagnosis, usize, &ImprovementStep)> {
    let mut steps = improvement.steps.iter().enumerate();
    (improvement.diagnoses.iter()).filter_map(move |round| {
        let (index, step) = steps.find(|(_, step)| step.structure == round.structure)?;
        Some((round, index, step))
    })
}

#[cfg(test)]
mod tests {
    use super::{super::diagnosis_fixture as fixture, *};

    #[test]
    fn the_staircase_and_both_models_are_in_the_page() {
        let page = render_improvement(&fixture::improvement(), "0.1.0").unwrap();
        for words in [
            "id=\"staircase-title\"",
            "step 1, + electronic_load_dropout: 1.10",
            "model before",
            "6.20 → 1.10",
            "How it came to this",
        ] {
            assert!(page.contains(words), "{words}");
        }
        assert!(!page.contains("<script"));
        assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    }

    #[test]
    fn a_round_stands_with_the_structure_that_it_judged() {
        let mut improvement = fixture::improvement();
        // A step that exchanged an effect for another one, and a step after it.
        let mut exchanged = improvement.steps[1].clone();
        exchanged.structure = vec!["zip".to_owned(), "self_disconnection".to_owned()];
        let mut above = exchanged.clone();
        above.structure.push("time_skew".to_owned());
        improvement.steps.extend([exchanged.clone(), above]);
        let mut round = improvement.diagnoses[0].clone();
        round.structure = exchanged.structure;
        improvement.diagnoses.push(round);
        let places: Vec<usize> = rounds_with_steps(&improvement)
            .map(|(_, index, _)| index)
            .collect();
        assert_eq!(places, [0, 2]);
    }

    #[test]
    fn the_reason_of_two_steps_of_one_answer_is_given_once() {
        let mut improvement = fixture::improvement();
        let mut second = improvement.steps[1].clone();
        second.reason = "The model lacks a pair of effects.".to_owned();
        improvement.steps[1].reason.clone_from(&second.reason);
        improvement.steps.push(second);
        let page = render_improvement(&improvement, "0.1.0").unwrap();
        assert_eq!(page.matches("lacks a pair of effects").count(), 1);
        assert!(page.contains("As the step before"));
    }

    #[test]
    fn an_improvement_that_had_nothing_to_do_is_a_page() {
        let mut improvement = fixture::improvement();
        improvement.steps.truncate(1);
        improvement.diagnoses.clear();
        let page = render_improvement(&improvement, "0.1.0").unwrap();
        assert!(!page.contains("model before") && !page.contains("How it came"));
    }
}
