//! The depth buffer never hides what would be seen: against brute force in `f64` and exact integers.

use farsight_geometry::glam::{DMat4, DVec2, DVec3, DVec4, Vec3};
use farsight_geometry::hard_cases;
use farsight_geometry::{Camera, ClipConvention, DAabb, Projection};
use farsight_occlusion::{Coverage, DepthBuffer, DepthBufferError, Faces, Projected, ScreenBox, SimdLevel};
use farsight_raster::Random;

/// Largest reversed depth of anything drawn, pixel by pixel.
struct Truth {
    width: i64,
    height: i64,
    depth: Vec<f64>,
}

impl Truth {
    fn new(width: u32, height: u32) -> Self {
        let (width, height) = (i64::from(width), i64::from(height));
        Self { width, height, depth: vec![0.0; (width * height) as usize] }
    }

    fn draw(&mut self, m: &DMat4, positions: &[Vec3], triangles: &[[u32; 3]]) {
        for t in triangles {
            let p = t.map(|i| *m * positions[i as usize].as_dvec3().extend(1.0));
            let size = DVec2::new(self.width as f64, self.height as f64);
            let px = p.map(|p| DVec2::new(0.5 * size.x * (p.x + p.w), 0.5 * size.y * (p.w - p.y)) / p.w);
            let whole =
                p.iter().zip(&px).all(|(p, q)| p.w > 0.0 && p.z <= p.w && q.abs().max_element() <= 8190.0);
            if whole {
                self.draw_snapped(p, px);
            } else {
                self.draw_homogeneous(p);
            }
        }
    }

    /// Exact coverage of the snapped triangle, depth of the plane through the corners before snapping.
    fn draw_snapped(&mut self, p: [DVec4; 3], px: [DVec2; 3]) {
        let s = px.map(|q| [(q.x * 256.0 + 0.5).floor() as i64, (q.y * 256.0 + 0.5).floor() as i64]);
        let z = p.map(|p| p.z / p.w);
        let (low, high) = (z[0].min(z[1]).min(z[2]), z[0].max(z[1]).max(z[2]));
        let (a, b) = (px[1] - px[0], px[2] - px[0]);
        let det = a.perp_dot(b);
        let g =
            DVec2::new((z[1] - z[0]) * b.y - (z[2] - z[0]) * a.y, (z[2] - z[0]) * a.x - (z[1] - z[0]) * b.x);
        let area = (s[1][0] - s[0][0]) * (s[2][1] - s[0][1]) - (s[2][0] - s[0][0]) * (s[1][1] - s[0][1]);
        if area == 0 {
            return;
        }
        let range = |axis: usize, side: i64| {
            let v = s.map(|q| q[axis]);
            let (lo, hi) = (v[0].min(v[1]).min(v[2]), v[0].max(v[1]).max(v[2]));
            (lo.div_euclid(256) - 1).max(0)..(hi.div_euclid(256) + 2).min(side)
        };
        for y in range(1, self.height) {
            for x in range(0, self.width) {
                let (cx, cy) = (256 * x + 128, 256 * y + 128);
                let inside = (0..3).all(|k| {
                    let (mut u, mut v) = (s[k], s[(k + 1) % 3]);
                    if area < 0 {
                        (u, v) = (v, u);
                    }
                    // Positive inside. Top edges (level, above) and left edges own their points.
                    let e = (v[0] - u[0]) * (cy - u[1]) - (v[1] - u[1]) * (cx - u[0]);
                    let owns = v[1] < u[1] || (v[1] == u[1] && v[0] > u[0]);
                    e > 0 || (e == 0 && owns)
                });
                if inside {
                    let d = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - px[0];
                    let depth = if det == 0.0 { low } else { (z[0] + g.dot(d) / det).clamp(low, high) };
                    self.put(x, y, depth);
                }
            }
        }
    }

