//! What the commands that fit a site share: the options of a fit, and the fit.

use std::time::{Duration, Instant};

use super::{
    misuse::{self, Misuse},
    source::{Events, parts_of},
};
use crate::identification::{
    self, Identification, IdentificationError, IdentificationOptions, RobustLoss, Split,
    fit::{Formulation, SearchOptions},
    joint_problem::PAPER_SHARES,
};

/// Options of a fit.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct FitArgs {
    /// Parts of the model. Default: with --store those that the site is to have, with --config those
    /// configured, otherwise `zip+induction_motor`.
    #[arg(long, value_name = "A+B")]
    pub structure: Option<String>,
    /// Events to fit, by name; default: all that are not held out.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub train: Vec<String>,
    /// Events to hold out, by name; default: a third, or none with --train. By default one at the edge of a relay of the model,
    /// where the fitted events leave open whether it acts, changes places with a fitted one.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub hold_out: Vec<String>,
    /// Bounds the static shares of P to 0.1 to 0.9 and the motor share from 0.1, as the paper does.
    #[arg(long)]
    pub paper_box: bool,
    /// Lets samples with large residuals count less: `huber` or `cauchy`.
    #[arg(long, value_name = "LOSS")]
    pub robust: Option<RobustArg>,
    /// In which unknowns to search: three nonlinear coordinates, or the paper's nine parameters in
    /// its box (14) (with decades in logarithms, or all as they are).
    #[arg(long, value_enum, default_value_t = FormulationArg::Reduced)]
    pub formulation: FormulationArg,
}

/// Losses of a robust fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum RobustArg {
    /// Huber's: bounds the influence of an outlier
    Huber,
    /// Cauchy's: far outliers lose all influence
    Cauchy,
}

/// In which unknowns to search.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum FormulationArg {
    /// Three nonlinear coordinates.
    #[default]
    Reduced,
    /// The paper's nine parameters, decades in logarithms.
    Paper,
    /// The paper's nine parameters as they are.
    PaperLinear,
}

impl FitArgs {
    /// The settings of a site with what these options say otherwise.
    #[must_use]
    pub fn options(&self, of_site: &IdentificationOptions) -> IdentificationOptions {
        let mut options = of_site.clone();
        if self.paper_box {
            options.problem.static_shares = Some(PAPER_SHARES);
        }
        if let Some(loss) = self.robust {
            options.robust = Some(match loss {
                RobustArg::Huber => RobustLoss::HUBER,
                RobustArg::Cauchy => RobustLoss::CAUCHY,
            });
        }
        match self.formulation {
            FormulationArg::Reduced => {}
            FormulationArg::Paper => options.search = SearchOptions::of(Formulation::Paper),
            FormulationArg::PaperLinear => {
                options.search = SearchOptions::of(Formulation::PaperLinear);
            }
        }
        if !(self.train.is_empty() && self.hold_out.is_empty()) {
            options.split = Split::Named {
                fitted: self.train.clone(),
                held_out: self.hold_out.clone(),
            };
        }
        options
    }

    /// Refuses what cannot be, before anything is read.
    ///
    /// # Errors
    ///
    /// See [`Misuse`].
    pub fn check(&self) -> Result<(), Misuse> {
        misuse::no_event_twice(&self.train, &self.hold_out)?;
        match &self.structure {
            Some(asked) => misuse::no_impossible_change(&parts_of(asked), &[], &[]),
            None => Ok(()),
        }
    }
}

/// Fits the usable windows, with a spinner on a terminal; the cost carries the wall-clock time.
///
/// # Errors
///
/// See [`IdentificationError`].
#[allow(
    clippy::disallowed_methods,
    reason = "a command is where wall-clock time is measured"
)]
pub(super) fn identify(
    events: &Events,
    structure: &[String],
    options: &IdentificationOptions,
) -> Result<Identification, IdentificationError> {
    let spinner = indicatif::ProgressBar::new_spinner();
    spinner.set_message(format!("identifying from {} events", events.usable.len()));
    spinner.enable_steady_tick(Duration::from_millis(120));
    let begun = Instant::now();
    let found =
        identification::identify(&events.site, &events.usable, structure, options, &|| false);
    spinner.finish_and_clear();
    let mut found = found.map_err(|error| with_screened(error, &events.refused))?;
    found.cost.seconds = begun.elapsed().as_secs_f64();
    found.refused.extend(events.refused.iter().cloned());
    found.refused.sort();
    Ok(found)
}

fn with_screened(error: IdentificationError, screened: &[(String, String)]) -> IdentificationError {
    match error {
        IdentificationError::NoUsableEvent { mut refused } => {
            refused.extend(screened.iter().cloned());
            IdentificationError::NoUsableEvent { refused }
        }
        other => other,
    }
}
