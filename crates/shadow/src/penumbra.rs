//! Soft shadows: how wide penumbrae are, where they lie, how much light reaches a point in them, and how coarse a caster may be.
//!
//! | question | answer |
//! |---|---|
//! | how wide is the penumbra? | [`width`] |
//! | where can it be? | [`quads`] |
//! | how much of the light is seen? | [`coverage`] |
//! | how coarse may a caster be? | [`caster`] |

pub mod caster;
pub mod coverage;
pub mod quads;
pub mod width;
