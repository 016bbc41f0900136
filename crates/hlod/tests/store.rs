//! Stores that may hold anything, and builds that end in any way.

mod common;

use farsight_geometry::glam::{Vec2, Vec3};
use farsight_geometry::{TriangleMesh, hard_cases};
use farsight_hlod::{
    BuildOptions, HlodError, Mesh, NodeMesh, Progress, Stage, Store, Tier, build, no_progress,
};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

/// A path in a folder of its own; removed in the end.
struct TempPath(PathBuf);

impl TempPath {
    fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let folder =
            std::env::temp_dir().join(format!("farsight-hlod-store-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder.join("a.hlod"))
    }

    /// Everything beside the output.
    fn litter(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.parent().unwrap()).unwrap();
        entries
            .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
            .filter(|n| n != "a.hlod")
            .collect()
    }
}

impl Drop for TempPath {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(self.0.parent().unwrap());
    }
}

fn small() -> BuildOptions {
    BuildOptions::default().with_most_triangles(500).with_tier(Tier::Verified).with_threads(1)
}

/// A ball with every attribute; texture coordinates have a seam.
fn painted(n: u32) -> TriangleMesh {
    let ball = hard_cases::bumpy_ball(n);
    let p: Vec<Vec3> = ball.corner_iter().flatten().collect();
    let t = (0..p.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let normals = p.iter().map(|p| p.normalize()).collect();
    let uvs = p.iter().map(|p| Vec2::new(p.x, if p.z > 0.0 { p.y } else { p.y + 2.0 })).collect();
    let colours = p.iter().map(|p| [(p.z * 99.0 + 120.0) as u8, 80, 90, 255]).collect();
    let mesh = TriangleMesh::new(p, t).unwrap();
    mesh.with_normals(normals).unwrap().with_uvs(uvs).unwrap().with_colours(colours).unwrap()
}

fn bytes_of(meshes: &[&TriangleMesh], options: &BuildOptions) -> Vec<u8> {
    let path = TempPath::new();
    build(meshes.iter().map(|m| Ok::<_, HlodError>(*m)), &path.0, options, &no_progress).unwrap();
    assert!(path.litter().is_empty(), "{:?}", path.litter());
    std::fs::read(&path.0).unwrap()
}

/// Opens and reads everything: an answer or an error, never a panic.
fn read_all(bytes: Vec<u8>) -> Result<u64, HlodError> {
    let store = Store::from_bytes(bytes)?;
    let mut mesh = NodeMesh::default();
    let mut triangles = 0;
    for node in store.tree().ids() {
        for which in [Mesh::Full, Mesh::Shape] {
            store.read(node, which, &mut mesh)?;
            mesh.to_mesh()?;
            triangles += mesh.indices.len() as u64 / 3;
        }
    }
    Ok(triangles)
}

/// Numbers from a fixed sequence.
fn numbers(mut seed: u64) -> impl FnMut(usize) -> usize {
    move |below| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % below
    }
}

#[test]
fn ten_thousand_damaged_stores_give_errors() {
    let whole = bytes_of(&[&painted(8)], &small());
    let expected = read_all(whole.clone()).unwrap();
    assert!(expected > 1000);
    let mut number = numbers(1);
    let (mut refused, mut same) = (0, 0);
    for i in 0..10_000 {
        let mut bytes = whole.clone();
        match i % 5 {
            0 => bytes.truncate(number(whole.len())),
            1 => {
                let at = number(whole.len());
                bytes[at] ^= 1 << number(8);
            }
            2 => {
                let (at, count) = (number(whole.len()), 1 + number(40));
                let end = (at + count).min(whole.len());
                bytes[at..end].iter_mut().for_each(|b| *b = number(256) as u8);
            }
            3 => {
                // In the index, where numbers mean most.
                let at = whole.len() - 1 - number(whole.len() / 8);
                bytes[at] = number(256) as u8;
            }
            _ => bytes.extend((0..1 + number(64)).map(|_| number(256) as u8)),
        }
        match read_all(bytes) {
            Err(HlodError::Damaged { .. }) => refused += 1,
            Err(other) => panic!("{i}: {other}"),
            Ok(found) => {
                assert_eq!(found, expected, "{i}");
                same += 1;
            }
        }
    }
    // What was not refused is what hit a byte with its own value.
    assert!(refused > 9800 && same < 200, "{refused} {same}");
}

