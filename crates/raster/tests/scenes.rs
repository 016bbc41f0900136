//! The generators: the same every time, well formed, as large as they say.

use farsight_geometry::glam::DVec3;
use farsight_geometry::{Camera, Scene};
use farsight_raster::scenes::{City, Cubes, Forest, Path, Rooms, StreetCanyon, StreetPoints, Terrain};
use farsight_raster::{Outputs, RasterError, Rasteriser, RenderOptions, render_scene};

type Build = fn(u64) -> Result<Scene, RasterError>;

fn small() -> Vec<(&'static str, Build)> {
    vec![
        ("city", |seed| {
            let mut s = City::small();
            s.seed = seed;
            s.build()
        }),
        ("canyon", |seed| {
            let mut s = StreetCanyon::default();
            (s.seed, s.length) = (seed, 40.0);
            s.build()
        }),
        ("terrain", |seed| {
            let mut s = Terrain::default();
            (s.seed, s.points) = (seed, 2000);
            s.build()
        }),
        ("forest", |seed| {
            let mut s = Forest::default();
            (s.seed, s.trees, s.leaves) = (seed, 9, 200);
            s.build()
        }),
        ("rooms", |seed| {
            let mut s = Rooms::default();
            (s.seed, s.rooms) = (seed, [3, 2]);
            s.build()
        }),
        ("cubes", |seed| {
            let mut s = Cubes::default();
            (s.seed, s.count) = (seed, 50);
            s.build()
        }),
    ]
}

#[test]
fn the_seed_decides_everything() {
    for (name, build) in small() {
        let scene = build(1).unwrap();
        assert_eq!(scene, build(1).unwrap(), "{name}");
        assert_ne!(scene, build(2).unwrap(), "{name}");
        assert!(!scene.lights().is_empty() && scene.placed_triangles() > 100, "{name}");
    }
}

