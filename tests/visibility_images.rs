//! Visible sets judged by pictures of the reference renderer, which shares no code with the ray casters.

#[path = "../benches/visibility/item_buffer.rs"]
mod item_buffer;

use farsight_geometry::camera::Projection;
use farsight_geometry::glam::DVec3;
use farsight_geometry::ray::Bvh8;
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, DAabb, TriangleMesh};
use farsight_raster::scenes::City;
use farsight_visibility::{
    Budget, ItemBuffer, NirOptions, Occluders, Options, Pvs, Sampler, Triangles, ViewCell, nir,
};
use item_buffer::Pictures;

fn town() -> (TriangleMesh, DAabb) {
    let mesh = City::small().build().unwrap().flattened().unwrap();
    let (center, half) = (DVec3::new(31.5, 56.5, 1.7), DVec3::new(7.5, 1.1, 0.4));
    (mesh, DAabb::new(center - half, center + half))
}

fn sampled(mesh: &TriangleMesh, cell: &DAabb, options: Options, rays: u64) -> Pvs {
    let (triangles, caster) = (Triangles::of_mesh(mesh), Bvh8::new(mesh));
    let cell = ViewCell::from_box(cell).unwrap();
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options).unwrap();
    sampler.run(&Budget::rays(rays));
    sampler.pvs()
}

#[test]
fn pictures_from_the_cell_show_almost_nothing_that_the_set_lacks() {
    let (mesh, cell) = town();
    let guided = sampled(&mesh, &cell, Options::default(), 1_000_000);
    let random = sampled(&mesh, &cell, Options::random(), 1_000_000);
    let mut pictures = Pictures::of_mesh(mesh);
    let mut rng = Random::new(3);
    let (mut pixels, mut wrong) = (0, [0, 0]);
    for _ in 0..12 {
        let eye = cell.min + (cell.max - cell.min) * DVec3::from_array(rng.units());
        let angle = rng.unit() * std::f64::consts::TAU;
        let ahead = DVec3::new(angle.cos(), angle.sin(), rng.unit() - 0.5);
        let camera = Camera::look_at(eye, eye + ahead, DVec3::Z)
            .and_then(|c| c.with_projection(Projection::Perspective { fov_y: 1.2 }))
            .and_then(|c| c.with_image(500, 500))
            .and_then(|c| c.with_range(1e-3, f64::INFINITY))
            .unwrap();
        let mut ids = Vec::new();
        pictures.draw(&camera, &mut ids);
        pixels += ids.len();
        for (set, wrong) in [&guided, &random].into_iter().zip(&mut wrong) {
            *wrong += ids.iter().filter(|&&id| id != 0 && !set.contains(id - 1)).count();
        }
    }
    let per_million = wrong.map(|w| w as f64 * 1e6 / pixels as f64);
    // Snapped vertices let the renderer see a hair past edges, so that zero is not to be had.
    assert!(per_million[0] < 30.0, "{per_million:?}");
    assert!(per_million[1] > 10.0 * per_million[0], "{per_million:?}");
}

#[test]
fn adaptive_hemicubes_find_less_than_guided_rays() {
    let (mesh, cell) = town();
    let guided = sampled(&mesh, &cell, Options::default(), 1_000_000);
    let mut pictures = Pictures::of_mesh(mesh);
    let mut options = NirOptions::default();
    (options.side, options.most_cubes) = (128, 12);
    let found = nir(&cell, &options, &mut pictures).unwrap();
    assert!(found.cubes >= 8 && found.set.len() > 500, "{}", found.set.len());
    assert!(found.set.len() < guided.len());
    // What pictures show, rays find: but for a few triangles that only snapping shows.
    let only_pictures = found.set.difference(&guided).len();
    assert!(only_pictures * 50 < found.set.len(), "{only_pictures} of {}", found.set.len());
}