    /// Triangles that reach before the near plane or far out: rays through pixel centres against the triangle.
    fn draw_homogeneous(&mut self, p: [DVec4; 3]) {
        let rows = p.map(|p| DVec3::new(p.x, p.y, p.w));
        let normals = [rows[1].cross(rows[2]), rows[2].cross(rows[0]), rows[0].cross(rows[1])];
        let det = rows[0].dot(normals[0]);
        if det == 0.0 {
            return;
        }
        for y in 0..self.height {
            for x in 0..self.width {
                let ray = DVec3::new(
                    (x as f64 + 0.5) / self.width as f64 * 2.0 - 1.0,
                    1.0 - (y as f64 + 0.5) / self.height as f64 * 2.0,
                    1.0,
                );
                let weights = normals.map(|n| n.dot(ray) / det);
                let w: f64 = (0..3).map(|k| weights[k] * p[k].w).sum();
                let z: f64 = (0..3).map(|k| weights[k] * p[k].z).sum();
                if weights.iter().all(|&b| b >= 0.0) && w > 0.0 && z <= w {
                    self.put(x, y, z / w);
                }
            }
        }
    }

    fn put(&mut self, x: i64, y: i64, depth: f64) {
        let at = &mut self.depth[(y * self.width + x) as usize];
        *at = at.max(depth);
    }

    /// Pixels at which `buffer` is nearer than the truth, and pixels looked at.
    fn violations(&self, buffer: &DepthBuffer) -> (u64, u64, u64) {
        let (mut bad, mut known) = (0, 0);
        for y in 0..self.height {
            for x in 0..self.width {
                let kept = f64::from(buffer.depth(x as u32, y as u32));
                bad += u64::from(kept > self.depth[(y * self.width + x) as usize]);
                known += u64::from(kept > 0.0);
            }
        }
        (bad, known, (self.width * self.height) as u64)
    }

    fn farthest_in(&self, b: &ScreenBox) -> f64 {
        let mut least = f64::INFINITY;
        for y in b.y[0]..b.y[1] {
            for x in b.x[0]..b.x[1] {
                least = least.min(self.depth[(i64::from(y) * self.width + i64::from(x)) as usize]);
            }
        }
        least
    }
}

fn camera(random: &mut Random, kind: usize, width: u32, height: u32) -> Camera {
    let eye = DVec3::new(random.range(-3.0, 3.0), random.range(-3.0, 3.0), random.range(-3.0, 3.0));
    let camera = Camera::look_at(eye, DVec3::new(0.3, 9.0, 0.2), DVec3::Z).unwrap();
    let camera = match kind % 3 {
        0 => camera.with_range(0.05, f64::INFINITY).unwrap(),
        1 => camera.with_range(1.0, 30.0).unwrap(),
        _ => {
            let parallel = camera.with_projection(Projection::Orthographic { height: 12.0 }).unwrap();
            parallel.with_range(-2.0, 30.0).unwrap()
        }
    };
    camera.with_image(width, height).unwrap()
}

/// Triangles of one kind of difficulty.
fn soup(random: &mut Random, kind: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = Vec::new();
    let mut point = |r: &mut Random, c: Vec3, s: f32| {
        positions.push(c + Vec3::new(r.range_f32(-s, s), r.range_f32(-s, s), r.range_f32(-s, s)));
    };
    let count = match kind {
        3 | 4 => 12,
        _ => 150,
    };
    for _ in 0..count {
        let c =
            Vec3::new(random.range_f32(-8.0, 8.0), random.range_f32(1.0, 20.0), random.range_f32(-5.0, 5.0));
        match kind {
            0 => (0..3).for_each(|_| point(random, c, 1.0)),
            1 => (0..3).for_each(|_| point(random, c, 0.03)),
            // Slivers.
            2 => {
                let far = c + Vec3::new(random.range_f32(-6.0, 6.0), random.range_f32(-6.0, 6.0), 0.0);
                point(random, c, 0.002);
                point(random, far, 0.002);
                point(random, far, 0.002);
            }
            // Huge, through the near plane and the guard band.
            3 => (0..3).for_each(|_| point(random, c, 40.0)),
            4 => (0..3).for_each(|_| point(random, Vec3::ZERO, 3000.0)),
            // Nearly seen edge-on.
            _ => {
                let r = Vec3::new(c.x * 0.1, 0.0, c.z * 0.1);
                point(random, c + r, 0.01);
                point(random, c * 1.8 + r, 0.01);
                let side = Vec3::X * random.range_f32(0.0, 0.5);
                point(random, c * 1.4 + side, 0.01);
            }
        }
    }
    let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    (positions, triangles)
}

