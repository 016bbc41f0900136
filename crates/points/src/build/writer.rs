//! The output file, written by a thread of its own in large aligned blocks past the page cache.

use crate::PointsError;
use std::fs::{File, OpenOptions};
use std::io::{self, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Bytes written at once.
const BLOCK: usize = 4 << 20;
/// What addresses, offsets and lengths of direct writes are multiples of.
const ALIGNMENT: usize = 4096;
/// Blocks in circulation: one being filled, one being written, one between.
const BLOCKS: usize = 3;

/// Memory that a writer takes.
pub(super) const WRITER_BYTES: usize = BLOCKS * (BLOCK + ALIGNMENT);

/// A block whose bytes start at a multiple of [`ALIGNMENT`].
struct Aligned {
    bytes: Vec<u8>,
    start: usize,
    len: usize,
}

impl Aligned {
    fn new() -> Self {
        let bytes = vec![0; BLOCK + ALIGNMENT];
        let start = bytes.as_ptr().align_offset(ALIGNMENT);
        Self { bytes, start, len: 0 }
    }

    /// Takes what fits of some bytes, and returns the rest.
    fn fill<'a>(&mut self, from: &'a [u8]) -> &'a [u8] {
        let (now, later) = from.split_at(from.len().min(BLOCK - self.len));
        let at = self.start + self.len;
        self.bytes[at..at + now.len()].copy_from_slice(now);
        self.len += now.len();
        later
    }

    fn padded(&mut self) -> &[u8] {
        let end = self.len.next_multiple_of(ALIGNMENT);
        self.bytes[self.start + self.len..self.start + end].fill(0);
        &self.bytes[self.start..self.start + end]
    }
}

/// A file under construction. Errors of the writing thread come back from the next call.
pub(super) struct Writer {
    path: PathBuf,
    current: Aligned,
    filled: Option<SyncSender<Aligned>>,
    empty: Receiver<Aligned>,
    thread: Option<JoinHandle<io::Result<File>>>,
    length: u64,
}

impl Writer {
    /// Creates the file.
    pub fn create(path: &Path) -> Result<Self, PointsError> {
        let file = create(path).map_err(PointsError::io(path))?;
        let (filled, to_write) = sync_channel::<Aligned>(BLOCKS);
        let (give_back, empty) = sync_channel(BLOCKS);
        for _ in 1..BLOCKS {
            give_back.send(Aligned::new()).expect("the receiver is here");
        }
        let name = path.to_owned();
        let thread = std::thread::spawn(move || {
            let mut file = file;
            for mut block in to_write {
                write(&mut file, &name, block.padded())?;
                block.len = 0;
                // No one to give it back to means that the build has failed elsewhere.
                let _ = give_back.send(block);
            }
            Ok(file)
        });
        let (filled, thread) = (Some(filled), Some(thread));
        Ok(Self { path: path.to_owned(), current: Aligned::new(), filled, empty, thread, length: 0 })
    }

    /// Bytes written so far.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Appends bytes.
    pub fn write(&mut self, mut bytes: &[u8]) -> Result<(), PointsError> {
        self.length += bytes.len() as u64;
        while !bytes.is_empty() {
            bytes = self.current.fill(bytes);
            if self.current.len == BLOCK {
                let Ok(next) = self.empty.recv() else { return Err(self.failure()) };
                let full = std::mem::replace(&mut self.current, next);
                if self.filled.as_ref().is_none_or(|f| f.send(full).is_err()) {
                    return Err(self.failure());
                }
            }
        }
        Ok(())
    }

    /// Writes what is left, cuts the padding off and waits until everything is on the disk.
    pub fn finish(mut self) -> Result<(), PointsError> {
        if let Some(filled) = self.filled.take() {
            let last = std::mem::replace(&mut self.current, Aligned { bytes: Vec::new(), start: 0, len: 0 });
            let _ = filled.send(last);
        }
        let file = self.join()?;
        file.set_len(self.length).and_then(|()| file.sync_all()).map_err(PointsError::io(&self.path))
    }

    fn join(&mut self) -> Result<File, PointsError> {
        self.filled = None;
        let ended = self.thread.take().map(JoinHandle::join);
        let gone = || io::Error::other("the writing thread has ended");
        ended.and_then(Result::ok).unwrap_or_else(|| Err(gone())).map_err(PointsError::io(&self.path))
    }

    fn failure(&mut self) -> PointsError {
        self.join().err().unwrap_or(PointsError::Cancelled)
    }
}

impl Drop for Writer {
    /// Waits for the thread, so that the file is closed before its folder is removed.
    fn drop(&mut self) {
        self.filled = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A new file, past the page cache where that is possible.
fn create(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::fs::OpenOptionsExt;
        let direct = options.clone().custom_flags(libc::O_DIRECT).open(path);
        // Some file systems (memory, network) refuse.
        if direct.is_ok() {
            return direct;
        }
        options.create_new(false).create(true).truncate(true);
    }
    options.open(path)
}

fn write(file: &mut File, path: &Path, bytes: &[u8]) -> io::Result<()> {
    let start = file.stream_position()?;
    match file.write_all(bytes) {
        // Alignment that was not enough for this disk.
        Err(error) if error.kind() == io::ErrorKind::InvalidInput => {
            *file = OpenOptions::new().write(true).open(path)?;
            file.seek(io::SeekFrom::Start(start))?;
            file.write_all(bytes)
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_length_comes_out_whole() {
        let folder = std::env::temp_dir().join(format!("farsight-writer-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for length in [0usize, 1, 4096, BLOCK, 2 * BLOCK + 5] {
            let path = folder.join(length.to_string());
            let bytes: Vec<u8> = (0..length).map(|i| (i * 7 % 251) as u8).collect();
            let mut writer = Writer::create(&path).unwrap();
            for part in bytes.chunks(1_000_003) {
                writer.write(part).unwrap();
            }
            writer.finish().unwrap();
            assert!(std::fs::read(&path).unwrap() == bytes);
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}
