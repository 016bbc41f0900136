//! Scenes whose visible sets are known in closed form.

use farsight_geometry::ray::{BruteForce, Bvh8};
use farsight_geometry::{DAabb, RayCaster, TriangleMesh};
use farsight_visibility::glam::{DVec3, Vec3, dvec3};
use farsight_visibility::{Budget, Occluders, Options, Pvs, Sampler, Triangles, ViewCell};

/// Triangles collected one by one.
#[derive(Default)]
struct Soup(Vec<Vec3>);

impl Soup {
    fn triangle(&mut self, corners: [DVec3; 3]) -> u32 {
        self.0.extend(corners.map(|p| p.as_vec3()));
        self.0.len() as u32 / 3 - 1
    }

    /// A parallelogram as two triangles.
    fn quad(&mut self, corner: DVec3, u: DVec3, v: DVec3) -> [u32; 2] {
        [
            self.triangle([corner, corner + u, corner + u + v]),
            self.triangle([corner, corner + u + v, corner + v]),
        ]
    }

    fn cuboid(&mut self, b: &DAabb) {
        let corners = b.corners();
        for t in DAabb::TRIANGLES {
            self.triangle(t.map(|i| corners[i as usize]));
        }
    }

    fn mesh(self) -> TriangleMesh {
        let triangles = (0..self.0.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        TriangleMesh::new(self.0, triangles).unwrap()
    }
}

fn cell(min: DVec3, max: DVec3) -> ViewCell {
    ViewCell::from_box(&DAabb::new(min, max)).unwrap()
}

fn seen_by<C: RayCaster>(
    caster: &C,
    mesh: &TriangleMesh,
    cell: &ViewCell,
    options: Options,
    rays: u64,
) -> Pvs {
    let triangles = Triangles::of_mesh(mesh);
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(caster), cell, options).unwrap();
    sampler.run(&Budget::rays(rays));
    sampler.pvs()
}

fn seen(mesh: &TriangleMesh, cell: &ViewCell, rays: u64) -> Pvs {
    seen_by(&Bvh8::new(mesh), mesh, cell, Options::default(), rays)
}

/// A wall at x = 10 with a slit, and blades side by side at x = 20: visible is the strip
/// that lines through cell and slit reach.
#[test]
fn a_slit_shows_its_penumbra_and_nothing_else() {
    let mut soup = Soup::default();
    let far = 1000.0;
    // The slit is 1 m wide, from y = −0.5 to 0.5; the cell is 2 m wide at x from −1 to 0.
    soup.quad(dvec3(10.0, 0.5, -far), DVec3::Y * far, DVec3::Z * 2.0 * far);
    soup.quad(dvec3(10.0, -0.5 - far, -far), DVec3::Y * far, DVec3::Z * 2.0 * far);
    let cell = cell(dvec3(-1.0, -1.0, -0.25), dvec3(0.0, 1.0, 0.25));
    // Steepest through the slit, from the face at x = 0: from y = −1 past y = 0.5 at x = 10, hence y = 2 at x = 20.
    let edge = 2.0;
    let mut expected = vec![0, 1, 2, 3];
    for i in -60..60 {
        // Blades of 0.08 m by 10 m; none ends within a quarter of its width of the edge of what can be seen.
        let y = f64::from(i) * 0.1;
        let t =
            soup.triangle([dvec3(20.0, y, -5.0), dvec3(20.0, y + 0.08, -5.0), dvec3(20.0, y + 0.04, 5.0)]);
        let nearest = if y >= 0.0 { y } else { -(y + 0.08) };
        if nearest < edge - 0.02 {
            expected.push(t);
        }
    }
    let mesh = soup.mesh();
    assert_eq!(seen(&mesh, &cell, 1_500_000), Pvs::from_sorted(expected));
}

