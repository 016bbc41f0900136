//! Numbers from other Farsight crates, by feature.

#[cfg(feature = "shadow")]
mod shadow;
#[cfg(feature = "timing")]
mod timing;