#[test]
fn lies_with_right_checksums_do_no_harm() {
    let whole = bytes_of(&[&painted(6)], &small());
    let length = whole.len();
    let number_at = |at: usize| u64::from_le_bytes(whole[at..at + 8].try_into().unwrap()) as usize;
    let (index, size) = (number_at(length - 32), number_at(length - 24));
    let mut number = numbers(2);
    for _ in 0..10_000 {
        let mut bytes = whole.clone();
        for _ in 0..1 + number(3) {
            let at = index + number(size);
            bytes[at] = number(256) as u8;
        }
        let crc = crc32fast::hash(&bytes[index..index + size]).to_le_bytes();
        bytes[length - 16..length - 12].copy_from_slice(&crc);
        let own = crc32fast::hash(&bytes[length - 32..length - 12]).to_le_bytes();
        bytes[length - 12..length - 8].copy_from_slice(&own);
        // A believable lie (another error, say) is believed; nothing else matters here.
        let _ = read_all(bytes);
    }
}

#[test]
fn batches_threads_and_memory_change_no_byte() {
    let ball = painted(14);
    let options = small();
    let one = bytes_of(&[&ball], &options);
    let half = ball.triangles().len() / 3;
    let part = |range: std::ops::Range<usize>| {
        let t = ball.triangles()[range].to_vec();
        let mesh = TriangleMesh::new(ball.positions().to_vec(), t).unwrap();
        mesh.with_normals(ball.normals().unwrap().to_vec())
            .unwrap()
            .with_uvs(ball.uvs().unwrap().to_vec())
            .unwrap()
            .with_colours(ball.colours().unwrap().to_vec())
            .unwrap()
    };
    let (a, b) = (part(0..half), part(half..ball.triangles().len()));
    assert!(bytes_of(&[&a, &b], &options) == one, "batches");
    assert!(bytes_of(&[&ball], &options.with_threads(2)) == one, "threads");
    assert!(bytes_of(&[&ball], &options.with_resume(true)) == one, "resume");
    assert!(bytes_of(&[&ball], &options.with_memory(1 << 30)) == one, "memory");
}

#[test]
fn what_does_not_fit_in_memory_goes_to_disk_and_comes_out_the_same() {
    // 64 MiB hold some 26,000 triangles with attributes while they are cut.
    let ball = painted(64);
    let options = BuildOptions::default().with_tier(Tier::Fast).with_threads(1).with_appearance(true);
    let little = bytes_of(&[&ball], &options.with_memory(64 << 20));
    assert!(little == bytes_of(&[&ball], &options.with_memory(1 << 32)));
}

