//! One file for each kind of effect: what may be chosen, what it takes and how far it is off.

pub mod cloud;
pub mod object;
pub mod occlusion;
pub mod shadow;
