//! What must hold of every cut, by brute force over the tree.

use crate::*;
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, TriangleMesh, hard_cases};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use std::collections::BTreeSet;

/// What stands for a vertex: the highest folded node that holds it (its number), or the vertex itself (after all nodes'), and its place.
fn proxy_of(h: &VertexHierarchy, cut: &Cut, vertex: u32) -> (u32, u32) {
    let holds = |n: &u32| h.vertices_of(*n).contains(&(vertex as usize));
    // Higher nodes have smaller numbers.
    match (0..h.nodes.len() as u32).find(|n| holds(n) && !cut.is_unfolded(*n)) {
        Some(n) => (n, h.nodes[n as usize].representative),
        None => (h.nodes.len() as u32 + vertex, vertex),
    }
}

fn rotated(t: [u32; 3]) -> [u32; 3] {
    let k = (0..3).min_by_key(|&k| t[k]).unwrap_or(0);
    [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]
}

fn drawn(cut: &Cut, h: &VertexHierarchy) -> BTreeSet<(u32, [u32; 3])> {
    cut.originals(h).zip(cut.triangles()).map(|(o, &t)| (o, rotated(t))).collect()
}

/// Invariants 1 to 3 of a cut.
fn check(h: &VertexHierarchy, cut: &Cut, what: &str) {
    let proxies: Vec<(u32, u32)> = (0..h.vertices.len() as u32).map(|v| proxy_of(h, cut, v)).collect();
    let mut expected = BTreeSet::new();
    for (t, corners) in h.triangles.iter().enumerate() {
        let p = corners.map(|l| proxies[l as usize]);
        if p[0] != p[1] && p[1] != p[2] && p[2] != p[0] {
            let vertex = p.map(|(_, place)| h.vertices[place as usize]);
            expected.insert((h.original[t], rotated(vertex)));
        }
    }
    assert_eq!(drawn(cut, h), expected, "{what}");
    assert_eq!(cut.triangles().len(), expected.len(), "{what}: no triangle twice");
    for n in 1..h.nodes.len() as u32 {
        let above = h.nodes[n as usize].parent;
        assert!(!cut.is_unfolded(n) || cut.is_unfolded(above), "{what}: node {n}");
    }
}

fn meshes() -> Vec<(String, TriangleMesh)> {
    let mut all: Vec<(String, TriangleMesh)> =
        hard_cases::meshes().into_iter().map(|m| (m.name.to_string(), m.mesh)).collect();
    all.push(("ball".into(), hard_cases::bumpy_ball(6)));
    all
}

fn observers(mesh: &TriangleMesh, random: &mut Random, count: usize) -> Vec<DVec3> {
    let b = mesh.bounds();
    let (center, size) = (b.center().as_dvec3(), f64::from(b.diagonal()).max(1e-30));
    let mut at = |_| {
        let v = DVec3::from_array(random.units()) * 2.0 - 1.0;
        center + v * size * (8.0 * random.unit() - 4.0).exp2()
    };
    (0..count).map(&mut at).collect()
}

#[test]
fn every_cut_is_what_brute_force_says_and_does_not_depend_on_the_past() {
    let mut random = Random::new(1);
    for (name, mesh) in meshes() {
        let Ok(h) = VertexHierarchy::build(&mesh) else {
            assert!(mesh.triangles().iter().all(|t| t[0] == t[1] || t[1] == t[2] || t[2] == t[0]), "{name}");
            continue;
        };
        let (mut cut, mut kinetic) = (Cut::new(&h), Cut::new(&h));
        check(&h, &cut, &name);
        assert!(cut.is_point() && cut.triangles().is_empty());
        let tolerance = Tolerance { silhouette: 0.02, back: 0.3, ..Tolerance::uniform(0.08) };
        for (i, eye) in observers(&mesh, &mut random, 12).into_iter().enumerate() {
            let observer = Observer::in_object(eye);
            cut.update(&h, &observer, &tolerance).unwrap();
            kinetic.update_kinetic(&h, &observer, &tolerance).unwrap();
            let mut fresh = Cut::new(&h);
            fresh.update(&h, &observer, &tolerance).unwrap();
            let what = format!("{name}, eye {i}");
            if h.nodes.len() < 3000 {
                check(&h, &cut, &what);
            }
            assert_eq!(drawn(&cut, &h), drawn(&fresh, &h), "{what}");
            assert_eq!(drawn(&kinetic, &h), drawn(&fresh, &h), "{what}, kinetic");
        }
    }
}

