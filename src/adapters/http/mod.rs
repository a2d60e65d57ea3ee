//! Metrics, health and a read-only view of the store over HTTP.

mod api;
mod documents;
pub mod health;
mod index;
pub mod options;
pub mod server;

pub use documents::{DecisionDocument, EventDocument, SetDocument, SiteDocument};
pub use health::{Health, HealthReport};
pub use options::HttpOptions;
pub use server::{Context, bind, serve};