/// A bumpy sheet: shared edges.
fn sheet(random: &mut Random, n: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let at = |i: u32, j: u32, bump: f32| {
        let (u, v) = (i as f32 / n as f32 - 0.5, j as f32 / n as f32 - 0.5);
        Vec3::new(u * 12.0, 9.0 + bump, v * 9.0)
    };
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))).collect::<Vec<_>>();
    let positions = positions.into_iter().map(|(i, j)| at(i, j, random.range_f32(-0.3, 0.3))).collect();
    let triangles = (0..n * n).flat_map(|k| {
        let a = k / n * (n + 1) + k % n;
        [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
    });
    (positions, triangles.collect())
}

#[test]
fn no_pixel_is_nearer_than_the_truth_and_no_box_is_hidden_falsely() {
    let mut random = Random::new(11);
    let (mut pixels, mut boxes, mut hidden, mut truly, mut known) = (0, 0u64, 0u64, 0u64, 0);
    for round in 0..175 {
        // One scene of each kind at the size that speeds are given for.
        let (width, height) =
            if round < 168 { [(348, 210), (333, 217), (64, 48)][round % 3] } else { (1920, 1080) };
        let camera = camera(&mut random, round / 2, width, height);
        let m = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let kind = round % 7;
        let (positions, triangles) = if kind == 6 {
            let n = 3 + random.below(40) as u32;
            sheet(&mut random, n)
        } else {
            soup(&mut random, kind)
        };
        let level = if round % 2 == 0 { SimdLevel::Detect } else { SimdLevel::Baseline };
        let mut buffer = DepthBuffer::new(width, height).unwrap().with_simd(level);
        buffer.draw(&m, &positions, &triangles, Faces::Both);
        let mut truth = Truth::new(width, height);
        truth.draw(&m, &positions, &triangles);
        let (bad, filled, all) = truth.violations(&buffer);
        assert_eq!(bad, 0, "round {round}, kind {kind}");
        (pixels, known) = (pixels + all, known + filled);
        for _ in 0..6400 {
            let side = random.range(0.0, 5.0).exp2() as u32;
            let (x, y) = (random.below(width as usize) as u32, random.below(height as usize) as u32);
            let b = ScreenBox { x: [x, (x + side).min(width)], y: [y, (y + side).min(height)], depth: 0.0 };
            if b.x[0] >= b.x[1] || b.y[0] >= b.y[1] {
                continue;
            }
            let farthest = truth.farthest_in(&b);
            // Half of the boxes within a hair of the decision.
            let factor = if random.chance(0.5) {
                random.range(0.5, 1.5)
            } else {
                1.0 + random.range(-0.1, 0.1) * random.range(-20.0, 0.0).exp2()
            };
            let b = ScreenBox { depth: (farthest * factor) as f32, ..b };
            let occluded = buffer.is_screen_box_occluded(&b);
            assert!(!occluded || farthest >= f64::from(b.depth), "round {round}: false occlusion");
            (boxes, hidden) = (boxes + 1, hidden + u64::from(occluded));
            truly += u64::from(farthest > f64::from(b.depth));
        }
    }
    println!("{pixels} pixels, {known} with occluders; {boxes} boxes, {truly} hidden, {hidden} found");
    assert!(boxes >= 1_000_000 && pixels >= 20_000_000);
    assert!(hidden * 4 > truly, "the buffer should be of some use");
}