#[test]
fn a_moving_eye_finds_the_same_cut_with_few_tests() {
    let mesh = hard_cases::bumpy_ball(40);
    let h = VertexHierarchy::build(&mesh).unwrap();
    for (tolerance, factor) in [
        (Tolerance::uniform(0.01), 30),
        (Tolerance { silhouette: 0.005, back: 0.04, ..Tolerance::uniform(0.01) }, 4),
    ] {
        let (mut kinetic, mut whole) = (Cut::new(&h), Cut::new(&h));
        let (mut few, mut many) = (0, 0);
        for i in 0..200 {
            let (sin, cos) = (f64::from(i) * 0.5f64.to_radians()).sin_cos();
            let observer = Observer::in_object(DVec3::new(4.0 * cos, 4.0 * sin, 0.5 + 0.002 * f64::from(i)));
            let k = kinetic.update_kinetic(&h, &observer, &tolerance).unwrap();
            let w = whole.update(&h, &observer, &tolerance).unwrap();
            if i > 0 {
                (few, many) = (few + k.tested, many + w.tested);
            }
            assert_eq!(kinetic.unfolded_nodes(), whole.unfolded_nodes(), "frame {i}");
        }
        assert!(few * factor <= many, "{few} of {many}");
        assert_eq!(drawn(&kinetic, &h), drawn(&whole, &h));
    }
}

#[test]
fn fully_unfolded_is_the_mesh_and_budgets_hold() {
    for (name, mesh) in meshes() {
        let Ok(h) = VertexHierarchy::build(&mesh) else { continue };
        let observer = Observer::in_object(mesh.bounds().center().as_dvec3() + DVec3::splat(3e-3));
        let mut cut = Cut::new(&h);
        let left = cut.update_budget(&h, &observer, usize::MAX);
        // Vertices in one place stay folded: nothing moves.
        assert_eq!(left, 0.0, "{name}");
        let moved = |t: [u32; 3]| t.map(|v| mesh.positions()[v as usize].to_array().map(f32::to_bits));
        let input: BTreeSet<_> = (0..mesh.triangles().len() as u32)
            .map(|i| (i, moved(mesh.triangles()[i as usize])))
            .filter(|(_, p)| p[0] != p[1] && p[1] != p[2] && p[2] != p[0])
            .collect();
        let output: BTreeSet<_> =
            cut.originals(&h).zip(cut.triangles()).map(|(o, &t)| (o, moved(t))).collect();
        assert!(input.is_subset(&output), "{name}");
        for budget in [0, 1, 7, h.triangle_count() / 3, h.triangle_count()] {
            cut.update_budget(&h, &observer, budget);
            assert!(cut.triangles().len() <= budget, "{name}");
            if h.nodes.len() < 3000 {
                check(&h, &cut, &name);
            }
        }
    }
}

#[test]
fn nodes_hold_what_they_claim_to_hold() {
    for (name, mesh) in meshes() {
        let Ok(h) = VertexHierarchy::build(&mesh) else { continue };
        for n in 0..h.nodes.len() as u32 {
            let node = &h.nodes[n as usize];
            let center = h.position(n);
            for v in h.vertices_of(n) {
                let d = h.positions[v].as_dvec3().distance(center);
                assert!(d <= f64::from(node.radius), "{name}, node {n}: {d:e} {:e}", node.radius);
            }
            if h.nodes.len() > 3000 {
                continue;
            }
            let touching =
                h.triangles.iter().filter(|t| t.iter().any(|&l| h.vertices_of(n).contains(&(l as usize))));
            for t in touching {
                let p = t.map(|l| h.positions[l as usize].as_dvec3());
                for q in p {
                    assert!(q.distance(center) <= f64::from(node.reach), "{name}, node {n}");
                }
                let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
                let axis = node.cone_axis.as_dvec3();
                if normal != DVec3::ZERO && axis != DVec3::ZERO {
                    let angle = axis.cross(normal).length().atan2(axis.dot(normal));
                    assert!(angle <= f64::from(node.cone_angle), "{name}, node {n}: {angle}");
                }
            }
        }
    }
}

#[test]
fn no_point_moves_farther_than_promised() {
    let mut random = Random::new(7);
    let (mut tried, mut most) = (0, 0.0f64);
    for (name, mesh) in meshes() {
        let Ok(h) = VertexHierarchy::build(&mesh) else { continue };
        let mut cut = Cut::new(&h);
        for eye in observers(&mesh, &mut random, 20) {
            let tau = (-8.0 * random.unit()).exp2();
            cut.update(&h, &Observer::in_object(eye), &Tolerance::uniform(tau)).unwrap();
            for _ in 0..100 {
                let t = random.below(h.triangles.len() as u64) as usize;
                let (a, b) = (random.unit(), random.unit());
                let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
                let mix = |p: [DVec3; 3]| p[0] + (p[1] - p[0]) * a + (p[2] - p[0]) * b;
                let own = h.triangles[t].map(|l| h.positions[l as usize].as_dvec3());
                let now = h.triangles[t].map(|l| place_of(&h, &cut, l as usize));
                let (p, q) = (mix(own), mix(now));
                let share = p.distance(q) / (tau * p.distance(eye));
                assert!(p.distance(q) <= tau * p.distance(eye) * (1.0 + 1e-9), "{name}: {share}");
                tried += 1;
                most = most.max(if share.is_finite() { share } else { 0.0 });
            }
        }
    }
    println!("{tried} points, largest displacement {most:.3} of what is tolerated");
    assert!(tried > 10_000 && most > 0.3);
}

