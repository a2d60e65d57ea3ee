//! Metrics, health and a read-only view of the store over HTTP.

pub mod options;

pub use options::HttpOptions;
