//! Going on after a kill: what was read and distributed is kept, and found again by what it was made of.
//!
//! When all points are in their buckets, those in memory are written beside those that were spilled, and a manifest says what
//! lies where. Reading, decoding and distributing are then behind; sorting and writing is what is left.

use super::Distributed;
use super::partition::{Bucket, Held, Piece, SpillFile};
use super::temp::Scratch;
use crate::PointsError;
use crate::frame::{Cell, Frame};
use crate::input::{Input, Source};
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Name of the manifest in the scratch folder.
const MANIFEST: &str = "manifest";
const MAGIC: u64 = u64::from_le_bytes(*b"fsresum1");

/// What distinguishes one input from another: names, lengths and times of its files, and how they are read. `None` for
/// arrays and readers, which cannot be recognised.
pub(super) fn identity(input: &Input<'_>) -> Option<u64> {
    // FNV-1a.
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let mut add = |bytes: &[u8]| {
        bytes.iter().for_each(|&b| hash = (hash ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    };
    for part in &input.parts {
        if !matches!(part.source, Source::File { .. } | Source::Raw(_)) {
            return None;
        }
        let metadata = std::fs::metadata(&part.name).ok()?;
        let modified = metadata.modified().ok()?.duration_since(std::time::UNIX_EPOCH).ok()?;
        let name = std::fs::canonicalize(&part.name).ok()?;
        add(name.as_os_str().as_encoded_bytes());
        add(&metadata.len().to_le_bytes());
        add(&modified.as_nanos().to_le_bytes());
        add(format!("{:?}{:?}", part.layout, part.shift).as_bytes());
    }
    add(format!("{:?}{}", input.grid(), input.attributes()).as_bytes());
    Some(hash)
}

/// Whether a scratch folder holds the distributed points of an input.
pub(super) fn is_saved(folder: &Path, identity: u64) -> bool {
    read_manifest(folder).is_some_and(|words| words[1] == identity)
}

/// A manifest whose checksum is right, without it.
fn read_manifest(folder: &Path) -> Option<Vec<u64>> {
    let bytes = std::fs::read(folder.join(MANIFEST)).ok()?;
    let (words, rest) = bytes.as_chunks::<8>();
    let mut words: Vec<u64> = words.iter().map(|w| u64::from_le_bytes(*w)).collect();
    let crc = words.pop()?;
    let sound = rest.is_empty() && words.len() > 2 && words[0] == MAGIC;
    (sound && crc == u64::from(crc32fast::hash(&bytes[..bytes.len() - 8]))).then_some(words)
}

/// Puts everything on the disk, and the manifest last.
pub(super) fn save(
    buckets: &mut [Bucket],
    frame: Frame,
    hi: [i32; 3],
    identity: u64,
    scratch: &Scratch,
    held: &Held,
) -> Result<(), PointsError> {
    let (file, path) = scratch.create("kept")?;
    let kept = Arc::new(SpillFile { file, path });
    let mut end = 0;
    let mut files = vec![Arc::clone(&kept)];
    let mut words = vec![MAGIC, identity, frame.bits.into()];
    words.extend(frame.lo.iter().chain(&hi).map(|&v| v as u32 as u64));
    words.push(buckets.len() as u64);
    for bucket in buckets {
        words.extend(bucket.cell.min.map(u64::from));
        words.extend([
            bucket.cell.level.into(),
            bucket.points,
            bucket.compact.into(),
            bucket.pieces.len() as u64,
        ]);
        for piece in &mut bucket.pieces {
            piece.spill_to(&kept, &mut end, held)?;
            let Piece::Spilled { file, offset, words: length } = piece else { continue };
            let number = files.iter().position(|f| Arc::ptr_eq(f, file)).unwrap_or_else(|| {
                files.push(Arc::clone(file));
                files.len() - 1
            });
            words.extend([number as u64, *offset, *length as u64]);
        }
    }
    words.push(files.len() as u64);
    for spilled in files {
        spilled.file.sync_all().map_err(PointsError::io(&spilled.path))?;
        // Names are "kept" and "spill-N".
        let name = spilled.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        words.push(name.strip_prefix("spill-").and_then(|n| n.parse().ok()).unwrap_or(u64::MAX));
    }
    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
    let crc = u64::from(crc32fast::hash(&bytes));
    let (mut file, path) = scratch.create("manifest-unfinished")?;
    let written = file
        .write_all(&bytes)
        .and_then(|()| file.write_all(&crc.to_le_bytes()))
        .and_then(|()| file.sync_all());
    written.and_then(|()| std::fs::rename(&path, scratch.path(MANIFEST))).map_err(PointsError::io(&path))
}

/// Reads the manifest of an adopted folder. `None` when anything in it does not fit, so that the work is done anew.
pub(super) fn load(scratch: &Scratch) -> Option<Distributed> {
    let words = read_manifest(&scratch.path(""))?;
    let mut words = words.into_iter().skip(2);
    let mut next = || words.next();
    let bits = u32::try_from(next()?).ok().filter(|&b| b <= 32)?;
    let mut int = || next().map(|v| v as u32 as i32);
    let (lo, hi) = ([int()?, int()?, int()?], [int()?, int()?, int()?]);
    let mut buckets = Vec::new();
    let mut places = Vec::new();
    for _ in 0..next()? {
        let min = [next()? as u32, next()? as u32, next()? as u32];
        let (level, points, compact, pieces) = (next()? as u32, next()?, next()? == 1, next()?);
        for _ in 0..pieces {
            places.push((buckets.len(), next()?, next()?, next()?));
        }
        buckets.push(Bucket { cell: Cell { min, level }, points, compact, pieces: Vec::new() });
    }
    let mut files = Vec::new();
    for _ in 0..next()? {
        let number = next()?;
        let path = scratch.path(&if number == u64::MAX { "kept".into() } else { format!("spill-{number}") });
        let file = File::open(&path).ok()?;
        let length = file.metadata().ok()?.len();
        files.push((Arc::new(SpillFile { file, path }), length));
    }
    for (bucket, number, offset, length) in places {
        let (file, bytes) = files.get(number as usize)?;
        offset.checked_add(length.checked_mul(8)?).filter(|end| end <= bytes)?;
        buckets[bucket].pieces.push(Piece::Spilled {
            file: Arc::clone(file),
            offset,
            words: length as usize,
        });
    }
    Some(Distributed { frame: Frame { lo, bits }, hi, buckets })
}