#[test]
fn meshes_are_well_formed() {
    for (name, build) in small() {
        let scene = build(1).unwrap();
        for (i, mesh) in scene.meshes().iter().enumerate() {
            let report = mesh.report();
            assert_eq!(report.zero_area, 0, "{name}, mesh {i}: {report:?}");
            let normals = mesh.normals().unwrap();
            assert!(normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{name}, mesh {i}");
            // Normals are on the side from which the corners appear counter-clockwise.
            let wrong = mesh.triangles().iter().zip(mesh.corner_iter()).filter(|(t, [a, b, c])| {
                (*b - *a)
                    .cross(*c - *a)
                    .dot(normals[t[0] as usize] + normals[t[1] as usize] + normals[t[2] as usize])
                    < 0.0
            });
            assert_eq!(wrong.count(), 0, "{name}, mesh {i}");
        }
    }
}

#[test]
fn the_default_city_is_as_large_as_promised() {
    let city = City::default();
    let scene = city.build().unwrap();
    let extent = scene.bounds().extent();
    assert!((extent.x - 317.0).abs() < 0.5 && (extent.y - 317.0).abs() < 0.5, "{extent}");
    assert!((7.5..=9.0).contains(&extent.z), "{extent}");
    let triangles = scene.placed_triangles();
    assert!((1_350_000..1_500_000).contains(&triangles), "{triangles}");
    assert!(scene.instances().len() >= 570, "{}", scene.instances().len());
}

#[test]
fn a_repeated_city_has_a_hundred_million_triangles_and_one_towns_memory() {
    let mut city = City::default();
    let once = city.build().unwrap();
    city.repeat = 9;
    let scene = city.build().unwrap();
    assert!(scene.placed_triangles() > 100_000_000);
    assert_eq!(scene.stored_triangles(), once.stored_triangles());
}

#[test]
fn nothing_of_the_city_can_be_seen_from_behind() {
    // Every pixel of a walk shows front faces only: with culling off nothing else appears.
    let city = City::small();
    let scene = city.build().unwrap();
    let mut open = Scene::new();
    for mesh in scene.meshes() {
        open.add_mesh(mesh.clone());
    }
    for instance in scene.instances() {
        // Without material: two-sided.
        open.add_instance(farsight_geometry::scene::Instance { material: None, ..instance.clone() }).unwrap();
    }
    let mut options = RenderOptions::default();
    options.outputs = Outputs::DEPTH_ID;
    let mut rasteriser = Rasteriser::new();
    let (mut differ, mut seen) = (0, 0);
    for path in [Path::street_walk(&city), Path::turn(&city), Path::rise(&city)] {
        for frame in 0..6 {
            let camera = path.camera(frame, 6).unwrap().with_image(320, 180).unwrap();
            let (a, _) = render_scene(&mut rasteriser, &scene, &camera, &options).unwrap();
            let (b, _) = render_scene(&mut rasteriser, &open, &camera, &options).unwrap();
            seen += a.ids().filter(|&id| id != 0).count();
            differ += a.ids().zip(b.ids()).filter(|(p, q)| p != q).count();
        }
    }
    assert!(seen > 300_000);
    // Where two solids touch, a hidden back and a front lie at the same place and rounding may choose either.
    assert!((differ as f64) < 5e-4 * seen as f64, "{differ} of {seen}");
}

#[test]
fn terrain_tiles_fill_the_square_without_gaps() {
    let mut terrain = Terrain::default();
    (terrain.points, terrain.tiles) = (3000, 3);
    let scene = terrain.build().unwrap();
    assert_eq!(scene.instances().len(), 9);
    // The footprint's area is the square's, so nothing overlaps or is missing.
    let footprint = |c: [farsight_geometry::glam::Vec3; 3]| {
        let [a, b, c] = c.map(|p| p.as_dvec3().truncate());
        0.5 * (b - a).perp_dot(c - a)
    };
    let area: f64 =
        scene.meshes().iter().flat_map(|m| m.corner_iter().collect::<Vec<_>>()).map(footprint).sum();
    assert!((area / (terrain.side * terrain.side) - 1.0).abs() < 1e-6, "{area}");
    assert!(
        scene.meshes().iter().flat_map(|m| m.corner_iter().collect::<Vec<_>>()).all(|c| footprint(c) > 0.0)
    );
    // Heights are those of the field.
    for p in scene.meshes()[4].positions() {
        let truth = terrain.height(f64::from(p.x), f64::from(p.y));
        assert!((f64::from(p.z) - truth).abs() < 0.05);
    }
}

#[test]
fn every_room_can_be_reached() {
    for seed in 0..20 {
        let mut rooms = Rooms::default();
        (rooms.seed, rooms.extra_doors, rooms.furniture) = (seed, 0.0, false);
        let scene = rooms.build().unwrap();
        // A wall without an opening is one solid of 12 triangles; with a door it has three.
        let [nx, ny] = rooms.rooms;
        let doors = scene.instances().iter().filter(|i| {
            let parts: Vec<&str> = i.name.split(' ').collect();
            let inner = |axis: &str, x: u32, y: u32| match axis {
                "x" => y > 0 && y < ny,
                _ => x > 0 && x < nx,
            };
            parts[0] == "wall"
                && inner(parts[1], parts[2].parse().unwrap(), parts[3].parse().unwrap())
                && scene.mesh_of(i).triangles().len() == 36
        });
        // A spanning tree of all rooms and nothing else.
        assert_eq!(doors.count() as u32, nx * ny - 1);
    }
}

#[test]
fn scan_points_thin_out_with_the_square_of_the_distance() {
    let mut street = StreetPoints::default();
    (street.count, street.length, street.station_spacing, street.noise) = (400_000, 15.0, 20.0, 0.0);
    // One station at x = 0: count ground points in rings around it (the road is 10 m wide, so look along it).
    let scanner = street.offset + DVec3::new(0.0, 0.4, 1.9);
    let density = |from: f64, to: f64| {
        let inside = |p: DVec3| {
            let d = p - scanner;
            (d.x > from && d.x < to && d.y.abs() < 1.0 && d.z < -1.8).then_some(())
        };
        let n = street.points().unwrap().filter_map(|p| inside(p.position)).count();
        n as f64 / (2.0 * (to - from))
    };
    // On the ground the density is proportional to height / r³.
    let (near, far) = (density(3.0, 3.5), density(6.0, 7.0));
    let expected = (6.5f64.hypot(1.9) / 3.25f64.hypot(1.9)).powi(3);
    assert!((near / far / expected - 1.0).abs() < 0.15, "{near} {far} {expected}");
    let again: Vec<_> = street.points().unwrap().take(100).collect();
    assert_eq!(again, street.points().unwrap().take(100).collect::<Vec<_>>());
    assert_eq!(street.points().unwrap().count(), 400_000);
}

#[test]
fn options_out_of_range_are_named() {
    let mut city = City::default();
    city.blocks = 0;
    assert!(city.build().unwrap_err().to_string().contains("blocks is 0"));
    let mut terrain = Terrain::default();
    terrain.side = f64::NAN;
    assert!(matches!(terrain.build(), Err(RasterError::Option { option: "side", .. })));
    let mut cubes = Cubes::default();
    cubes.edge = [2.0, 1.0];
    assert!(cubes.build().is_err());
    let mut street = StreetPoints::default();
    street.offset = DVec3::NAN;
    assert!(street.points().is_err());
    assert!(Path::through(vec![]).is_err());
}

#[test]
fn paths_stay_outside_the_houses_and_end_where_they_should() {
    let city = City::small();
    let scene = city.build().unwrap();
    let bounds = scene.instance_bounds();
    for path in [Path::street_walk(&city), Path::turn(&city), Path::rise(&city)] {
        for frame in 0..40 {
            let camera: Camera = path.camera(frame, 40).unwrap();
            let inside = scene
                .instances()
                .iter()
                .zip(&bounds)
                .find(|(i, b)| !i.name.starts_with("ground") && b.inflated(0.3).contains(camera.eye()));
            assert!(inside.is_none(), "frame {frame} at {} in {:?}", camera.eye(), inside.map(|i| &i.0.name));
        }
    }
    let path = Path::through(vec![(DVec3::ZERO, DVec3::X), (DVec3::Y, DVec3::X)]).unwrap();
    assert_eq!(path.at(0.0).0, DVec3::ZERO);
    assert_eq!(path.at(1.0).0, DVec3::Y);
    assert_eq!(path.camera(7, 1).unwrap().eye(), DVec3::ZERO);
}

#[test]
fn the_small_city_is_small() {
    let triangles = City::small().build().unwrap().placed_triangles();
    assert!((90_000..105_000).contains(&triangles), "{triangles}");
}
