//! Seeded scene generators and camera paths.
//!
//! World z points up. The same seed and options give the same bytes on every machine.

mod builder;
mod city;
mod house;
mod path;
mod tree;

pub use city::City;
pub use path::Path;