#[test]
fn rounded_coverage_differs_at_few_pixels() {
    let mut random = Random::new(31);
    let (mut pixels, mut different, mut wrong) = (0, 0, 0);
    for round in 0..42 {
        let (width, height) = (348, 210);
        let camera = camera(&mut random, round, width, height);
        let m = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let (positions, triangles) = soup(&mut random, round % 3);
        let draw = |coverage| {
            let mut buffer = DepthBuffer::new(width, height).unwrap().with_coverage(coverage);
            buffer.draw(&m, &positions, &triangles, Faces::Both);
            buffer
        };
        let (exact, rounded) = (draw(Coverage::Centres), draw(Coverage::Rounded));
        let mut truth = Truth::new(width, height);
        truth.draw(&m, &positions, &triangles);
        wrong += truth.violations(&rounded).0;
        pixels += u64::from(width * height);
        different += (0..width * height)
            .filter(|i| exact.depth(i % width, i / width) != rounded.depth(i % width, i / width))
            .count() as u64;
    }
    println!(
        "{pixels} pixels, {different} differ between exact and rounded coverage, {wrong} are nearer than the truth"
    );
    assert!(different * 1000 < pixels && wrong * 10_000 < pixels);
}

#[test]
fn world_boxes_are_never_hidden_falsely_near_the_eye() {
    let mut random = Random::new(5);
    let (width, height) = (160, 120);
    let mut found = 0;
    for round in 0..60 {
        let camera = camera(&mut random, round, width, height);
        let m = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let (positions, triangles) = soup(&mut random, [0, 3, 4][round % 3]);
        let mut buffer = DepthBuffer::new(width, height).unwrap();
        buffer.draw(&m, &positions, &triangles, Faces::Both);
        let mut truth = Truth::new(width, height);
        truth.draw(&m, &positions, &triangles);
        for _ in 0..1000 {
            let distance = random.range(-4.0, 6.0).exp2();
            let s = distance * random.range(-6.0, -1.0).exp2();
            let c = camera.eye() + random.direction().as_dvec3() * distance;
            let b = DAabb::from_points([c]).inflated(s);
            if !buffer.is_occluded(&m, DVec3::ZERO, &b) {
                continue;
            }
            let Projected::Within(screen) = buffer.project(&m, DVec3::ZERO, &b) else { continue };
            found += 1;
            // Surface points of the box, projected: each must be hidden by the truth at the pixel it falls into.
            for _ in 0..60 {
                let axis = random.below(3);
                let mut p = DVec3::new(random.range(-s, s), random.range(-s, s), random.range(-s, s));
                p[axis] = if random.chance(0.5) { s } else { -s };
                let q = m * (c + p).extend(1.0);
                if q.w <= 0.0 || q.z > q.w {
                    continue;
                }
                let (px, py) =
                    ((q.x / q.w + 1.0) * 0.5 * f64::from(width), (1.0 - q.y / q.w) * 0.5 * f64::from(height));
                let within = |v: f64, [from, to]: [u32; 2]| v >= f64::from(from) && v < f64::from(to);
                let inside = within(px, screen.x) && within(py, screen.y);
                // Only pixel centres count.
                if inside && (px.fract() - 0.5).abs() < 0.02 && (py.fract() - 0.5).abs() < 0.02 {
                    let depth = truth.depth[(py as i64 * truth.width + px as i64) as usize];
                    assert!(depth * (1.0 + 1e-3) >= q.z / q.w, "round {round}: {b:?}");
                }
            }
        }
    }
    assert!(found > 300, "{found}");
}

#[test]
fn instruction_sets_agree_on_coverage() {
    let mut random = Random::new(2);
    for kind in 0..6 {
        let camera = camera(&mut random, 0, 500, 300);
        let m = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let (positions, triangles) = soup(&mut random, kind);
        let draw = |level| {
            let mut buffer = DepthBuffer::new(500, 300).unwrap().with_simd(level);
            buffer.draw(&m, &positions, &triangles, Faces::Both);
            (0..300)
                .flat_map(|y| (0..500).map(move |x| (x, y)))
                .map(|(x, y)| buffer.depth(x, y).to_bits())
                .collect::<Vec<_>>()
        };
        assert!(draw(SimdLevel::Detect) == draw(SimdLevel::Baseline), "kind {kind}");
    }
}

