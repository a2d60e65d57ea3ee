//! The codec against the example frames printed in the standard, against itself in every format,
//! and against captures of real devices; see the submodules.

mod captures;
mod conversion;
mod dialogue;
mod fixture;
mod frames;
mod intake;
mod mutants;
mod playing;
mod streams;
mod tshark;