/// Where what stands for a vertex is, found by descending.
pub(crate) fn place_of(h: &VertexHierarchy, cut: &Cut, vertex: usize) -> DVec3 {
    let mut node = 0;
    while cut.is_unfolded(node) {
        match h.children(node).find(|&c| h.vertices_of(c).contains(&vertex)) {
            Some(child) => node = child,
            None => return h.positions[vertex].as_dvec3(),
        }
    }
    h.position(node)
}

#[test]
fn pixels_on_the_image_stay_within_the_tolerance() {
    let mesh = hard_cases::bumpy_ball(24);
    let h = VertexHierarchy::build(&mesh).unwrap();
    let mut random = Random::new(23);
    let mut most = 0.0f64;
    for round in 0..60 {
        let eye = (DVec3::from_array(random.units()) * 2.0 - 1.0).normalize() * (1.3 + 6.0 * random.unit());
        // Looking past the ball as well as at it.
        let target = DVec3::from_array(random.units()) * 2.0 - 1.0;
        let camera = Camera::look_at(eye, target, DVec3::Z).and_then(|c| c.with_image(1280, 720)).unwrap();
        let px = [0.5, 2.0, 8.0, 40.0][round % 4];
        let mut cut = Cut::new(&h);
        let tolerance = Tolerance::pixels(px, &camera).unwrap();
        cut.update(&h, &Observer::in_object(eye), &tolerance).unwrap();
        for (leaf, p) in h.positions.iter().enumerate() {
            let q = place_of(&h, &cut, leaf);
            let (Some((a, _)), Some((b, _))) = (camera.project(p.as_dvec3()), camera.project(q)) else {
                continue;
            };
            let inside = a.x >= 0.0 && a.y >= 0.0 && a.x <= 1280.0 && a.y <= 720.0;
            if inside {
                most = most.max(a.distance(b) / px);
                assert!(a.distance(b) <= px, "round {round}: {} of {px}", a.distance(b));
            }
        }
    }
    println!("largest displacement {most:.3} of what is tolerated");
    assert!(most > 0.4);
}

#[test]
fn the_order_of_vertices_does_not_matter() {
    let mesh = hard_cases::bumpy_ball(9);
    let n = mesh.positions().len() as u32;
    // A stride without a common divisor visits each once.
    let stride = (n / 2..n).find(|s| gcd(*s, n) == 1).unwrap();
    let old_of = |new: u32| (u64::from(new) * u64::from(stride) % u64::from(n)) as u32;
    let mut new_of = vec![0; n as usize];
    (0..n).for_each(|new| new_of[old_of(new) as usize] = new);
    let positions = (0..n).map(|new| mesh.positions()[old_of(new) as usize]).collect();
    let triangles = mesh.triangles().iter().map(|t| t.map(|v| new_of[v as usize])).collect();
    let other = TriangleMesh::new(positions, triangles).unwrap();
    let places = |mesh: &TriangleMesh| {
        let h = VertexHierarchy::build(mesh).unwrap();
        let mut cut = Cut::new(&h);
        cut.update(&h, &Observer::in_object(DVec3::new(3.0, 1.0, 2.0)), &Tolerance::uniform(0.05)).unwrap();
        let bits = |p: Vec3| p.to_array().map(f32::to_bits);
        let corners = |t: &[u32; 3]| rotate_to_least(t.map(|v| bits(mesh.positions()[v as usize])));
        cut.triangles().iter().map(corners).collect::<BTreeSet<_>>()
    };
    assert_eq!(places(&mesh), places(&other));
}

