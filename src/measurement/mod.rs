//! What a measurement is: one sample of a load, its quality, and the series and batches made of
//! samples. Per unit on the load's base, load convention (consumption positive), positive
//! sequence, UTC nanoseconds.

pub mod batch;
pub mod concentrator;
pub mod phasor;
pub mod progress;
pub mod quality;
pub mod record;
pub mod sample;
pub mod site;

pub use batch::SampleBatch;
pub use concentrator::{BatchRefusal, Concentrator, ConcentratorOptions, PushReport, Restart, Run};
pub use progress::Progress;
pub use quality::Quality;
pub use record::Record;
pub use sample::{Channel, Sample};
pub use site::Site;
