//! Which pixels a triangle covers.

use farsight_raster::{
    Blend, Cull, DepthTest, Draw, Fragment, Ids, Outputs, Random, Rasteriser, State, Target,
};
use glam::{DMat4, DVec3, DVec4, Vec3, Vec4};

/// Clip space from pixels (y down), depth and w = 1.
fn from_px(width: u32, height: u32) -> DMat4 {
    let (sx, sy) = (2.0 / f64::from(width), 2.0 / f64::from(height));
    DMat4::from_cols(
        DVec4::new(sx, 0.0, 0.0, 0.0),
        DVec4::new(0.0, -sy, 0.0, 0.0),
        DVec4::Z,
        DVec4::new(-1.0, 1.0, 0.0, 1.0),
    )
}

/// Draws with addition, so that the colour of a pixel counts how often it was covered.
fn coverage(width: u32, height: u32, positions: &[Vec3], triangles: &[[u32; 3]]) -> (Target, Rasteriser) {
    let mut target = Target::new(width, height, Outputs { colour: true, depth: false, id: false }).unwrap();
    let mut rasteriser = Rasteriser::new();
    let mut state = State::default();
    state.blend = Blend::Over;
    // Premultiplied "over" with alpha 0 adds.
    let one = |_: &Fragment| Some(Vec4::new(1.0, 0.0, 0.0, 0.0));
    let draw = Draw { positions, triangles, clip_from_local: from_px(width, height), state };
    rasteriser.draw_shaded(&mut target, &draw, &one);
    (target, rasteriser)
}

fn counts(target: &Target) -> Vec<f32> {
    target.colour_rows().flatten().map(|c| c[0]).collect()
}

/// Coverage by the definition, in integers: sample inside, or on a top or left edge.
fn covers(corners: [Vec3; 3], x: i64, y: i64) -> bool {
    let snap = |v: f32| (f64::from(v) * 256.0 + 0.5).floor() as i64;
    let mut p = corners.map(|c| [snap(c.x), snap(c.y)]);
    let twice_area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
    if twice_area == 0 {
        return false;
    }
    if twice_area < 0 {
        p.swap(1, 2);
    }
    (0..3).all(|i| {
        let (a, b) = (p[i], p[(i + 1) % 3]);
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let e = dx * (256 * y + 128 - a[1]) - dy * (256 * x + 128 - a[0]);
        e > 0 || (e == 0 && (dy < 0 || (dy == 0 && dx > 0)))
    })
}

#[test]
fn random_triangles_of_all_sizes_cover_what_the_definition_says() {
    let (width, height) = (53, 41);
    let mut random = Random::new(11);
    let mut covered = 0;
    for round in 0..6000 {
        // From far smaller than a pixel to far beyond the screen, every fourth on the subpixel grid's half-pixels.
        let size = [0.3, 3.0, 40.0, 5000.0][round % 4];
        let center = Vec3::new(random.range_f32(-5.0, 58.0), random.range_f32(-5.0, 46.0), 0.5);
        let mut corner = || {
            let p = center + Vec3::new(random.range_f32(-size, size), random.range_f32(-size, size), 0.0);
            if round % 8 < 4 { p } else { (p * 2.0).round() * 0.5 }
        };
        let corners = [corner(), corner(), corner()];
        // Beyond the guard band clipping moves corners; that is another test.
        if corners.iter().any(|c| c.abs().max_element() > 30_000.0) {
            continue;
        }
        let (target, _) = coverage(width, height, &corners, &[[0, 1, 2]]);
        for (i, &count) in counts(&target).iter().enumerate() {
            let (x, y) = (i as i64 % i64::from(width), i as i64 / i64::from(width));
            assert_eq!(count == 1.0, covers(corners, x, y), "{corners:?} at {x}, {y}");
            covered += u64::from(count == 1.0);
        }
    }
    assert!(covered > 500_000);
}