/// Descending stairs seen from above their top: each riser faces away, each tread shows from the eye's height on.
#[test]
fn of_stairs_going_down_only_treads_are_seen_until_the_line_of_sight_passes_over() {
    let mut soup = Soup::default();
    let (mut treads, mut risers) = (Vec::new(), Vec::new());
    // Step i: tread at z = −i from x = 2i to 2i + 2, riser at x = 2i + 2 down to z = −i − 1.
    for i in 0..30 {
        let (x, z) = (2.0 * f64::from(i), -f64::from(i));
        treads.push(soup.quad(dvec3(x, -50.0, z), DVec3::X * 2.0, DVec3::Y * 100.0));
        risers.push(soup.quad(dvec3(x + 2.0, -50.0, z - 1.0), DVec3::Y * 100.0, DVec3::Z));
    }
    let mesh = soup.mesh();
    let expected = |n: usize, risers_too: bool| -> Pvs {
        let mut ids: Vec<u32> = treads[..n].iter().flatten().copied().collect();
        if risers_too {
            ids.extend(risers.iter().flatten());
        }
        ids.into_iter().collect()
    };
    // Edges lie on z = −x / 2 + 1 (from (2, 0) to (60, −29)). From above that line all treads show, from below none but the first;
    // risers face away from both.
    let above = cell(dvec3(0.25, -0.5, 1.0), dvec3(0.75, 0.5, 1.5));
    assert_eq!(seen(&mesh, &above, 600_000), expected(30, false));
    let below = cell(dvec3(0.25, -0.5, 0.25), dvec3(0.75, 0.5, 0.5));
    assert_eq!(seen(&mesh, &below, 600_000), expected(1, false));
    // A cell across the line sees what its part above sees.
    let across = cell(dvec3(0.25, -0.5, 0.5), dvec3(0.75, 0.5, 1.0));
    assert_eq!(seen(&mesh, &across, 600_000), expected(30, false));
}

/// A street between closed fronts: what is behind the fronts shows only above the line of sight over them.
#[test]
fn a_canyon_hides_what_is_below_the_line_over_its_roofs() {
    let mut soup = Soup::default();
    let ground = soup.quad(dvec3(-500.0, -5.0, 0.0), DVec3::X * 1000.0, DVec3::Y * 10.0);
    let fronts = [-5.0, 5.0].map(|y| soup.quad(dvec3(-500.0, y, 0.0), DVec3::X * 1000.0, DVec3::Z * 8.0));
    // Signs at y = 15, 8 m wide, 0.15 m high, at heights by 0.2 m. The cell spans y from −1 to 1 and z from 1 to 2: the flattest line over
    // the front at y = 5, z = 8 comes from the cell's y = −1, z = 2 and is at z = 2 + 6 · 16 / 6 = 18 there.
    let mut expected: Vec<u32> = ground.into_iter().chain(fronts.into_iter().flatten()).collect();
    for i in 60..130 {
        let z = 0.2 * f64::from(i) + 0.02;
        let sign = soup.triangle([dvec3(-4.0, 15.0, z), dvec3(4.0, 15.0, z), dvec3(0.0, 15.0, z + 0.15)]);
        // The next lowest has its top 0.17 m above the line.
        if z + 0.15 > 18.05 {
            expected.push(sign);
        }
    }
    let mesh = soup.mesh();
    let cell = cell(dvec3(-0.5, -1.0, 1.0), dvec3(0.5, 1.0, 2.0));
    assert_eq!(seen(&mesh, &cell, 1_500_000), expected.into_iter().collect());
}

/// Boxes in boxes: only the innermost one around the cell is seen, from the cell inside it.
#[test]
fn of_nested_boxes_only_the_innermost_is_seen() {
    let mut soup = Soup::default();
    for i in 1..=6 {
        soup.cuboid(&DAabb::new(DVec3::splat(-f64::from(i)), DVec3::splat(f64::from(i))));
    }
    let mesh = soup.mesh();
    let within = |low: f64, high: f64| cell(DVec3::splat(low), DVec3::splat(high));
    assert_eq!(seen(&mesh, &within(-0.5, 0.5), 300_000), Pvs::from_sorted(0..12));
    // A cell through the faces of the third box at x, y, z = 3 sees that box, as it touches it, and the fourth from inside;
    // of the third all faces from inside; the second from outside on the three sides that face it.
    let across = seen(&mesh, &within(2.5, 3.5), 300_000);
    let second = across.iter().filter(|t| (12..24).contains(t)).count();
    let third = across.iter().filter(|t| (24..36).contains(t)).count();
    let fourth = across.iter().filter(|t| (36..48).contains(t)).count();
    assert_eq!((across.len() as usize, second, third, fourth), (second + third + fourth, 6, 12, 12));
}

