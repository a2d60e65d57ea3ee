//! Metrics, health and the API over HTTP; `adapters::web` has the pages.

mod access;
mod api;
mod documents;
pub mod health;
pub mod options;
pub mod server;

pub use access::WriteAccess;
pub use documents::{DecisionDocument, EventDocument, SetDocument, SiteDocument};
pub use health::{Health, HealthReport};
pub use options::HttpOptions;
pub use server::{Context, bind, serve};
