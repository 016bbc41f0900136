//! Files of a build in progress: they vanish with it, or with the next one.

use crate::PointsError;
use farsight_geometry::streaming::folder_of;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A folder beside the output, with a lock beside it that is held while its build lives. Both are removed when dropped.
#[derive(Debug)]
pub(super) struct Scratch {
    folder: PathBuf,
    lock_path: PathBuf,
    _lock: File,
}

/// Tells builds of one process apart.
static COUNTER: AtomicU64 = AtomicU64::new(0);

impl Scratch {
    /// Makes the folder for an output, and removes those that killed builds of the same output have left; the first one that
    /// `is_wanted` is taken over instead, which the answer says.
    pub fn new(out: &Path, is_wanted: impl Fn(&Path) -> bool) -> Result<(Self, bool), PointsError> {
        if let Some(adopted) = clear_abandoned(out, is_wanted)? {
            return Ok((adopted, true));
        }
        loop {
            let number = COUNTER.fetch_add(1, Ordering::Relaxed);
            let id = format!("{}-{number}", std::process::id());
            let lock_path = beside(out, &format!("{id}.lock"));
            let lock = match File::create_new(&lock_path) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                other => other.map_err(PointsError::io(&lock_path))?,
            };
            lock.lock().map_err(PointsError::io(&lock_path))?;
            // Between making and locking the file, someone may have taken it for abandoned.
            if lock_path.exists() {
                let folder = beside(out, &id);
                let scratch = Self { folder, lock_path, _lock: lock };
                std::fs::create_dir(&scratch.folder).map_err(PointsError::io(&scratch.folder))?;
                return Ok((scratch, false));
            }
        }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// A new file in the folder for reading and writing.
    pub fn create(&self, name: &str) -> Result<(File, PathBuf), PointsError> {
        let path = self.path(name);
        let file = OpenOptions::new().read(true).write(true).create_new(true).open(&path);
        Ok((file.map_err(PointsError::io(&path))?, path))
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
    name.push(format!(".tmp-{suffix}"));
    out.with_file_name(name)
}

/// Removes what builds of the same output have left whose lock no living process holds, but for one that is wanted.
fn clear_abandoned(out: &Path, is_wanted: impl Fn(&Path) -> bool) -> Result<Option<Scratch>, PointsError> {
    let mut adopted: Option<Scratch> = None;
    let prefix = beside(out, "");
    let prefix = prefix.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = folder_of(out);
    for entry in std::fs::read_dir(folder).map_err(PointsError::io(folder))? {
        let path = entry.map_err(PointsError::io(folder))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some(id) = name.strip_prefix(&prefix).map(|id| id.strip_suffix(".lock").unwrap_or(id)) else {
            continue;
        };
        if id.is_empty() || !id.bytes().all(|b| b.is_ascii_digit() || b == b'-') {
            continue;
        }
        // A build locks before it makes its folder, so that a folder without a lock is nobody's.
        let lock_path = beside(out, &format!("{id}.lock"));
        let lock = File::open(&lock_path).ok();
        if lock.as_ref().is_some_and(|lock| matches!(lock.try_lock(), Err(TryLockError::WouldBlock))) {
            continue;
        }
        let folder = beside(out, id);
        if adopted.as_ref().is_some_and(|a| a.folder == folder) {
            continue;
        }
        match lock {
            Some(lock) if adopted.is_none() && is_wanted(&folder) => {
                adopted = Some(Scratch { folder, lock_path, _lock: lock });
            }
            _ => {
                let _ = std::fs::remove_dir_all(folder);
                let _ = std::fs::remove_file(lock_path);
            }
        }
    }
    Ok(adopted)
}
