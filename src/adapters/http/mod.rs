//! Metrics, health, a view of the store, and actions for whoever has the token, over HTTP;
//! `adapters::web` has the pages.

mod actions;
mod api;
pub mod client;
mod connections;
mod documents;
mod draining;
mod effects;
pub mod health;
pub mod options;
pub mod server;
pub(in crate::adapters) mod token;
pub mod work;

pub(in crate::adapters) use actions::refused;
pub use actions::{Actions, Change, Refusal};
pub use documents::{
    DecisionDocument, DiagnosisDocument, EventDocument, FitDocument, SetDocument, SiteDocument,
    StructureDocument,
};
pub use effects::{effect_document, effect_kind_name};
pub use health::{Health, HealthReport};
pub use options::{HttpOptions, TokenSource};
pub use server::{Context, bind, serve};
pub use token::{Token, TokenError};
pub use work::{Ongoing, Reporter, Stage, WorkBoard};
