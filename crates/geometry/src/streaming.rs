//! What stores that are drawn while they load have in common: reading in the background, a cache by last use, files.

mod file;
mod loader;
mod lru;

pub use file::{folder_of, read_exact_at, sync_folder};
pub use loader::Loader;
pub use lru::Lru;
