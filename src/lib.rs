//! Real-time-rendering algorithms for very large scenes, as crates that an engine can take one at a time.
//!
//! This facade re-exports them, each behind the feature of its name. An engine that needs one algorithm
//! depends on that crate directly and never sees the others.

pub use farsight_geometry as geometry;
#[cfg(feature = "hlod")]
pub use farsight_hlod as hlod;
#[cfg(feature = "lod")]
pub use farsight_lod as lod;
#[cfg(feature = "occlusion")]
pub use farsight_occlusion as occlusion;
#[cfg(feature = "plan")]
pub use farsight_plan as plan;
#[cfg(feature = "points")]
pub use farsight_points as points;
#[cfg(feature = "shadow")]
pub use farsight_shadow as shadow;
#[cfg(feature = "timing")]
pub use farsight_timing as timing;
#[cfg(feature = "visibility")]
pub use farsight_visibility as visibility;
