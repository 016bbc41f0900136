//! LAS and LAZ: what is storable is kept whole, what is not is refused with the cause.
#![cfg(feature = "las")]

mod common;

use common::{Folder, Random, all_points, las_start, sorted};
use farsight_points::{
    BuildOptions, Input, LasOptions, NodeData, Point, PointsError, Store, build, no_progress,
};
use std::path::{Path, PathBuf};

/// A LAS 1.2 file of format 2 as some writer might have made it.
struct File {
    points: Vec<Point>,
    declared: u32,
    /// min and max per axis, as the header has them.
    bounds: [[f64; 2]; 3],
}

const SCALE: f64 = 0.001;
const OFFSET: [f64; 3] = [500_000.0, 5_000_000.0, 300.0];

impl File {
    fn new(points: Vec<Point>) -> Self {
        let at = |k: usize, f: fn(i32, i32) -> i32| {
            let v = points.iter().map(|p| p.position[k]).reduce(f).unwrap_or(0);
            f64::from(v) * SCALE + OFFSET[k]
        };
        let bounds = [0, 1, 2].map(|k| [at(k, i32::min), at(k, i32::max)]);
        Self { declared: points.len() as u32, points, bounds }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut h = las_start(self.declared);
        [SCALE; 3].iter().chain(&OFFSET).for_each(|v| h.extend(v.to_le_bytes()));
        self.bounds
            .iter()
            .for_each(|[lo, hi]| h.extend(hi.to_le_bytes().into_iter().chain(lo.to_le_bytes())));
        assert_eq!(h.len(), 227);
        for p in &self.points {
            p.position.iter().for_each(|v| h.extend(v.to_le_bytes()));
            h.extend(attributes(p));
            p.colour[..3].iter().for_each(|&c| h.extend((u16::from(c) << 8 | 0x5a).to_le_bytes()));
        }
        h
    }
}

/// Eight bytes that depend on the point.
fn attributes(p: &Point) -> [u8; 8] {
    let mut hash = Random(p.position[0] as u64 ^ (p.position[1] as u64) << 20 ^ u64::from(p.colour[0]));
    let mut bytes = hash.bits().to_le_bytes();
    // First return of one, ground, straight down: what a writer takes without complaint.
    bytes[2..5].copy_from_slice(&[0b1001, 2, 0]);
    bytes
}

fn cloud(count: usize, seed: u64, side: [u64; 3]) -> Vec<Point> {
    let mut random = Random(seed);
    (0..count).map(|_| Point::new([0, 1, 2].map(|k| random.below(side[k]) as i32), random.colour())).collect()
}

fn try_build(input: &Path, options: &LasOptions) -> Result<Store, PointsError> {
    let out = input.with_extension("points");
    build(Input::las(&[input], options)?, &out, &BuildOptions::default(), &no_progress)?;
    Store::open(out)
}

fn write(folder: &Folder, bytes: &[u8]) -> PathBuf {
    let path = folder.path("in.las");
    std::fs::write(&path, bytes).unwrap();
    path
}

/// The same points as LAZ.
fn compressed(folder: &Folder, las: &Path) -> PathBuf {
    let laz = folder.path("in.laz");
    let mut reader = las::Reader::from_path(las).unwrap();
    let mut header = las::Builder::from(reader.header().clone());
    header.point_format.is_compressed = true;
    let mut writer = las::Writer::from_path(&laz, header.into_header().unwrap()).unwrap();
    writer.write_points(&reader.read_all().unwrap()).unwrap();
    drop(writer);
    laz
}

#[test]
fn nine_bad_files_seven_kept_whole_two_refused() {
    let folder = Folder::new("nine");
    let copies = |n: usize| vec![Point::new([50_000, 60_000, 7000], [9, 8, 7]); n];
    let corners = [Point::new([0; 3], [1; 3]), Point::new([100_000; 3], [2; 3])];
    let near = cloud(100_000, 1, [40; 3]).into_iter().map(|p| Point {
        position: [p.position[0] + 50_000, p.position[1] + 60_000, p.position[2] + 7000],
        ..p
    });
    let mut small_box = File::new(cloud(20_000, 3, [1000; 3]));
    small_box.bounds = small_box.bounds.map(|[lo, hi]| [lo + 0.3, hi - 0.3]);
    let mut nan_box = File::new(cloud(20_000, 4, [1000; 3]));
    nan_box.bounds[1] = [f64::NAN, f64::NAN];
    let kept = [
        (
            "copies among near points",
            File::new(copies(300_000).into_iter().chain(near).chain(corners).collect()),
        ),
        (
            "copies among spread points",
            File::new(copies(300_000).into_iter().chain(cloud(300_000, 2, [90_000; 3])).collect()),
        ),
        ("empty", File::new(vec![])),
        ("one point", File::new(copies(1))),
        ("flat", File::new(cloud(50_000, 5, [1000, 1000, 1]))),
        ("box too small", small_box),
        ("box of NaN", nan_box),
    ];
    for (name, file) in kept {
        let store = try_build(&write(&folder, &file.bytes()), &LasOptions::default())
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(sorted(&all_points(&store)) == sorted(&file.points), "{name}");
        let grid = store.octree().grid();
        assert_eq!((grid.scale.to_array(), grid.offset.to_array()), ([SCALE; 3], OFFSET));
    }
    let half = File::new(cloud(10_000, 6, [1000; 3]));
    let mut bytes = half.bytes();
    bytes.truncate(227 + 26 * 5000);
    let error = try_build(&write(&folder, &bytes), &LasOptions::default()).unwrap_err().to_string();
    assert!(error.contains("10000 points declared") && error.contains("room for 5000"), "{error}");
    let mut many = half;
    many.declared = 4_000_000_000;
    let error = try_build(&write(&folder, &many.bytes()), &LasOptions::default()).unwrap_err().to_string();
    assert!(error.contains("4000000000 points declared"), "{error}");
}

