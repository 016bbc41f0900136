use super::*;
use farsight_geometry::hard_cases::bumpy_ball;
use farsight_geometry::ray::Bvh8;
use farsight_geometry::sampling::Random;
use farsight_geometry::{DAabb, Ray, RayCaster};
use glam::{Vec3, dvec3};

fn vector(random: &mut Random) -> DVec3 {
    DVec3::from_array(random.units()) * 2.0 - 1.0
}

fn lights(random: &mut Random) -> [Shape; 3] {
    let center = dvec3(0.0, 0.0, 4.0) + vector(random);
    let radius = 0.05 + random.unit();
    let normal = (vector(random) - DVec3::Z).normalize();
    let (u, v) = normal.any_orthonormal_pair();
    [
        Shape::Sphere { center, radius },
        Shape::Disk { center, normal, radius },
        Shape::Rectangle { center, half_u: u * radius, half_v: v * (0.1 + random.unit()) },
    ]
}

/// A point of the light that can be seen from `from`: the sphere's points are those of the disk its outline spans.
fn light_point(light: &Shape, from: DVec3, [s, t]: [f64; 2]) -> DVec3 {
    let polar = |u: DVec3, v: DVec3, r: f64| {
        let (sin, cos) = (std::f64::consts::TAU * t).sin_cos();
        (u * cos + v * sin) * (r * s.sqrt())
    };
    match *light {
        Shape::Sphere { center, radius } => {
            let axis = center - from;
            let d_sq = axis.length_squared();
            // Centre and radius of the circle in which the tangent cone touches.
            let at = center - axis * (radius * radius / d_sq);
            let (u, v) = axis.normalize().any_orthonormal_pair();
            at + polar(u, v, radius * (1.0 - radius * radius / d_sq).max(0.0).sqrt())
        }
        Shape::Disk { center, normal, radius } => {
            let (u, v) = normal.any_orthonormal_pair();
            center + polar(u, v, radius)
        }
        Shape::Rectangle { center, half_u, half_v } => {
            center + half_u * (2.0 * s - 1.0) + half_v * (2.0 * t - 1.0)
        }
    }
}

/// Share of `n`² points of the light that are seen.
fn visibility(caster: &Bvh8, light: &Shape, point: DVec3, n: u32, random: &mut Random) -> f64 {
    let mut seen = 0;
    for i in 0..n * n {
        let jitter = [random.unit(), random.unit()];
        let uv =
            [(f64::from(i % n) + jitter[0]) / f64::from(n), (f64::from(i / n) + jitter[1]) / f64::from(n)];
        let to = light_point(light, point, uv) - point;
        let ray = Ray::new(point, to).unwrap().with_range(1e-9, to.length());
        seen += u32::from(!caster.occluded(&ray));
    }
    f64::from(seen) / f64::from(n * n)
}

fn meshes(random: &mut Random) -> Vec<TriangleMesh> {
    let soup: Vec<Vec3> = (0..30).map(|_| (vector(random) * 0.9).as_vec3()).collect();
    let triangles = (0..10).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let b = DAabb::new(DVec3::NEG_ONE * 0.6, DVec3::ONE * 0.5);
    let corners: Vec<Vec3> = b.corners().map(|c| c.as_vec3()).to_vec();
    let faces = vec![
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ];
    vec![
        bumpy_ball(3),
        TriangleMesh::new(soup, triangles).unwrap(),
        TriangleMesh::new(corners, faces).unwrap(),
        TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).unwrap(),
    ]
}

/// Casts rays at `points` receivers; every point with a part of the light must lie in the penumbra of some edge.
fn interval(points: u64, seed: u64) {
    let mut random = Random::new(seed);
    let (mut tested, mut partial, mut in_wedge, mut missed, mut unknown) = (0u64, 0u64, 0u64, 0u64, 0u64);
    while tested < points {
        for mesh in meshes(&mut random) {
            let (caster, edges) = (Bvh8::new(&mesh), EdgeList::new(&mesh));
            for light in lights(&mut random) {
                let all: Vec<Penumbra> =
                    edges.silhouette(&light).filter_map(|e| Penumbra::new(&e, &light)).collect();
                // An edge that points at the light makes every point a part of the penumbra: nothing to test.
                if all.iter().any(|p| matches!(p, Penumbra::Everywhere(_))) {
                    unknown += 1;
                    continue;
                }
                for _ in 0..250 {
                    let point = vector(&mut random) * 2.5 - DVec3::Z * 1.5;
                    let seen = visibility(&caster, &light, point, 5, &mut random);
                    let claimed = all.iter().any(|p| p.contains(point));
                    tested += 1;
                    in_wedge += u64::from(claimed);
                    if seen > 0.0 && seen < 1.0 {
                        partial += 1;
                        missed += u64::from(!claimed);
                    }
                }
            }
        }
    }
    println!(
        "{tested} points: {partial} see a part of the light, {missed} of them outside the penumbra; \
         {in_wedge} in it; {unknown} pairs of mesh and light left out for an edge towards the light"
    );
    assert_eq!(missed, 0);
    assert!(partial > points / 30 && in_wedge < tested * 6 / 10);
}

#[test]
fn no_part_of_a_light_is_seen_outside_the_penumbra() {
    interval(60_000, 31);
}

#[test]
#[ignore = "a million points, 25 rays each: about a minute"]
fn no_part_of_a_light_is_seen_outside_the_penumbra_a_million_times() {
    interval(1_000_000, 32);
}

