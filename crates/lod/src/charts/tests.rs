//! What must hold of texture coordinates on every cut, by brute force over the mesh.

use super::*;
use crate::{Observer, Tolerance};
use farsight_geometry::hard_cases;
use farsight_geometry::sampling::Random;
use glam::Vec2;

/// A ball, each face of its cube a chart with its own place in a 3 x 2 atlas, and vertices on the cube's edges once for each.
fn atlas(n: u32) -> TriangleMesh {
    let ball = hard_cases::bumpy_ball(n);
    let (mut positions, mut uvs, mut triangles) = (vec![], vec![], vec![]);
    let mut known = std::collections::HashMap::new();
    for t in ball.triangles() {
        let center: Vec3 = t.iter().map(|&v| ball.positions()[v as usize].normalize()).sum();
        let axis = center.abs().max_position();
        let face = 2 * axis + usize::from(center[axis] < 0.0);
        let corner = |&v: &u32| {
            *known.entry((face, v)).or_insert_with(|| {
                let p = ball.positions()[v as usize];
                let on_cube = p / p[axis].abs();
                let local = Vec2::new(on_cube[(axis + 1) % 3], on_cube[(axis + 2) % 3]) * 0.45 + 0.5;
                positions.push(p);
                uvs.push(
                    (local + Vec2::new((face % 3) as f32, (face / 3) as f32)) * Vec2::new(1.0 / 3.0, 0.5),
                );
                positions.len() as u32 - 1
            })
        };
        let mut each = t.iter().map(corner);
        triangles.push(std::array::from_fn(|_| each.next().unwrap()));
    }
    TriangleMesh::new(positions, triangles).unwrap().with_uvs(uvs).unwrap()
}