#[test]
fn attributes_and_colours_of_las_and_laz_agree() {
    let folder = Folder::new("laz");
    let points = cloud(130_000, 7, [60_000, 70_000, 900]);
    let las = write(&folder, &File::new(points.clone()).bytes());
    let laz = compressed(&folder, &las);
    let mut options = LasOptions::default();
    options.attributes = true;
    let mut files = Vec::new();
    for path in [&las, &laz] {
        let store = try_build(path, &options).unwrap();
        assert_eq!((store.octree().attribute_bytes(), store.octree().attributes()), (8, "las:2"));
        assert!(sorted(&all_points(&store)) == sorted(&points));
        let mut data = NodeData::default();
        for id in store.octree().ids() {
            store.read(id, &mut data).unwrap();
            for (p, a) in data.points.iter().zip(data.attributes.chunks(8)) {
                assert_eq!(a, attributes(p));
            }
        }
        files.push(std::fs::read(path.with_extension("points")).unwrap());
    }
    assert!(files[0] == files[1], "both ways in give the same bytes");
}

#[test]
fn mutated_files_give_errors_or_points() {
    let folder = Folder::new("mutated");
    let las = write(&folder, &File::new(cloud(2000, 8, [3000; 3])).bytes());
    let laz = compressed(&folder, &las);
    // The decoder's panics are caught; they need not fill the screen.
    std::panic::set_hook(Box::new(|_| ()));
    let mut random = Random(9);
    for (path, rounds) in [(&las, 400), (&laz, 400)] {
        let bytes = std::fs::read(path).unwrap();
        let (mut refused, mut built) = (0, 0);
        for _ in 0..rounds {
            let mut copy = bytes.clone();
            for _ in 0..1 + random.below(2) {
                let reach = if random.below(3) == 0 { copy.len() as u64 } else { 400 };
                let at = random.below(reach) as usize;
                copy[at] =
                    if random.below(2) == 0 { random.bits() as u8 } else { copy[at] ^ 1 << random.below(8) };
            }
            if random.below(10) == 0 {
                copy.truncate(random.below(copy.len() as u64) as usize);
            }
            let mutated = path.with_file_name("mutated.las");
            std::fs::write(&mutated, copy).unwrap();
            match try_build(&mutated, &LasOptions::default()) {
                Ok(store) => {
                    assert_eq!(all_points(&store).len() as u64, store.octree().points());
                    built += 1;
                }
                Err(_) => refused += 1,
            }
        }
        assert!(refused > 30 && built > 30, "{refused} {built}");
    }
    let _ = std::panic::take_hook();
}

#[test]
fn autzen_west_comes_out_as_it_went_in() {
    let Some(data) = std::env::var_os("FARSIGHT_DATA") else { return };
    println!("uses autzen_west.laz");
    let path = Path::new(&data).join("autzen_west.laz");
    let folder = Folder::new("autzen");
    let out = folder.path("a.points");
    build(
        Input::las(&[&path], &LasOptions::default()).unwrap(),
        &out,
        &BuildOptions::default(),
        &no_progress,
    )
    .unwrap();
    let store = Store::open(&out).unwrap();
    let mut expected = Vec::new();
    let mut reader = las::Reader::from_path(&path).unwrap();
    let all = reader.read_all().unwrap();
    expected.extend(all.x_raw().zip(all.y_raw()).zip(all.z_raw()).map(|((x, y), z)| [x, y, z]));
    let mut found: Vec<[i32; 3]> = all_points(&store).iter().map(|p| p.position).collect();
    found.sort_unstable();
    expected.sort_unstable();
    assert!(found == expected && found.len() == 4_421_052);
}
