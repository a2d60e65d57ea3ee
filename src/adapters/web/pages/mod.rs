//! The pages, one file each.

pub(super) mod compare;
pub(super) mod diagnosis;
mod diagnosis_charts;
mod diagnosis_trial;
mod diagnosis_view;
pub(super) mod event;
mod event_charts;
mod event_view;
pub(super) mod events;
mod failure_charts;
pub(super) mod health;
mod models;
mod overlay;
pub(super) mod recordings;
mod set_difference;
mod set_view;
pub(super) mod sets;
pub(super) mod sites;
pub(super) mod solutions;
pub(super) mod streams;
pub(super) mod structure;
mod structure_view;