#[test]
fn a_closed_sheet_leaves_no_gap() {
    let mut random = Random::new(9);
    for n in [1, 2, 7, 31, 100] {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap().with_image(400, 300).unwrap();
        let m = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let (positions, triangles) = sheet(&mut random, n);
        let mut buffer = DepthBuffer::new(400, 300).unwrap();
        buffer.draw(&m, &positions, &triangles, Faces::Both);
        // Well inside the sheet's image.
        for y in 60..240 {
            for x in 110..290 {
                assert!(buffer.depth(x, y) > 0.0, "sheet {n}: ({x}, {y})");
            }
        }
    }
}

#[test]
fn whole_pixels_hold_for_any_sample_position() {
    let mut random = Random::new(6);
    for round in 0..12 {
        let (width, height) = (80, 60);
        let camera = camera(&mut random, round, width, height);
        let m = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let (positions, triangles) = soup(&mut random, [0, 3][round % 2]);
        let mut buffer = DepthBuffer::new(width, height).unwrap().with_coverage(Coverage::Whole);
        buffer.draw(&m, &positions, &triangles, Faces::Both);
        // The truth at samples anywhere in the pixel: a finer image, its farthest sample.
        let mut fine = Truth::new(width * 8, height * 8);
        fine.draw(&m, &positions, &triangles);
        for y in 0..height {
            for x in 0..width {
                let b = ScreenBox { x: [8 * x, 8 * x + 8], y: [8 * y, 8 * y + 8], depth: 0.0 };
                assert!(f64::from(buffer.depth(x, y)) <= fine.farthest_in(&b), "round {round} ({x}, {y})");
            }
        }
    }
}

#[test]
fn faces_turned_away_can_be_left_out() {
    let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap().with_image(64, 64).unwrap();
    let m = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
    for scale in [1.0f32, 1000.0] {
        let p = [[-3.0, -3.0], [3.0, -3.0], [0.0, 3.0]].map(|[x, z]| Vec3::new(x * scale, 5.0, z * scale));
        for (triangle, front) in
            [([0, 1, 2], true), ([2, 1, 0], false), ([1, 2, 0], true), ([1, 0, 2], false)]
        {
            let mut buffer = DepthBuffer::new(64, 64).unwrap();
            buffer.draw(&m, &p, &[triangle], Faces::Front);
            assert_eq!(buffer.depth(32, 32) > 0.0, front, "{triangle:?} {scale}");
        }
    }
}

#[test]
fn hard_cases_are_survived() {
    for case in hard_cases::meshes() {
        let b = case.mesh.world_bounds();
        for view in hard_cases::views(&b) {
            let camera = view.camera.with_image(120, 90).unwrap();
            let m = camera.clip_from_relative_f64(ClipConvention::REVERSED, case.mesh.origin());
            let mut buffer = DepthBuffer::new(120, 90).unwrap();
            buffer.draw(&m, case.mesh.positions(), case.mesh.triangles(), Faces::Both);
            let mut truth = Truth::new(120, 90);
            truth.draw(&m, case.mesh.positions(), case.mesh.triangles());
            assert_eq!(truth.violations(&buffer).0, 0, "{} {}", case.name, view.name);
            buffer.is_occluded(&m, case.mesh.origin(), &b);
        }
    }
}

#[test]
fn bad_sizes_and_boxes_are_refused_or_visible() {
    assert_eq!(DepthBuffer::new(0, 4).unwrap_err(), DepthBufferError::Size { width: 0, height: 4 });
    assert!(DepthBuffer::new(8191, 4).is_err());
    let mut buffer = DepthBuffer::new(8190, 1).unwrap();
    let m = DMat4::IDENTITY;
    assert_eq!(buffer.project(&m, DVec3::ZERO, &DAabb::EMPTY), Projected::Nothing);
    assert_eq!(buffer.project(&m, DVec3::ZERO, &DAabb::new(DVec3::NAN, DVec3::ONE)), Projected::Unbounded);
    assert!(!buffer.is_occluded(&m, DVec3::ZERO, &DAabb::new(DVec3::splat(-1.0), DVec3::splat(0.5))));
    buffer.draw(&m, &[Vec3::NAN, Vec3::ONE, Vec3::ZERO], &[[0, 1, 2]], Faces::Both);
    assert_eq!(buffer.depth(5, 0), 0.0);
}
