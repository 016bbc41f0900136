//! Files of a build in progress. They vanish with it; those of a killed one are found by the next build of the same file.

use crate::HlodError;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// A folder beside the output, locked while its build lives, removed when dropped.
#[derive(Debug)]
pub(super) struct Scratch {
    folder: PathBuf,
    lock_path: PathBuf,
    _lock: File,
}

impl Scratch {
    /// Makes the folder for an output. What a killed build left stays in it if `keep` says so of a file's name.
    pub(super) fn new(out: &Path, keep: impl Fn(&str) -> bool) -> Result<Self, HlodError> {
        let (folder, lock_path) = (beside(out, ".building"), beside(out, ".lock"));
        let open = || OpenOptions::new().create(true).write(true).truncate(false).open(&lock_path);
        let lock = loop {
            let lock = open().map_err(HlodError::io(&lock_path))?;
            match lock.try_lock() {
                // The one who held it may have removed the file in between.
                Ok(()) if lock_path.exists() => break lock,
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let source = io::Error::new(
                        io::ErrorKind::WouldBlock,
                        "is being built by another process or thread",
                    );
                    return Err(HlodError::io(out)(source));
                }
                Err(TryLockError::Error(source)) => return Err(HlodError::io(&lock_path)(source)),
            }
        };
        let scratch = Self { folder, lock_path, _lock: lock };
        std::fs::create_dir_all(&scratch.folder).map_err(HlodError::io(&scratch.folder))?;
        let entries = std::fs::read_dir(&scratch.folder).map_err(HlodError::io(&scratch.folder))?;
        for entry in entries {
            let path = entry.map_err(HlodError::io(&scratch.folder))?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if !keep(&name) {
                std::fs::remove_file(&path).map_err(HlodError::io(&path))?;
            }
        }
        Ok(scratch)
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// A new file for reading and writing.
    pub(super) fn create(&self, name: &str) -> Result<(File, PathBuf), HlodError> {
        let path = self.path(name);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(&path);
        Ok((file.map_err(HlodError::io(&path))?, path))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
        let _ = std::fs::remove_file(&self.lock_path);
    }
}

fn beside(out: &Path, suffix: &str) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(suffix);
    out.with_file_name(name)
}
