//! Files that are damaged on purpose: an error or a sound tree, never a panic, never much memory.

mod common;

use common::{Folder, Random, build_points, surface};
use farsight_points::{BuildOptions, NodeData, PointsError, Store};

fn file() -> Vec<u8> {
    let folder = Folder::new(&format!("hostile-{:?}", std::thread::current().id()));
    let path = folder.path("a.points");
    let mut options = BuildOptions::default();
    (options.inner_depth, options.merge_below) = (3, 20);
    build_points(&surface(3000, 1), &path, &options).unwrap();
    std::fs::read(path).unwrap()
}

/// Opens and reads everything that can be read.
fn use_it(bytes: Vec<u8>) -> Result<u64, PointsError> {
    let length = bytes.len();
    let store = Store::from_bytes(bytes)?;
    let octree = store.octree();
    let mut data = NodeData::default();
    let mut points = 0;
    for id in octree.ids() {
        assert!(octree.bounds(id).min.is_finite() && octree.level(id) <= 32);
        assert!(octree.children(id).all(|c| c > id && octree.parent(c) == Some(id)));
        if store.read(id, &mut data).is_ok() {
            points += data.points.len() as u64;
        }
        assert!(data.bytes() <= length);
    }
    Ok(points)
}

#[test]
fn every_truncation_is_refused() {
    let bytes = file();
    for length in (0..bytes.len()).step_by(7).chain(bytes.len() - 200..bytes.len()) {
        let error = use_it(bytes[..length].to_vec()).unwrap_err();
        assert!(matches!(error, PointsError::Damaged { .. }), "{length}: {error}");
    }
    assert_eq!(use_it(bytes).unwrap(), 3000);
}

#[test]
fn ten_thousand_mutations_do_no_harm() {
    let bytes = file();
    let mut random = Random(2);
    let tail = bytes.len() as u64 / 4;
    let (mut refused, mut opened) = (0, 0);
    for i in 0..12_000 {
        let mut copy = bytes.clone();
        for _ in 0..1 + random.below(3) {
            // Most of them where the index is.
            let at = if i % 4 == 0 {
                random.below(copy.len() as u64)
            } else {
                copy.len() as u64 - 1 - random.below(tail)
            };
            copy[at as usize] = match random.below(4) {
                0 => 0,
                1 => 0xff,
                2 => copy[at as usize] ^ 1 << random.below(8),
                _ => random.bits() as u8,
            };
        }
        match use_it(copy) {
            Ok(_) => opened += 1,
            Err(PointsError::Damaged { .. }) => refused += 1,
            Err(other) => panic!("{other}"),
        }
    }
    assert!(refused > 3000 && opened > 100, "{refused} refused, {opened} opened");
}

/// With checksums made right again, so that what they guard is reached.
#[test]
fn mutations_behind_right_checksums_do_no_harm() {
    let bytes = file();
    let end = bytes.len() - 32;
    let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let (index, length) = (number(end), number(end + 8));
    assert_eq!(index + length, end);
    let mut random = Random(3);
    let (mut refused, mut opened) = (0, 0);
    for _ in 0..12_000 {
        let mut copy = bytes.clone();
        for _ in 0..1 + random.below(2) {
            let at = index + random.below(length as u64) as usize;
            copy[at] =
                if random.below(2) == 0 { random.bits() as u8 } else { copy[at] ^ 1 << random.below(8) };
        }
        let crc = crc32fast::hash(&copy[index..end]);
        copy[end + 16..end + 20].copy_from_slice(&crc.to_le_bytes());
        let own = crc32fast::hash(&copy[end..end + 20]);
        copy[end + 20..end + 24].copy_from_slice(&own.to_le_bytes());
        match use_it(copy) {
            Ok(_) => opened += 1,
            Err(PointsError::Damaged { .. }) => refused += 1,
            Err(other) => panic!("{other}"),
        }
    }
    assert!(refused > 1000 && opened > 100, "{refused} refused, {opened} opened");
}

#[test]
fn what_is_no_file_of_points_is_named() {
    let folder = Folder::new("no-file");
    assert!(matches!(Store::open(folder.path("missing")), Err(PointsError::Io { .. })));
    assert!(matches!(Store::open(folder.path("")), Err(PointsError::Io { .. })));
    std::fs::write(folder.path("text"), "hello".repeat(100)).unwrap();
    let error = Store::open(folder.path("text")).unwrap_err().to_string();
    assert!(error.contains("text") && error.contains("not a file of points"), "{error}");
}
