//! Bakes in parts, broken off and taken up again, give the same bytes.

use farsight_geometry::DAabb;
use farsight_geometry::hard_cases::bumpy_ball;
use farsight_geometry::ray::Bvh8;
use farsight_visibility::glam::{DVec3, UVec3};
use farsight_visibility::{
    Bake, Budget, CellGrid, Occluders, Options, PvsStore, Triangles, VisibilityError, shard,
};
use std::ops::ControlFlow;
use std::path::PathBuf;

fn grid() -> CellGrid {
    CellGrid::new(DAabb::new(DVec3::new(1.5, -1.0, -1.0), DVec3::new(2.5, 1.0, 1.0)), UVec3::new(2, 3, 3))
        .unwrap()
}

fn with_bake<T>(work: impl FnOnce(&Bake<Bvh8>) -> T) -> T {
    let mesh = bumpy_ball(5);
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let mut options = Options::default();
    options.first_random = 2000;
    let occluders = Occluders::opaque(&caster);
    let budget = Budget::missed(1e-3, 0.9, 60_000).unwrap();
    work(&Bake { triangles: &triangles, occluders, grid: grid(), options, budget })
}

/// A place for files of one test.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn parts_concatenate_to_the_whole() {
    with_bake(|bake| {
        let all = |_: &_| ControlFlow::Continue(());
        let whole = PvsStore::read(&bake.section(0..18, all).unwrap()).unwrap();
        let parts: Vec<u8> =
            (0..4).flat_map(|part| bake.section(shard(&bake.grid, part, 4), all).unwrap()).collect();
        let joined = PvsStore::read(&parts).unwrap();
        assert_eq!((whole.missing(), joined.missing()), (None, None));
        for cell in 0..18 {
            let baked = bake.cell(cell).unwrap();
            assert!(baked.set.len() > 50 && baked.missed.is_some_and(|m| m.bound.value <= 1e-3));
            assert_eq!(whole.get(cell).as_ref(), Some(&baked.set));
            assert_eq!(joined.get(cell).as_ref(), Some(&baked.set));
        }
        let three =
            bake.section(0..18, |c| if c.cell == 2 { ControlFlow::Break(()) } else { all(c) }).unwrap();
        assert!(bake.section(0..18, all).unwrap().starts_with(&three));
        assert!(matches!(bake.section(5..19, all), Err(VisibilityError::CellRange { .. })));
    });
}

#[test]
fn a_bake_that_was_killed_goes_on_where_it_was() {
    let folder = folder("bake");
    let (path, part) = (folder.join("street.pvs"), folder.join("street.pvs.part"));
    with_bake(|bake| {
        let stop_at = |n: u32| {
            move |c: &farsight_visibility::BakedCell| {
                if c.cell == n { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            }
        };
        assert_eq!(bake.to_file(&path, 0..18, stop_at(9)), Ok(false));
        assert!(part.exists() && !path.exists());
        // Killed while it wrote.
        let mut bytes = std::fs::read(&part).unwrap();
        bytes.extend([7; 33]);
        std::fs::write(&part, &bytes).unwrap();
        let mut baked = Vec::new();
        let done = bake.to_file(&path, 0..18, |c| {
            baked.push(c.cell);
            ControlFlow::Continue(())
        });
        assert_eq!((done, baked[0], baked.len()), (Ok(true), 10, 8));
        assert!(path.exists() && !part.exists());
        let straight = bake.section(0..18, |_| ControlFlow::Continue(())).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), straight);
        // What another bake left behind, with other rays or by another version, is not taken for this one's.
        let mut other = bake.clone();
        other.budget = Budget::rays(5000);
        assert_eq!(other.to_file(&path, 0..18, stop_at(9)), Ok(false));
        let mut first = None;
        let done = bake.to_file(&path, 0..18, |c| {
            first.get_or_insert(c.cell);
            ControlFlow::Continue(())
        });
        assert_eq!((done, first), (Ok(true), Some(0)));
        assert_eq!(std::fs::read(&path).unwrap(), straight);
        for left in [&straight[..], &straight[..40], &[]] {
            std::fs::write(&part, left).unwrap();
            assert_eq!(bake.to_file(&path, 0..18, stop_at(100)), Ok(true));
            assert_eq!(std::fs::read(&path).unwrap(), straight);
        }
        let nowhere = folder.join("no such folder").join("x.pvs");
        assert!(matches!(bake.to_file(&nowhere, 0..18, stop_at(100)), Err(VisibilityError::File { .. })));
    });
}
