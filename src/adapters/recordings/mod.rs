//! Recordings on disk: COMTRADE files of disturbance recorders and CSV site folders.
//!
//! [`comtrade`] decodes, [`grouping`] proposes which channels form three-phase sets, [`mapping`]
//! turns a recording into per-unit phasors with `measurement::phasor`; [`phasor_channels`] writes
//! and reads recordings that hold phasors already; [`site_folder`] reads and writes the CSV folders
//! of offline work.

pub mod comtrade;
pub mod grouping;
pub mod mapping;
pub mod phasor_channels;
pub mod site_folder;