#[test]
fn every_pixel_of_a_grid_is_covered_exactly_once() {
    let mut random = Random::new(3);
    for (size, jitter) in [(3.0f32, 0.7f32), (1.0, 0.24), (0.37, 0.09), (16.0, 3.9), (4.0, 0.0)] {
        let n = (72.0 / size) as u32 + 2;
        let positions: Vec<Vec3> = (0..(n + 1) * (n + 1))
            .map(|i| {
                let (x, y) = ((i % (n + 1)) as f32, (i / (n + 1)) as f32);
                // The border stays outside the image; less than a quarter of a cell keeps every triangle upright.
                let j = |random: &mut Random| random.range_f32(-jitter, jitter);
                Vec3::new((x - 0.9) * size + j(&mut random), (y - 0.9) * size + j(&mut random), 0.5)
            })
            .collect();
        let mut triangles = Vec::new();
        for y in 0..n {
            for x in 0..n {
                let a = y * (n + 1) + x;
                let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
                // Alternating diagonals and both orientations.
                triangles.extend(if (x + y) % 2 == 0 {
                    [[a, b, c], [a, d, c]]
                } else {
                    [[a, b, d], [d, b, c]]
                });
            }
        }
        let (target, _) = coverage(64, 64, &positions, &triangles);
        assert!(counts(&target).iter().all(|&c| c == 1.0), "cell {size}");
    }
}

#[test]
fn every_pixel_of_a_fan_is_covered_exactly_once() {
    let mut random = Random::new(4);
    for spokes in [3u32, 7, 64, 1000] {
        for center in [Vec3::new(32.5, 32.5, 0.5), Vec3::new(31.99, 30.1, 0.5), Vec3::new(40.0, 20.0, 0.5)] {
            let turn = random.range_f32(0.0, 1.0);
            let mut positions = vec![center];
            for i in 0..spokes {
                let (sin, cos) = (std::f32::consts::TAU * (i as f32 + turn) / spokes as f32).sin_cos();
                // Far outside, in part beyond the guard band, so that clipped triangles share edges too.
                positions.push(center + Vec3::new(cos, sin, 0.0) * random.range_f32(300.0, 90_000.0));
            }
            let triangles: Vec<[u32; 3]> = (0..spokes).map(|i| [0, 1 + i, 1 + (i + 1) % spokes]).collect();
            let (target, rasteriser) = coverage(64, 64, &positions, &triangles);
            let wrong = counts(&target).iter().filter(|&&c| c != 1.0).count();
            assert_eq!(wrong, 0, "{spokes} spokes at {center}");
            assert!(rasteriser.counters.clipped > 0);
        }
    }
}

