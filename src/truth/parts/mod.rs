//! Parts of a load.

mod air_conditioner;
mod blocks;
mod frequency;
mod frequency_relays;
mod generation;
mod machine;
mod motor;
mod recovery;
mod static_load;

pub(super) use air_conditioner::{AirConditioner, AirConditionerSettings};
pub(super) use blocks::{Blocks, BlocksSettings};
pub(super) use frequency_relays::{FrequencyRelaySettings, FrequencyRelays};
pub(super) use generation::{Behaviour, Generation, GenerationSettings};
pub(super) use machine::{Machine, MachineSettings, RotorBranch, Saturation};
pub(super) use motor::Motor;
pub use motor::{LoadBaseParameters, MotorCircuit};
pub(super) use recovery::{Recovery, RecoverySettings};
pub use static_load::Zip;
pub(super) use static_load::{FrequencyDependence, StaticLoad};
