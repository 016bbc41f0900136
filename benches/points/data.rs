//! Clouds as LAS files, made once and kept in the target folder.

use farsight_geometry::glam::DVec3;
use farsight_raster::scenes::StreetPoints;
use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// How the points of a file are distributed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cloud {
    /// A scanned street.
    Street,
    /// A cube full of points.
    Volume,
    /// Everything in a cube of 8 m, but for two points far away.
    Outliers,
}

impl Cloud {
    pub const ALL: [Self; 3] = [Self::Street, Self::Volume, Self::Outliers];

    pub fn name(self) -> &'static str {
        match self {
            Self::Street => "street",
            Self::Volume => "volume",
            Self::Outliers => "outliers",
        }
    }
}

/// Points of one street.
const STREET: u64 = 20_000_000;
const SCALE: f64 = 0.001;
const OFFSET: DVec3 = DVec3::new(691_000.0, 5_335_000.0, 519.0);

/// The street of the bench: 575 m, so that its cube has 2²⁰ steps of a millimetre.
pub fn street(count: u64) -> StreetPoints {
    let mut street = StreetPoints::default();
    (street.count, street.length) = (count, 575.0);
    street
}

/// Folder for everything that the bench makes.
pub fn folder() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| "target".into(), PathBuf::from);
    target.join("points-bench")
}

/// A LAS 1.2 file of format 2; made when it is not there.
pub fn las_file(cloud: Cloud, count: u64) -> Result<PathBuf, Box<dyn Error>> {
    std::fs::create_dir_all(folder())?;
    let path = folder().join(format!("{}-{count}.las", cloud.name()));
    if !path.exists() {
        let part = path.with_extension("part");
        write(&part, cloud, count)?;
        std::fs::rename(part, &path)?;
    }
    Ok(path)
}

/// An integer position and a colour.
type Raw = ([i32; 3], [u8; 3]);

fn write(path: &Path, cloud: Cloud, count: u64) -> Result<(), Box<dyn Error>> {
    let mut out = BufWriter::with_capacity(1 << 20, File::create(path)?);
    out.write_all(&header(count, [0; 3], [0; 3]))?;
    let (mut lo, mut hi) = ([i32::MAX; 3], [i32::MIN; 3]);
    let mut record = [0u8; 26];
    for (position, colour) in points(cloud, count)? {
        (lo, hi) = ([0, 1, 2].map(|k| lo[k].min(position[k])), [0, 1, 2].map(|k| hi[k].max(position[k])));
        for (k, v) in position.into_iter().enumerate() {
            record[4 * k..4 * k + 4].copy_from_slice(&v.to_le_bytes());
        }
        // Something in every field, so that attributes do not compress away.
        record[12..20]
            .copy_from_slice(&(position[0] as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).to_le_bytes());
        for (k, v) in colour.into_iter().enumerate() {
            record[20 + 2 * k..22 + 2 * k].copy_from_slice(&(u16::from(v) << 8).to_le_bytes());
        }
        out.write_all(&record)?;
    }
    // The box is known only now.
    let mut file = out.into_inner()?;
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&header(count, lo, hi))?;
    Ok(file.sync_all()?)
}

fn points(cloud: Cloud, count: u64) -> Result<Box<dyn Iterator<Item = Raw>>, Box<dyn Error>> {
    let random = |i: u64, k: u64| {
        let z = (i * 3 + k).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    };
    let cube = move |i: u64, side: u64| {
        let p = [0, 1, 2].map(|k| (random(i, k) % side) as i32);
        let c = random(i, 7);
        (p, [c as u8, (c >> 8) as u8, (c >> 16) as u8])
    };
    Ok(match cloud {
        Cloud::Street if count > STREET => {
            // As many parallel streets, 30 m apart, as it takes: casting every ray anew would take an hour.
            let records = std::fs::read(las_file(cloud, STREET)?)?;
            let at = |r: &[u8], i: usize| i32::from_le_bytes([r[i], r[i + 1], r[i + 2], r[i + 3]]);
            Box::new((0..count).map(move |i| {
                let r = &records[227 + 26 * (i % STREET) as usize..];
                let aside = 30_000 * (i / STREET) as i32;
                ([at(r, 0), at(r, 4) + aside, at(r, 8)], [r[21], r[23], r[25]])
            }))
        }
        Cloud::Street => Box::new(street(count).points()?.map(|p| {
            let steps = ((p.position - OFFSET) / SCALE).round().to_array();
            (steps.map(|v| v as i32), p.colour)
        })),
        Cloud::Volume => Box::new((0..count).map(move |i| cube(i, 100_000))),
        Cloud::Outliers => {
            let far = [([0; 3], [0; 3]), ([100_000_000; 3], [9; 3])];
            let moved = move |i| {
                let (p, c) = cube(i, 8000);
                (p.map(|v| v + 33_000_000), c)
            };
            Box::new(far.into_iter().chain((2..count).map(moved)))
        }
    })
}

/// A public header block of LAS 1.2.
pub fn header(count: u64, lo: [i32; 3], hi: [i32; 3]) -> Vec<u8> {
    let mut h = Vec::with_capacity(227);
    h.extend(b"LASF");
    h.extend([0; 20]);
    h.extend([1, 2]);
    h.extend([0; 64]);
    h.extend([0; 4]);
    h.extend(227u16.to_le_bytes());
    h.extend(227u32.to_le_bytes());
    h.extend(0u32.to_le_bytes());
    h.push(2);
    h.extend(26u16.to_le_bytes());
    h.extend((count as u32).to_le_bytes());
    h.extend([0; 20]);
    for v in [SCALE; 3].into_iter().chain(OFFSET.to_array()) {
        h.extend(v.to_le_bytes());
    }
    for k in 0..3 {
        for v in [hi[k], lo[k]] {
            h.extend((f64::from(v) * SCALE + OFFSET[k]).to_le_bytes());
        }
    }
    h
}
