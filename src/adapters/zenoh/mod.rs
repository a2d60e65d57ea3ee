//! Measurements in and parameter sets out over zenoh.
//!
//! The only module that knows zenoh. Its traps are handled here: explicit endpoints and no
//! multicast unless asked for; congestion control `Block` for what we publish; no work in a
//! subscriber's callback; a limit of our own for closing.

pub mod frames;
pub mod intake;
pub mod keys;
pub mod link;
pub mod options;
pub mod question;
pub mod session;

pub use frames::FramePublisher;
pub use intake::{Drops, Entrance, Exits, Message, queues};
pub use keys::{Address, Keys, is_chunk};
pub use link::{Link, LinkPublisher};
pub use options::{Mode, ZenohOptions};
pub use question::Question;
pub use session::{Documents, ZenohError, ask, close, close_within, documents, open, put};
pub use zenoh::{Session, bytes::Encoding};
