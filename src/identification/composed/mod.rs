//! Joint fits of composed models: ZIP, motor and any effects of the catalogue.
//!
//! The plain model has a faster problem of its own (`joint_problem`), from whose solution these
//! fits start. Here every parameter is an unknown of a Levenberg-Marquardt method with exact
//! sensitivities; what varies from event to event is marginalised as there.

mod band;
mod base;
mod baseline;
mod candidates;
mod coordinates;
mod counts;
mod covariance;
mod distance;
mod extend;
mod fit;
mod frequency_levels;
mod from_mild;
mod model;
mod narrowed;
mod no_value;
mod operating_point;
mod problem;
mod quoted;
mod refine;
mod relay_walk;
mod rows;
mod screening;
mod sources;
mod spread;
mod threshold;
mod waiting;

#[cfg(test)]
pub(in crate::identification) mod tests;

pub use baseline::{Baseline, baseline, has_no_motor, in_order_of};
pub use coordinates::Coordinates;
pub use counts::dips;
pub use distance::{Foretold, Open, answer};
pub use extend::{Ground, Screened};
pub use fit::{
    ComposedFit, ComposedFitOptions, RISE_OF_LEFT, composition_deviations, fit, follows_as_well,
    squares, with_own_composition,
};
pub use model::ComposedLoad;
pub use narrowed::{left_of_alike, narrowed, sufficient_scatter};
pub use no_value::without_value;
pub use refine::refine;
pub use relay_walk::{
    RelaySetting, SettingOf, is_bracketed, with_frequency_levels_of, with_levels_of,
};
pub use rows::Scatter;
pub use screening::Score;
pub use spread::narrower_than;