/// A convex body seen from a convex cell outside: a face is seen when some corner of the cell lies in front of it.
#[test]
fn of_a_convex_body_exactly_the_faces_before_a_corner_of_the_cell_are_seen() {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    let (rings, sectors) = (12u32, 16u32);
    for r in 0..=rings {
        for s in 0..sectors {
            let a = std::f64::consts::PI * f64::from(r) / f64::from(rings);
            let b = std::f64::consts::TAU * (f64::from(s) + 0.3) / f64::from(sectors);
            positions.push(dvec3(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()).as_vec3() * 2.0);
        }
    }
    for r in 0..rings {
        for s in 0..sectors {
            let at = |r: u32, s: u32| r * sectors + s % sectors;
            if r > 0 {
                triangles.push([at(r, s), at(r + 1, s), at(r, s + 1)]);
            }
            if r + 1 < rings {
                triangles.push([at(r, s + 1), at(r + 1, s), at(r + 1, s + 1)]);
            }
        }
    }
    let mesh = TriangleMesh::new(positions, triangles).unwrap();
    for corner in [dvec3(3.0, 0.2, 0.4), dvec3(-1.0, -2.0, 2.5), dvec3(0.0, 0.0, -9.0)] {
        let bounds = DAabb::new(corner, corner + dvec3(0.7, 0.4, 0.6));
        let faces: Pvs = (0..mesh.triangles().len() as u32)
            .filter(|&t| {
                let [a, b, c] = mesh.corners(t as usize).map(|p| p.as_dvec3());
                let normal = (b - a).cross(c - a);
                // Facets of a polyhedron inscribed in a sphere: nothing else hides them.
                bounds.corners().iter().any(|&v| normal.dot(v - a) > 1e-9)
            })
            .collect();
        let cell = ViewCell::from_box(&bounds).unwrap();
        assert_eq!(seen(&mesh, &cell, 2_000_000), faces, "from {corner}");
    }
}

/// Two plates face to face: from between them each hides what is behind it, from beside them only the near edge shows.
#[test]
fn parallel_plates_hide_one_another() {
    let mut soup = Soup::default();
    for z in [0.0, 1.0, 2.0, 3.0] {
        soup.quad(dvec3(-5.0, -5.0, z), DVec3::X * 10.0, DVec3::Y * 10.0);
    }
    let mesh = soup.mesh();
    assert_eq!(
        seen(&mesh, &cell(dvec3(-0.5, -0.5, 1.25), dvec3(0.5, 0.5, 1.75)), 300_000),
        Pvs::from_sorted(2..6)
    );
    let above = cell(dvec3(-0.5, -0.5, 4.0), dvec3(0.5, 0.5, 4.5));
    assert_eq!(
        seen(&mesh, &above, 300_000),
        Pvs::from_sorted(6..8),
        "no line passes the edge of the top plate"
    );
    let beside = cell(dvec3(7.0, -0.5, 0.25), dvec3(7.5, 0.5, 0.75));
    assert_eq!(seen(&mesh, &beside, 600_000), Pvs::from_sorted(0..8), "one top and three undersides");
}

#[test]
fn any_caster_and_any_strategy_give_the_same_exact_set() {
    let mut soup = Soup::default();
    for i in 1..=3 {
        soup.cuboid(&DAabb::new(DVec3::splat(-f64::from(i)), DVec3::splat(f64::from(i))));
    }
    let mesh = soup.mesh();
    let cell = cell(DVec3::splat(-0.5), DVec3::splat(0.5));
    let brute = BruteForce::new(&mesh);
    for options in [Options::default(), Options::paper(), Options::random()] {
        assert_eq!(seen_by(&brute, &mesh, &cell, options, 100_000), Pvs::from_sorted(0..12));
        assert_eq!(seen_by(&Bvh8::new(&mesh), &mesh, &cell, options, 100_000), Pvs::from_sorted(0..12));
    }
}