#[test]
fn a_plane_that_passes_under_the_eye_has_no_cracks() {
    // Below the near distance, so that the ground comes closer than the near plane.
    const HEIGHT: f64 = 0.06;
    // Ground triangles around the eye, many of them crossing the near plane and the plane of the eye.
    let camera =
        farsight_geometry::Camera::look_at(DVec3::new(0.3, 0.2, HEIGHT), DVec3::new(5.0, 3.0, 0.0), DVec3::Z)
            .unwrap()
            .with_image(160, 120)
            .unwrap();
    let n = 24u32;
    let mut random = Random::new(9);
    let positions: Vec<Vec3> = (0..(n + 1) * (n + 1))
        .map(|i| {
            let (x, y) = ((i % (n + 1)) as f32 - 12.0, (i / (n + 1)) as f32 - 12.0);
            let grow = |t: f32| t * (1.0 + 0.2 * t * t);
            Vec3::new(grow(x) + random.range_f32(-0.3, 0.3), grow(y) + random.range_f32(-0.3, 0.3), 0.0)
        })
        .collect();
    let mut triangles = Vec::new();
    for i in (0..n * (n + 1)).filter(|i| i % (n + 1) < n) {
        triangles.extend([[i, i + 1, i + n + 2], [i, i + n + 2, i + n + 1]]);
    }
    let mut target = Target::new(160, 120, Outputs { colour: true, depth: false, id: false }).unwrap();
    let mut rasteriser = Rasteriser::new();
    let mut state = State::default();
    state.blend = Blend::Over;
    let clip_from_local =
        camera.clip_from_relative_f64(farsight_geometry::ClipConvention::REVERSED, DVec3::ZERO);
    let draw = Draw { positions: &positions, triangles: &triangles, clip_from_local, state };
    rasteriser.draw_shaded(&mut target, &draw, &|_: &Fragment| Some(Vec4::X));
    assert!(rasteriser.counters.clipped > 3);
    let mut ground = 0;
    for y in 0..120 {
        for x in 0..160 {
            let ray = camera.ray(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let t = -HEIGHT / ray.direction().z;
            let hit = ray.at(t);
            // Well inside the patch; its rim is ragged.
            let inside = t > 0.0 && hit.x.abs().max(hit.y.abs()) < 300.0;
            if inside {
                ground += 1;
                assert_eq!(target.colour(x, y)[0], 1.0, "({x}, {y})");
            }
        }
    }
    assert!(ground > 5000);
}

#[test]
fn culling_goes_by_the_side_that_is_seen() {
    // Counter-clockwise as seen, y up: in pixels (y down) left-bottom, right-bottom, top.
    let front = [Vec3::new(1.0, 9.0, 0.5), Vec3::new(9.0, 9.0, 0.5), Vec3::new(5.0, 1.0, 0.5)];
    let pixels = |cull, triangle: [u32; 3]| {
        let mut target = Target::new(10, 10, Outputs::DEPTH_ID).unwrap();
        let mut state = State::default();
        state.cull = cull;
        let mut rasteriser = Rasteriser::new();
        let draw =
            Draw { positions: &front, triangles: &[triangle], clip_from_local: from_px(10, 10), state };
        rasteriser.draw(&mut target, &draw);
        target.ids().filter(|&id| id == 1).count()
    };
    assert!(pixels(Cull::None, [0, 1, 2]) > 20);
    assert_eq!(pixels(Cull::None, [0, 1, 2]), pixels(Cull::None, [2, 1, 0]));
    assert_eq!(pixels(Cull::Back, [0, 1, 2]), pixels(Cull::None, [0, 1, 2]));
    assert_eq!(pixels(Cull::Back, [2, 1, 0]), 0);
    assert_eq!(pixels(Cull::Front, [0, 1, 2]), 0);
}

#[test]
fn hard_triangles_neither_panic_nor_leak_outside() {
    let huge = 1e18f32;
    let cases: Vec<[Vec3; 3]> = vec![
        [Vec3::ZERO; 3],
        [Vec3::splat(5.0), Vec3::splat(5.0), Vec3::new(9.0, 1.0, 0.5)],
        [Vec3::new(-huge, -huge, 0.5), Vec3::new(huge, -huge, 0.5), Vec3::new(0.0, huge, 0.5)],
        [Vec3::new(5.0, 5.0, 0.5), Vec3::new(5.0 + 1e-6, 5.0, 0.5), Vec3::new(5.0, 5.0 + 1e-6, 0.5)],
        [Vec3::new(0.0, 5.5, 0.1), Vec3::new(10.0, 5.5, 0.9), Vec3::new(10.0, 5.500_01, 0.9)],
        [Vec3::new(2.0, 2.0, -huge), Vec3::new(8.0, 2.0, huge), Vec3::new(5.0, 8.0, 0.5)],
        [Vec3::new(-huge, 2.0, 0.5), Vec3::new(huge, 2.0, 0.5), Vec3::new(huge, 2.0 + 1e-3, 0.5)],
        [Vec3::splat(1e-30), Vec3::splat(-1e-30), Vec3::new(1e-30, -1e-30, 0.0)],
    ];
    let mut projective = from_px(10, 10);
    projective.z_axis = DVec4::new(0.0, 0.0, 0.5, 1.0);
    for (i, corners) in cases.iter().enumerate() {
        for matrix in [from_px(10, 10), projective, DMat4::ZERO, DMat4::from_scale(DVec3::splat(1e30))] {
            for clamp in [false, true] {
                let mut target = Target::new(10, 10, Outputs::ALL).unwrap();
                let mut state = State::default();
                state.depth_clamp = clamp;
                let draw =
                    Draw { positions: corners, triangles: &[[0, 1, 2]], clip_from_local: matrix, state };
                let mut rasteriser = Rasteriser::new();
                rasteriser.draw_shaded(&mut target, &draw, &|f: &Fragment| {
                    let w = f.weights();
                    assert!(w.is_finite() && (w.element_sum() - 1.0).abs() < 1e-5, "case {i}: {w}");
                    Some(Vec4::ONE)
                });
                assert!(target.depth_rows().flatten().all(|d| (0.0..=1.0).contains(d)), "case {i}");
            }
        }
    }
    // The screen-filling one fills the screen.
    let (target, _) = coverage(10, 10, &cases[2], &[[0, 1, 2]]);
    assert!(counts(&target).iter().all(|&c| c == 1.0));
}

#[test]
fn what_is_off_screen_costs_no_pixels() {
    let mut rasteriser = Rasteriser::new();
    let mut target = Target::new(10, 10, Outputs::ALL).unwrap();
    let positions: Vec<Vec3> =
        (0..3000).map(|i| Vec3::new(20.0 + (i % 7) as f32, (i % 11) as f32, 0.5)).collect();
    let triangles: Vec<[u32; 3]> = (0..1000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let draw = Draw {
        positions: &positions,
        triangles: &triangles,
        clip_from_local: from_px(10, 10),
        state: State::default(),
    };
    rasteriser.draw(&mut target, &draw);
    assert_eq!(rasteriser.counters.outside, 1000);
    assert_eq!(rasteriser.counters.pixels_tested, 0);
    rasteriser.draw(&mut target, &Draw { positions: &[], triangles: &[], ..draw });
    assert_eq!(rasteriser.counters.draws, 2);
}

#[test]
fn counters_and_ids_agree_with_the_buffers() {
    let mut random = Random::new(21);
    let positions: Vec<Vec3> = (0..600)
        .map(|_| {
            Vec3::new(
                random.range_f32(-20.0, 84.0),
                random.range_f32(-20.0, 84.0),
                random.range_f32(0.0, 1.0),
            )
        })
        .collect();
    let triangles: Vec<[u32; 3]> = (0..200).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mut state = State::default();
    state.ids = Ids::PerTriangle(1);
    let mut nearest = vec![(0.0f32, 0u32); 64 * 64];
    let mut together = Target::new(64, 64, Outputs::DEPTH_ID).unwrap();
    let mut rasteriser = Rasteriser::new();
    let mut draw =
        Draw { positions: &positions, triangles: &triangles, clip_from_local: from_px(64, 64), state };
    rasteriser.draw(&mut together, &draw);
    let tested = rasteriser.counters.pixels_tested;
    // One at a time into empty targets, merged by hand.
    let mut pixels = 0;
    for (i, triangle) in triangles.iter().enumerate() {
        let mut alone = Target::new(64, 64, Outputs::DEPTH_ID).unwrap();
        draw.triangles = std::slice::from_ref(triangle);
        draw.state.ids = Ids::Constant(i as u32 + 1);
        draw.state.depth_test = DepthTest::Always;
        rasteriser.draw(&mut alone, &draw);
        for (slot, (depth, id)) in nearest.iter_mut().zip(alone.depth_rows().flatten().zip(alone.ids())) {
            pixels += u64::from(id != 0);
            if id != 0 && *depth > slot.0 {
                *slot = (*depth, id);
            }
        }
    }
    assert_eq!(tested, pixels);
    assert!(nearest.iter().zip(together.ids()).all(|(n, id)| n.1 == id));
    assert!(nearest.iter().zip(together.depth_rows().flatten()).all(|(n, d)| n.0 == *d));
}
