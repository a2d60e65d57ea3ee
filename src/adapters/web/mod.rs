//! The pages: sites, events, model against measurement, diagnosis, structure, solutions, parameter
//! sets, health.
//!
//! Made on the server and complete without scripts. Every page has a permanent address and a twin in
//! JSON and in CSV at the same address with `.json` or `.csv` behind it. The scripts add zoom,
//! read-out and live updates; they and the style sheet are compiled in, and no page names another
//! host. `docs/web.md` says more.

mod acting;
mod assets;
mod desk;
mod layout;
mod openapi;
mod pages;
mod plot;
mod problem;
mod routes;
mod session;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod updates;
mod uploads;
mod view;
mod words;

pub(super) use routes::{in_words, router};