/// Behind a single long edge the share seen is that of ray casting, and the wedge ends where it is 0 and 1.
#[test]
fn an_edge_lets_through_what_rays_say() {
    let far = 400.0f64;
    let reach = far as f32;
    let sheet = TriangleMesh::new(
        vec![Vec3::new(0.0, -reach, 0.0), Vec3::new(0.0, reach, 0.0), Vec3::new(reach, 0.0, 0.0)],
        vec![[0, 1, 2]],
    )
    .unwrap();
    let caster = Bvh8::new(&sheet);
    let edge = SilhouetteEdge {
        ends: [dvec3(0.0, -far, 0.0), dvec3(0.0, far, 0.0)],
        beside: dvec3(far, 0.0, 0.0),
        from_center: true,
    };
    let mut random = Random::new(5);
    let (mut worst, mut inside) = (0.0f64, 0);
    for _ in 0..40 {
        for light in lights(&mut random) {
            let Some(Penumbra::Wedge(wedge)) = Penumbra::new(&edge, &light) else { panic!("{light:?}") };
            for _ in 0..40 {
                let point = dvec3(random.unit() * 4.0 - 2.0, random.unit() - 0.5, -0.5 - random.unit());
                let share = f64::from(wedge.visible(point));
                if !wedge.contains(point) {
                    assert!(!(1e-4..=1.0 - 1e-4).contains(&share), "{share}");
                    continue;
                }
                inside += 1;
                if let Shape::Sphere { .. } = light {
                    // The disk that the outline spans is the light's image only for small lights; the solid angle has its own test.
                    continue;
                }
                worst = worst.max((visibility(&caster, &light, point, 40, &mut random) - share).abs());
            }
        }
    }
    println!("{inside} points in the wedge, the share seen is off by at most {worst:.4} (40² rays)");
    assert!(inside > 300 && worst < 0.02, "{inside} {worst}");
}

/// The quads' rows on a plane lie where the light is seen wholly, half, not at all.
#[test]
fn quads_separate_light_from_shadow() {
    let plane = Plane::through(dvec3(0.0, 0.0, -1.0), dvec3(0.1, 0.2, 1.0).normalize());
    let mut random = Random::new(6);
    for _ in 0..100 {
        for light in lights(&mut random) {
            let edge = SilhouetteEdge {
                ends: [dvec3(0.0, -0.3, 0.1), dvec3(0.2, 0.5, 0.0)],
                beside: dvec3(1.0, 0.0, 0.0),
                from_center: true,
            };
            let Some(Penumbra::Wedge(wedge)) = Penumbra::new(&edge, &light) else { continue };
            let Some(quads) = wedge.quads(&plane) else { continue };
            for (row, share) in [(quads.outer, 1.0), (quads.inner, 0.0)] {
                for p in row {
                    assert!(plane.distance(p).abs() < 1e-9);
                    assert!(
                        (wedge.visible(p) - share).abs() < 1e-3,
                        "{light:?} {} {share}",
                        wedge.visible(p)
                    );
                }
            }
            assert!(quads.middle.iter().all(|&p| (wedge.visible(p) - 0.5).abs() < 1e-3));
        }
    }
    let light = Shape::Sphere { center: DVec3::Z * 3.0, radius: 0.5 };
    let edge = SilhouetteEdge { ends: [DVec3::ZERO, DVec3::X], beside: DVec3::Y, from_center: true };
    let Some(Penumbra::Wedge(wedge)) = Penumbra::new(&edge, &light) else { panic!() };
    let behind = Plane::through(DVec3::Z * 9.0, DVec3::Z);
    assert_eq!(wedge.quads(&behind), None);
}

#[test]
fn edges_that_point_at_the_light_leave_everything_open() {
    let light = Shape::Sphere { center: DVec3::Z * 3.0, radius: 0.5 };
    let edge = |a: DVec3, b: DVec3| SilhouetteEdge { ends: [a, b], beside: DVec3::X, from_center: true };
    for (a, b) in
        [(DVec3::ZERO, DVec3::Z), (dvec3(0.3, 0.0, 0.0), dvec3(0.3, 0.0, 1.0)), (DVec3::Z * 3.0, DVec3::ZERO)]
    {
        let penumbra = Penumbra::new(&edge(a, b), &light).unwrap();
        assert!(matches!(penumbra, Penumbra::Everywhere(_)) && penumbra.contains(DVec3::ONE * 7.0));
    }
    assert_eq!(Penumbra::new(&edge(DVec3::ONE, DVec3::ONE), &light), None);
    // Twice as far aside as the light reaches, the wedge is back.
    assert!(matches!(
        Penumbra::new(&edge(dvec3(1.0, 0.0, 0.0), dvec3(1.0, 0.0, 1.0)), &light),
        Some(Penumbra::Wedge(_))
    ));
}

#[test]
fn silhouettes_of_hard_meshes_are_finite() {
    let mut random = Random::new(1);
    for case in farsight_geometry::hard_cases::meshes() {
        let edges = EdgeList::new(&case.mesh);
        for light in lights(&mut random) {
            for edge in edges.silhouette(&light) {
                if let Some(Penumbra::Wedge(w)) = Penumbra::new(&edge, &light) {
                    assert!(w.outer.is_finite() && w.inner.is_finite(), "{}", case.name);
                    assert!(w.visible(DVec3::NEG_Z * 3.0).is_finite(), "{}", case.name);
                }
            }
        }
    }
}