#[test]
fn cancelled_builds_leave_nothing_and_keep_what_was_there() {
    let ball = painted(10);
    let path = TempPath::new();
    for stage in [Stage::Read, Stage::Cut, Stage::Simplify] {
        std::fs::write(&path.0, b"older").unwrap();
        let stop = |p: Progress| {
            if p.stage == stage && p.done > 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let outcome = build([Ok::<_, HlodError>(&ball)], &path.0, &small(), &stop);
        assert!(matches!(outcome, Err(HlodError::Cancelled)), "{stage:?}");
        assert_eq!(std::fs::read(&path.0).unwrap(), b"older");
        assert!(path.litter().is_empty(), "{stage:?} {:?}", path.litter());
    }
    let failing = [Ok(&ball), Err("the disk is on fire")];
    match build(failing, &path.0, &small(), &no_progress) {
        Err(HlodError::Input { batch: 1, source }) => assert_eq!(source.to_string(), "the disk is on fire"),
        other => panic!("{other:?}"),
    }
    assert!(path.litter().is_empty());
}

#[test]
fn a_killed_build_goes_on_where_it_was() {
    let ball = painted(24);
    let options = small().with_resume(true);
    let expected = bytes_of(&[&ball], &options);
    let path = TempPath::new();
    // As if killed: the folder of a build that ended in the middle is put back.
    let (folder, saved) = (path.0.with_file_name("a.hlod.building"), path.0.with_file_name("saved"));
    let stop = |p: Progress| {
        if p.stage == Stage::Simplify && p.done == 5 {
            std::fs::create_dir_all(&saved).unwrap();
            std::fs::copy(folder.join("inner"), saved.join("inner")).unwrap();
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    };
    assert!(build([Ok::<_, HlodError>(&ball)], &path.0, &options, &stop).is_err());
    let whole = std::fs::read(saved.join("inner")).unwrap();
    for cut in [0, 10, 40, whole.len() / 2, whole.len() - 1, whole.len()] {
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("inner"), &whole[..cut]).unwrap();
        std::fs::write(folder.join("cell-0-0-0-0-3"), b"leftover").unwrap();
        let report = build([Ok::<_, HlodError>(&ball)], &path.0, &options, &no_progress).unwrap();
        assert!(std::fs::read(&path.0).unwrap() == expected, "cut at {cut}");
        assert_eq!(report.resumed > 0, cut >= whole.len() / 2, "cut at {cut}: {}", report.resumed);
        assert!(!folder.exists());
    }
    // Of another input, nothing is taken over.
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("inner"), &whole).unwrap();
    let other = build([Ok::<_, HlodError>(&painted(11))], &path.0, &options, &no_progress).unwrap();
    assert_eq!(other.resumed, 0);
}

#[test]
fn every_hard_mesh_becomes_a_store() {
    for hard in hard_cases::meshes() {
        for appearance in [false, true] {
            let path = TempPath::new();
            let options = small().with_appearance(appearance);
            build([Ok::<_, HlodError>(&hard.mesh)], &path.0, &options, &no_progress)
                .unwrap_or_else(|e| panic!("{}: {e}", hard.name));
            let store = Store::open(&path.0).unwrap();
            assert_eq!(store.tree().root().is_none(), hard.mesh.is_empty(), "{}", hard.name);
            assert_eq!(store.tree().input_triangles(), hard.mesh.triangles().len() as u64);
            read_all(std::fs::read(&path.0).unwrap()).unwrap();
            let (tree, bounds) = (store.tree(), hard.mesh.world_bounds());
            if !hard.mesh.is_empty() {
                let margin = tree.ids().map(|n| tree.error(n, Mesh::Full).value).fold(0.0, f64::max);
                assert!(tree.world_bounds().inflated(margin).contains_box(&bounds), "{}", hard.name);
            }
        }
    }
}

#[test]
fn impossible_options_and_places_are_named() {
    let ball = hard_cases::bumpy_ball(2);
    let path = TempPath::new();
    let refused =
        |options: BuildOptions| match build([Ok::<_, HlodError>(&ball)], &path.0, &options, &no_progress) {
            Err(HlodError::Option { option, .. }) => option,
            other => panic!("{other:?}"),
        };
    assert_eq!(refused(BuildOptions::default().with_resolution(f64::NAN)), "resolution");
    assert_eq!(refused(BuildOptions::default().with_most_triangles(3)), "most_triangles");
    assert_eq!(refused(BuildOptions::default().with_memory(1)), "memory");
    assert_eq!(refused(BuildOptions::default().with_precision(0.0)), "precision");
    let nowhere = std::path::Path::new("/nowhere/at/all.hlod");
    assert!(matches!(
        build([Ok::<_, HlodError>(&ball)], nowhere, &small(), &no_progress),
        Err(HlodError::Io { .. })
    ));
    assert!(matches!(Store::open(nowhere), Err(HlodError::Io { .. })));
    assert!(matches!(Store::open(std::env::temp_dir()), Err(HlodError::Io { .. })));
}

#[test]
fn one_file_is_built_once_at_a_time() {
    let ball = painted(6);
    let path = TempPath::new();
    let inner = |_: Progress| {
        let second = build([Ok::<_, HlodError>(&ball)], &path.0, &small(), &no_progress);
        assert!(matches!(second, Err(HlodError::Io { .. })), "{second:?}");
        ControlFlow::Continue(())
    };
    build([Ok::<_, HlodError>(&ball)], &path.0, &small(), &inner).unwrap();
}
