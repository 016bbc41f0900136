//! Sets on disk, and baking many.

use super::Ask;
use super::scenes::Case;
use farsight_geometry::DAabb;
use farsight_geometry::glam::UVec3;
use farsight_visibility::{Bake, Budget, CellGrid, Occluders, Options, PvsStore, PvsWriter, Sampler, shard};
use std::error::Error;
use std::ops::ControlFlow;
use std::time::Instant;

pub fn report(case: &Case, ask: &Ask) -> Result<(), Box<dyn Error>> {
    println!("\nstorage, {}", case.name);
    let triangles = case.triangles();
    let mut sampler =
        Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, Options::default())?;
    sampler.run(&Budget::rays(4_000_000));
    let set = sampler.pvs();
    let one = CellGrid::new(*case.cell.bounds(), UVec3::ONE)?;
    let mut writer = PvsWriter::new(one, triangles.members(), 0..1)?;
    writer.add(&set)?;
    println!(
        "one cell: {} of {} triangles in {} runs, {} bytes: {:.3} a visible triangle (floor 0.6)",
        set.len(),
        triangles.members(),
        set.runs().len(),
        writer.bytes().len(),
        writer.bytes().len() as f64 / f64::from(set.len())
    );
    let b = case.cell.bounds();
    // Along the street in steps of two metres, eye heights from 1.3 to 2.1 m.
    let cells = if ask.quick { UVec3::new(8, 1, 1) } else { UVec3::new(60, 2, 1) };
    let middle = b.center();
    let length = 2.0 * f64::from(cells.x);
    let min = middle.with_x(middle.x - 0.5 * length).with_y(b.min.y).with_z(b.min.z);
    let max = middle.with_x(middle.x + 0.5 * length).with_y(b.max.y).with_z(b.max.z);
    let grid = CellGrid::new(DAabb::new(min, max), cells)?;
    let rays = if ask.quick { 200_000 } else { 700_000 };
    let bake = Bake {
        triangles: &triangles,
        occluders: Occluders::opaque(&case.caster),
        grid,
        options: Options::default(),
        budget: Budget::rays(rays),
    };
    let start = Instant::now();
    let mut members = 0u64;
    let mut sections = Vec::new();
    for part in 0..2 {
        let section = bake.section(shard(&grid, part, 2), |cell| {
            members += u64::from(cell.set.len());
            ControlFlow::Continue(())
        })?;
        sections.extend(section);
    }
    let seconds = start.elapsed().as_secs_f64();
    let store = PvsStore::read(&sections)?;
    println!(
        "bake of {} cells in 2 parts, {rays} rays each: {seconds:.1} s on the threads there are, {} bytes, {:.3} a visible triangle, complete: {}",
        grid.len(),
        sections.len(),
        sections.len() as f64 / members as f64,
        store.missing().is_none()
    );
    let start = Instant::now();
    let decoded: u64 = (0..grid.len()).filter_map(|c| store.get(c)).map(|s| u64::from(s.len())).sum();
    println!(
        "look-up: {:.0} us a cell of {:.0} members",
        start.elapsed().as_secs_f64() * 1e6 / f64::from(grid.len()),
        decoded as f64 / f64::from(grid.len())
    );
    Ok(())
}