/// The catalogue with made-up coordinates, its triangles joined or torn apart.
fn meshes() -> Vec<(String, TriangleMesh)> {
    let mut list = vec![("atlas".to_string(), atlas(8))];
    for hard in hard_cases::meshes() {
        let m = &hard.mesh;
        let uv = |i: usize| Vec2::new((i as f32 * 0.37).fract(), (i as f32 * 0.71).fract() - 3.0);
        let made_up = (0..m.positions().len()).map(uv).collect();
        list.push((hard.name.into(), m.clone().with_uvs(made_up).unwrap()));
        let corners: Vec<Vec3> = m.corner_iter().flatten().collect();
        let triangles = (0..m.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let uvs = (0..corners.len()).map(uv).collect();
        let torn = TriangleMesh::new(corners, triangles).unwrap().with_uvs(uvs).unwrap();
        list.push((format!("{}, torn", hard.name), torn));
    }
    list
}

fn eyes(mesh: &TriangleMesh, count: u32, random: &mut Random) -> Vec<DVec3> {
    let b = mesh.bounds();
    let size = f64::from(b.diagonal()).max(1e-30);
    let mut at = |_| {
        let v = DVec3::from_array(random.units()) * 2.0 - 1.0;
        b.center().as_dvec3() + v * size * (6.0 * random.unit() - 2.0).exp2()
    };
    (0..count).map(&mut at).collect()
}

/// Charts by flooding from vertex to vertex, slowly.
fn flooded(mesh: &TriangleMesh) -> Vec<u32> {
    let mut chart: Vec<u32> = (0..mesh.positions().len() as u32).collect();
    let whole = |t: &&[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    loop {
        let before = chart.clone();
        for t in mesh.triangles().iter().filter(whole) {
            let least = t.iter().map(|&v| chart[v as usize]).min().unwrap();
            t.iter().for_each(|&v| chart[v as usize] = least);
        }
        if chart == before {
            return chart;
        }
    }
}

#[test]
fn drawn_triangles_are_where_they_were_and_stay_in_their_charts() {
    let mut random = Random::new(61);
    let (mut looked, mut extra) = (0, 0);
    for (name, mesh) in meshes() {
        let Ok(textured) = VertexHierarchy::build_textured(&mesh) else { continue };
        let plain = VertexHierarchy::build(&mesh).unwrap();
        let extended = textured.with_seam_vertices(&mesh).unwrap();
        let (charts, count) = (flooded(&mesh), mesh.positions().len() as u32);
        let chart_of = |v: u32| match v.checked_sub(count) {
            None => charts[v as usize],
            Some(i) => {
                let s = &textured.seam_vertices()[i as usize];
                assert!((s.weights.element_sum() - 1.0).abs() < 1e-6 && s.weights.min_element() >= 0.0);
                charts[mesh.triangles()[s.triangle as usize][0] as usize]
            }
        };
        extra += textured.seam_vertices().len();
        let (mut a, mut b) = (Cut::new(&textured), Cut::new(&plain));
        for eye in eyes(&mesh, 12, &mut random) {
            let (observer, tolerance) = (Observer::in_object(eye), Tolerance::uniform(0.1));
            a.update_kinetic(&textured, &observer, &tolerance).unwrap();
            b.update_kinetic(&plain, &observer, &tolerance).unwrap();
            assert!(a.originals(&textured).eq(b.originals(&plain)), "{name}");
            for ((t, u), original) in a.triangles().iter().zip(b.triangles()).zip(a.originals(&textured)) {
                let places = t.map(|v| extended.positions()[v as usize]);
                assert_eq!(places, u.map(|v| mesh.positions()[v as usize]), "{name}");
                assert_eq!(t.map(|v| textured.place_of(v)).map(|v| mesh.positions()[v as usize]), places);
                let chart = charts[mesh.triangles()[original as usize][0] as usize];
                assert_eq!(t.map(chart_of), [chart; 3], "{name}");
                looked += 1;
            }
        }
    }
    println!("{looked} triangles, {extra} extra vertices");
    assert!(looked > 20_000 && extra > 500);
}

#[test]
fn extra_vertices_look_like_the_nearest_point_of_their_chart() {
    for (name, mesh) in meshes() {
        let Ok(h) = VertexHierarchy::build_textured(&mesh) else { continue };
        let c = h.charts.as_ref().unwrap();
        let charts = flooded(&mesh);
        for node in 0..h.nodes.len() as u32 {
            for &[chart, stands] in
                &c.entries[c.first[node as usize] as usize..c.first[node as usize + 1] as usize]
            {
                let inside: Vec<u32> = h.vertices_of(node).map(|v| h.vertices[v]).collect();
                let touching = mesh.triangles().iter().filter(|t| {
                    t.iter().any(|v| inside.contains(v))
                        && charts[t[0] as usize] == charts[chart as usize]
                        && t[0] != t[1]
                        && t[1] != t[2]
                        && t[2] != t[0]
                });
                let place = h.position(node);
                let least = touching
                    .map(|t| closest_on_triangle(t.map(|v| mesh.positions()[v as usize].as_dvec3()), place))
                    .map(|q| q.distance(place))
                    .fold(f64::INFINITY, f64::min);
                let found = match stands.checked_sub(c.own) {
                    None => mesh.positions()[stands as usize].as_dvec3(),
                    Some(i) => {
                        let s = c.extra[i as usize];
                        let p = mesh.corners(s.triangle as usize).map(|p| p.as_dvec3());
                        let w = s.weights.as_dvec3();
                        p[0] * w.x + p[1] * w.y + p[2] * w.z
                    }
                };
                let size = f64::from(mesh.bounds().diagonal()) + place.length();
                assert!((found.distance(place) - least).abs() <= 1e-5 * size, "{name}, node {node}");
            }
        }
    }
}

#[test]
fn texture_drift_is_never_larger_than_claimed() {
    let mut random = Random::new(62);
    let (mut tried, mut tightest) = (0, 0.0f64);
    for (name, mesh) in meshes() {
        let Ok(h) = VertexHierarchy::build_textured(&mesh) else { continue };
        let extended = h.with_seam_vertices(&mesh).unwrap();
        let mut cut = Cut::new(&h);
        for eye in eyes(&mesh, 12, &mut random) {
            cut.update(&h, &Observer::in_object(eye), &Tolerance::uniform(0.1)).unwrap();
            let claimed = cut.texture_drift(&h).value;
            let uv = |m: &TriangleMesh, v: u32| m.uvs().unwrap()[v as usize].as_dvec2();
            let mut most = 0.0f64;
            for (t, original) in cut.triangles().iter().zip(cut.originals(&h)) {
                let w: [f64; 3] = random.units();
                let w = w.map(|x| x / w.iter().sum::<f64>());
                let own = mesh.triangles()[original as usize];
                let at = |m: &TriangleMesh, t: [u32; 3]| {
                    uv(m, t[0]) * w[0] + uv(m, t[1]) * w[1] + uv(m, t[2]) * w[2]
                };
                let corner = random.below(3) as usize;
                most = most.max(at(&extended, *t).distance(at(&mesh, own)));
                most = most.max(uv(&extended, t[corner]).distance(uv(&mesh, own[corner])));
                tried += 1;
            }
            assert!(most <= claimed, "{name}: {most} {claimed}");
            if claimed > 0.0 {
                tightest = tightest.max(most / claimed);
            }
        }
    }
    println!("{tried} points, tightest {tightest:.3}");
    assert!(tried > 20_000 && tightest > 0.9);
}

/// A hilly sheet in four charts, texture coordinates its shadow on the ground: nowhere stretched by more than their scale.
#[test]
fn drift_of_a_sheet_is_at_most_its_diameter_times_the_stretch() {
    let (n, stretch) = (32u32, 0.01f64);
    let (mut positions, mut uvs, mut triangles) = (vec![], vec![], vec![]);
    for chart in 0..4u32 {
        let base = positions.len() as u32;
        let (ox, oy) = (chart % 2 * n, chart / 2 * n);
        for i in 0..(n + 1) * (n + 1) {
            let (x, y) = ((ox + i % (n + 1)) as f32, (oy + i / (n + 1)) as f32);
            positions.push(Vec3::new(x, y, 2.0 * (0.4 * x).sin() * (0.3 * y).cos()));
            uvs.push(Vec2::new(x, y) * stretch as f32 + chart as f32 * 7.0);
        }
        let square = |i: u32| {
            let a = base + i / n * (n + 1) + i % n;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        };
        triangles.extend((0..n * n).flat_map(square));
    }
    let mesh = TriangleMesh::new(positions, triangles).unwrap().with_uvs(uvs).unwrap();
    let h = VertexHierarchy::build_textured(&mesh).unwrap();
    let drift = &h.charts.as_ref().unwrap().drift;
    let mut tightest = 0.0f64;
    for (node, &drift) in h.nodes.iter().zip(drift) {
        // Of the node's sphere around what stands for it; the nearest point of a chart lies in it too.
        let bound = 2.0 * f64::from(node.radius) * stretch;
        assert!(f64::from(drift) <= bound * 1.001 + 1e-4, "{drift} {bound}");
        tightest = tightest.max(f64::from(drift) / bound);
    }
    assert!(tightest > 0.4, "{tightest}");
}

#[test]
fn without_texture_coordinates_there_are_no_charts() {
    let mesh = hard_cases::bumpy_ball(3);
    assert_eq!(VertexHierarchy::build_textured(&mesh).unwrap_err(), LodError::NoUvs);
    let h = VertexHierarchy::build(&mesh).unwrap();
    assert!(h.seam_vertices().is_empty() && Cut::new(&h).texture_drift(&h).value == 0.0);
    assert_eq!(h.with_seam_vertices(&mesh).unwrap().positions(), mesh.positions());
}