fn rotate_to_least(t: [[u32; 3]; 3]) -> [[u32; 3]; 3] {
    let k = (0..3).min_by_key(|&k| t[k]).unwrap_or(0);
    [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[test]
fn stretched_objects_keep_the_promise_in_the_world() {
    let mesh = hard_cases::bumpy_ball(12);
    let h = VertexHierarchy::build(&mesh).unwrap();
    let mut random = Random::new(5);
    let (mut cut, mut kinetic) = (Cut::new(&h), Cut::new(&h));
    for _ in 0..40 {
        let scale = DVec3::from_array(random.units()) * 4.0 + 0.1;
        let turn = DQuat::from_rotation_x(6.0 * random.unit()) * DQuat::from_rotation_z(6.0 * random.unit());
        let place = DAffine3::from_scale_rotation_translation(scale, turn, DVec3::new(5e5, 4e6, 30.0));
        let eye = place.translation + (DVec3::from_array(random.units()) * 2.0 - 1.0) * 20.0;
        let observer = Observer::new(eye, &place, mesh.origin()).unwrap();
        let tau = 0.03;
        cut.update(&h, &observer, &Tolerance::uniform(tau)).unwrap();
        kinetic.update_kinetic(&h, &observer, &Tolerance::uniform(tau)).unwrap();
        assert_eq!(drawn(&kinetic, &h), drawn(&cut, &h));
        for (leaf, &p) in h.positions.iter().enumerate() {
            let q = place_of(&h, &cut, leaf);
            let [p, q] = [p.as_dvec3(), q].map(|x| place.transform_point3(mesh.origin() + x));
            assert!(p.distance(q) <= tau * p.distance(eye) * (1.0 + 1e-6));
        }
    }
}

#[test]
fn a_stretched_object_that_turns_is_followed_with_few_tests() {
    let mesh = hard_cases::bumpy_ball(30);
    let h = VertexHierarchy::build(&mesh).unwrap();
    let (mut kinetic, mut whole) = (Cut::new(&h), Cut::new(&h));
    let (mut few, mut many) = (0, 0);
    for i in 0..150 {
        let scale = DVec3::new(1.0, 0.4, 2.0);
        let turn = DQuat::from_rotation_y(0.3 + 0.005 * f64::from(i)) * DQuat::from_rotation_x(0.7);
        let place = DAffine3::from_scale_rotation_translation(scale, turn, DVec3::new(50.0, -3.0, 7.0));
        let eye = DVec3::new(58.0, -3.0, 7.0);
        let observer = Observer::new(eye, &place, mesh.origin()).unwrap();
        let k = kinetic.update_kinetic(&h, &observer, &Tolerance::uniform(0.01)).unwrap();
        let w = whole.update(&h, &observer, &Tolerance::uniform(0.01)).unwrap();
        if i > 0 {
            (few, many) = (few + k.tested, many + w.tested);
        }
        assert_eq!(kinetic.unfolded_nodes(), whole.unfolded_nodes(), "frame {i}");
    }
    assert!(few * 8 <= many, "{few} of {many}");
}

#[test]
fn what_stands_on_the_limit_does_not_flicker() {
    let mesh = hard_cases::bumpy_ball(20);
    let h = VertexHierarchy::build(&mesh).unwrap();
    let tolerance = Tolerance { hysteresis: 0.2, ..Tolerance::uniform(0.03) };
    for kinetic in [false, true] {
        let mut cut = Cut::new(&h);
        let mut update = |x: f64| {
            let observer = Observer::in_object(DVec3::new(x, 0.0, 0.0));
            let done = if kinetic {
                cut.update_kinetic(&h, &observer, &tolerance)
            } else {
                cut.update(&h, &observer, &tolerance)
            };
            done.unwrap()
        };
        update(5.0);
        update(4.9);
        for i in 0..20 {
            let stats = update(if i % 2 == 0 { 4.95 } else { 4.9 });
            assert_eq!((stats.unfolded, stats.folded), (0, 0));
        }
    }
}

#[test]
fn changed_places_are_all_that_an_index_buffer_needs() {
    let mesh = hard_cases::bumpy_ball(16);
    let h = VertexHierarchy::build(&mesh).unwrap();
    let mut cut = Cut::new(&h);
    let mut buffer: Vec<[u32; 3]> = Vec::new();
    for i in 0..60 {
        let observer = Observer::in_object(DVec3::new(9.0 - 0.13 * f64::from(i), 0.3, 0.1));
        cut.update_kinetic(&h, &observer, &Tolerance::uniform(0.02)).unwrap();
        buffer.resize(cut.triangles().len(), [0; 3]);
        for &slot in cut.changed() {
            buffer[slot as usize] = cut.triangles()[slot as usize];
        }
        assert_eq!(buffer, cut.triangles());
    }
}

#[test]
fn bad_tolerances_are_named() {
    let h = VertexHierarchy::build(&hard_cases::bumpy_ball(3)).unwrap();
    let mut cut = Cut::new(&h);
    let observer = Observer::in_object(DVec3::splat(4.0));
    for tau in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            cut.update(&h, &observer, &Tolerance::uniform(tau)),
            Err(LodError::Tolerance { .. })
        ));
    }
    let error = cut.update_kinetic(&h, &observer, &Tolerance { back: 0.01, ..Tolerance::uniform(0.1) });
    assert!(error.unwrap_err().to_string().contains("silhouette <= tau <= back"));
}
