//! What stores that are drawn while they load have in common: reading in the background, a cache by last use, files and how they are sealed.

mod file;
mod loader;
mod lru;
mod sealed;

pub use file::{folder_of, read_exact_at, replace_file, sync_folder};
pub use loader::Loader;
pub use lru::Lru;
pub use sealed::{Cursor, FOOTER, Sealed};
