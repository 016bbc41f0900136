//! Clouds for tests, and reading a built file back.
#![allow(dead_code)] // Each test program uses its own part.

use farsight_points::glam::DVec3;
use farsight_points::{
    BuildOptions, BuildReport, Grid, Input, NodeData, Point, PointsError, Store, build, no_progress,
};
use std::path::{Path, PathBuf};

/// A folder that is removed when the test ends.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("farsight-points-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Names of all that lies in the folder.
    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.0).unwrap();
        let mut names: Vec<String> =
            entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Numbers that are the same everywhere.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    pub fn below(&mut self, n: u64) -> u64 {
        self.bits() % n
    }

    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn colour(&mut self) -> [u8; 3] {
        let b = self.bits();
        [b as u8, (b >> 8) as u8, (b >> 16) as u8]
    }
}

pub fn grid() -> Grid {
    Grid::new(DVec3::splat(0.001), DVec3::new(500_000.0, 5_000_000.0, 300.0)).unwrap()
}

/// A wavy surface with some copies and a far outlier.
pub fn surface(count: usize, seed: u64) -> Vec<Point> {
    let mut random = Random(seed);
    let mut points: Vec<Point> = (0..count)
        .map(|_| {
            let (x, y) = (random.unit() * random.unit() * 40_000.0, random.unit() * 30_000.0);
            let z = 2000.0 * (x * 0.0003).sin() + 500.0 * (y * 0.001).cos() + random.unit() * 8.0;
            Point::new([x as i32 - 20_000, y as i32 - 90_000, z as i32], random.colour())
        })
        .collect();
    for i in 0..count / 50 {
        points[count - 1 - i] = Point::new(points[i % 40].position, random.colour());
    }
    points
}

pub fn shuffled(mut points: Vec<Point>, seed: u64) -> Vec<Point> {
    let mut random = Random(seed);
    for i in (1..points.len()).rev() {
        points.swap(i, random.below(i as u64 + 1) as usize);
    }
    points
}

pub fn build_points(
    points: &[Point],
    out: &Path,
    options: &BuildOptions,
) -> Result<BuildReport, PointsError> {
    build(Input::from_points(grid(), points), out, options, &no_progress)
}

/// Sorted copy, to compare sets with repetition.
pub fn sorted(points: &[Point]) -> Vec<([i32; 3], [u8; 4])> {
    let mut all: Vec<_> = points.iter().map(|p| (p.position, p.colour)).collect();
    all.sort_unstable();
    all
}

/// All points of a file.
pub fn all_points(store: &Store) -> Vec<Point> {
    let mut data = NodeData::default();
    let mut all = Vec::new();
    for node in store.octree().ids() {
        store.read(node, &mut data).unwrap();
        all.extend_from_slice(&data.points);
    }
    all
}

/// The start of a LAS 1.2 file of so many points of format 2, up to where its numbers about positions begin.
pub fn las_start(points: u32) -> Vec<u8> {
    let mut h = Vec::new();
    h.extend(b"LASF");
    h.extend([0; 20]);
    h.extend([1, 2]);
    h.extend([0; 68]);
    h.extend(227u16.to_le_bytes());
    h.extend(227u32.to_le_bytes());
    h.extend(0u32.to_le_bytes());
    h.push(2);
    h.extend(26u16.to_le_bytes());
    h.extend(points.to_le_bytes());
    h.extend([0; 20]);
    h
}

/// The points as a LAS 1.2 file of format 2.
pub fn las_bytes(points: &[Point]) -> Vec<u8> {
    let grid = grid();
    let mut h = las_start(points.len() as u32);
    for v in grid.scale.to_array().into_iter().chain(grid.offset.to_array()).chain([0.0; 6]) {
        h.extend(v.to_le_bytes());
    }
    for p in points {
        p.position.iter().for_each(|v| h.extend(v.to_le_bytes()));
        h.extend([0; 8]);
        p.colour[..3].iter().for_each(|&c| h.extend((u16::from(c) << 8).to_le_bytes()));
    }
    h
}
