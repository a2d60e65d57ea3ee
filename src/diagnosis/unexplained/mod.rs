//! What is left when no effect of the catalogue explains a residual: a sparse description of it by
//! physical terms, as a sentence and as an effect file that can be fitted.
//!
//! The residual (measured minus modelled) of all events together is written as a sum of a few terms
//! out of some hundred (`dictionary`), each a formula of the language of effect files with one
//! coefficient for P and one for Q (`pursuit`). How many terms are kept is decided on events left
//! out, with the whole selection repeated without them (`selection`). What the model could have
//! taken up by itself does not count: static terms and a share of its own response are free, for all
//! events together and, with the spread of the composition, for each (`rows`).
//!
//! Method: orthogonal least squares with groups (Chen, Billings and Luo, Int. J. Control 50(5),
//! 1989), stopped by the Bayesian information criterion and by cross-validation.

mod dictionary;
mod effect_file;
mod pursuit;
mod response;
mod rows;
mod selection;
mod signature;
mod term;

#[cfg(test)]
mod tests;

use super::outcome::{Unexplained, UnexplainedTerm};
use crate::identification::{evaluate::Curves, intake::PreparedEvent};

use self::{rows::Rows, selection::Description, term::Term};

/// Residual over noise (squares per row) below which nothing is left to describe, unless a term
/// proves itself. Chosen: models that are right reach 1.0 to 1.4 on generated sites.
const NOTHING_LEFT: f64 = 1.5;

/// Describes what a fitted model leaves of the measurement: `curves` are the model's, one per event.
///
/// `None` when what is left is noise: no term proves itself and the squares are those of noise.
/// Without an effect file when something is left that no term of the dictionary describes.
///
/// Events must be those the model was fitted to, or more of the same site; with a single event no
/// term can prove itself on another, and the sentence says so.
#[must_use]
pub fn describe(events: &[PreparedEvent], curves: &[Curves]) -> Option<Unexplained> {
    let usable: Vec<(&PreparedEvent, &Curves)> = (events.iter().zip(curves))
        .filter(|(event, curves)| sound(event, curves))
        .collect();
    if usable.is_empty() {
        return None;
    }
    let terms = dictionary::terms(&usable);
    let rows = Rows::new(&usable, &terms);
    let found = selection::select(&rows, &terms);
    if found.chosen.is_empty() && found.squares_per_row < NOTHING_LEFT {
        return None;
    }
    Some(Unexplained {
        signature: signature::sentence(&usable, &terms, &found),
        terms: listed(&terms, &found),
        effect_file: effect_file::text(&terms, &found),
        general_form: None,
    })
}

fn sound(event: &PreparedEvent, curves: &Curves) -> bool {
    let used = || (0..event.len()).filter(|&k| event.used[k]);
    curves.active.len() == event.len()
        && curves.reactive.len() == event.len()
        && used().count() > 0
        && used().all(|k| curves.active[k].is_finite() && curves.reactive[k].is_finite())
}

fn listed(terms: &[Term], found: &Description) -> Vec<UnexplainedTerm> {
    let mut list = Vec::new();
    for chosen in &found.chosen {
        for (channel, name) in ["P", "Q"].into_iter().enumerate() {
            if chosen.coefficients[channel] != 0.0 {
                list.push(UnexplainedTerm {
                    formula: terms[chosen.term].formula(),
                    channel: name,
                    coefficient: chosen.coefficients[channel],
                    share: chosen.shares[channel],
                });
            }
        }
    }
    list
}
