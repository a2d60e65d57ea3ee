//! PMUs and concentrators over sockets: a client that receives C37.118 frames from one (TCP or UDP), and
//! a server that is one. What is said and when is [`super::c37118::Dialogue`]'s matter.

pub mod client;
mod counters;
pub mod server;

pub use client::{Delivery, Source, Transport};
pub use counters::{Counters, Totals};
pub use server::{Answers, Station};
