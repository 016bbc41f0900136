//! Queries, points, lines and quads against brute force.

use farsight_geometry::{Camera, ClipConvention, DAabb};
use farsight_raster::{
    DepthTest, Draw, Ids, LineDraw, OcclusionQueries, Outputs, PointDraw, QuadDraw, QuadImage, Random,
    Rasteriser, Splat, State, Target,
};
use glam::{DMat4, DVec3, DVec4, Vec3, Vec4};

fn from_px(width: u32, height: u32) -> DMat4 {
    let (sx, sy) = (2.0 / f64::from(width), 2.0 / f64::from(height));
    DMat4::from_cols(
        DVec4::new(sx, 0.0, 0.0, 0.0),
        DVec4::new(0.0, -sy, 0.0, 0.0),
        DVec4::Z,
        DVec4::new(-1.0, 1.0, 0.0, 1.0),
    )
}

fn soup(random: &mut Random, count: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let positions = (0..3 * count)
        .map(|_| {
            Vec3::new(
                random.range_f32(-10.0, 60.0),
                random.range_f32(-10.0, 60.0),
                random.range_f32(0.0, 1.0),
            )
        })
        .collect();
    (positions, (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

#[test]
fn query_counts_are_those_of_a_drawn_copy() {
    let mut random = Random::new(2);
    let mut rasteriser = Rasteriser::new();
    let mut target = Target::new(50, 50, Outputs::DEPTH_ID).unwrap();
    let (positions, triangles) = soup(&mut random, 20);
    let scene = Draw {
        positions: &positions,
        triangles: &triangles,
        clip_from_local: from_px(50, 50),
        state: State::default(),
    };
    rasteriser.draw(&mut target, &scene);
    let mut queries = OcclusionQueries::new(0);
    let mut some = 0;
    for _ in 0..200 {
        let (positions, triangles) = soup(&mut random, 1);
        let mut state = State::default();
        state.ids = Ids::Constant(77);
        let draw = Draw { positions: &positions, triangles: &triangles, state, ..scene };
        let before = target.clone();
        let query = queries.issue(&mut rasteriser, &target, &draw);
        assert!(before.ids().eq(target.ids()));
        let mut copy = target.clone();
        rasteriser.draw(&mut copy, &draw);
        let expected = copy.ids().filter(|&id| id == 77).count() as u64;
        let answer = queries.poll().unwrap();
        assert_eq!((answer.query, answer.samples), (query, expected));
        some += u64::from(expected > 0);
    }
    assert!(some > 50);
}

#[test]
fn answers_come_late_and_in_order() {
    let mut rasteriser = Rasteriser::new();
    let target = Target::new(8, 8, Outputs::DEPTH).unwrap();
    let b = DAabb::new(DVec3::new(-0.5, -0.5, 0.2), DVec3::new(0.5, 0.5, 0.4));
    let mut queries = OcclusionQueries::new(10);
    let mut ask = |queries: &mut OcclusionQueries| {
        queries.issue_box(&mut rasteriser, &target, DMat4::IDENTITY, DVec3::ZERO, &b)
    };
    let first = ask(&mut queries);
    queries.tick(4);
    let second = ask(&mut queries);
    queries.tick(5);
    assert!(queries.poll().is_none());
    queries.tick(1);
    let answer = queries.poll().unwrap();
    assert_eq!((answer.query, answer.samples), (first, 16));
    assert!(queries.poll().is_none());
    assert_eq!(queries.pending(), 1);
    let (answer, stall) = queries.wait().unwrap();
    assert_eq!((answer.query, stall, queries.now()), (second, 4, 14));
    assert!(queries.wait().is_none());
    let empty = queries.issue_box(&mut rasteriser, &target, DMat4::IDENTITY, DVec3::ZERO, &DAabb::EMPTY);
    let (answer, _) = queries.wait().unwrap();
    assert_eq!((answer.query, answer.samples), (empty, 0));
}

#[test]
fn a_box_counts_the_pixels_whose_rays_meet_it() {
    let eye = DVec3::new(4.0, -6.0, 3.0);
    let camera =
        Camera::look_at(eye, DVec3::new(0.2, 0.1, 0.4), DVec3::Z).unwrap().with_image(160, 120).unwrap();
    let matrix = camera.clip_from_relative_f64(ClipConvention::REVERSED, eye);
    let mut rasteriser = Rasteriser::new();
    let target = Target::new(160, 120, Outputs::DEPTH).unwrap();
    let b = DAabb::new(DVec3::new(-1.0, -0.7, -0.2), DVec3::new(0.9, 1.3, 1.1));
    let mut queries = OcclusionQueries::new(0);
    queries.issue_box(&mut rasteriser, &target, matrix, eye, &b);
    let samples = queries.poll().unwrap().samples;
    let mut expected = 0;
    for y in 0..120 {
        for x in 0..160 {
            let ray = camera.ray(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let (s, t) = ((b.min - eye) / ray.direction(), (b.max - eye) / ray.direction());
            expected += u64::from(s.min(t).max_element() <= s.max(t).min_element());
        }
    }
    assert!(expected > 500, "{expected}");
    assert!(samples.abs_diff(expected) <= 3, "{samples} {expected}");
}

#[test]
fn points_cover_squares_and_disks() {
    let mut rasteriser = Rasteriser::new();
    let mut covered = |size: f32, splat| {
        let mut target = Target::new(40, 40, Outputs::ALL).unwrap();
        let positions = [Vec3::new(20.3, 19.6, 0.5), Vec3::new(-30.0, 5.0, 0.5)];
        let draw = PointDraw {
            positions: &positions,
            colours: &[[255, 0, 0, 255]],
            sizes_px: &[size],
            splat,
            clip_from_local: from_px(40, 40),
            state: State::default(),
        };
        rasteriser.draw_points(&mut target, &draw);
        assert!(target.ids().zip(target.colour_rows().flatten()).all(|(id, c)| (id == 1) == (c[0] == 1.0)));
        target.ids().filter(|&id| id == 1).count()
    };
    for n in 1..20 {
        assert_eq!(covered(n as f32, Splat::Square), n * n);
    }
    assert_eq!(covered(0.2, Splat::Square), 1);
    assert_eq!(covered(0.2, Splat::Round), 1);
    let disk = covered(30.0, Splat::Round) as f32;
    assert!((disk / (std::f32::consts::PI * 225.0) - 1.0).abs() < 0.02);
}

#[test]
fn lines_are_connected_and_clipped() {
    let mut random = Random::new(8);
    let mut rasteriser = Rasteriser::new();
    for _ in 0..200 {
        let mut end = || Vec3::new(random.range_f32(2.0, 48.0), random.range_f32(2.0, 48.0), 0.5);
        let segment = [end(), end()];
        let mut target = Target::new(50, 50, Outputs::DEPTH_ID).unwrap();
        let mut draw = LineDraw {
            segments: &[segment],
            colour: Vec4::ONE,
            width_px: 1,
            clip_from_local: from_px(50, 50),
            state: State::default(),
        };
        rasteriser.draw_lines(&mut target, &draw);
        let d = (segment[1] - segment[0]).truncate();
        let steep = d.y.abs() > d.x.abs();
        let (a, b) = if steep { (segment[0].y, segment[1].y) } else { (segment[0].x, segment[1].x) };
        let expected = (0..50).filter(|&i| {
            let c = i as f32 + 0.5;
            c >= a.min(b) && c < a.max(b)
        });
        assert_eq!(target.ids().filter(|&id| id == 1).count(), expected.count());
        for y in 0..50u32 {
            for x in (0..50u32).filter(|&x| target.id(x, y) == 1) {
                let p = glam::Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - segment[0].truncate();
                let off = p.perp_dot(d).abs() / d.abs().max_element();
                assert!(off <= 0.501, "{segment:?} {x} {y}");
            }
        }
        draw.segments = &[];
        rasteriser.draw_lines(&mut target, &draw);
    }
    // From behind the eye to far away, and hostile ends.
    let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap().with_image(50, 50).unwrap();
    let mut target = Target::new(50, 50, Outputs::DEPTH_ID).unwrap();
    let segments = [
        [Vec3::new(0.5, -10.0, -0.3), Vec3::new(0.5, 100.0, -0.3)],
        [Vec3::splat(1e18), Vec3::splat(-1e18)],
        [Vec3::ZERO, Vec3::ZERO],
    ];
    let clip_from_local = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
    let draw = LineDraw {
        segments: &segments,
        colour: Vec4::ONE,
        width_px: 3,
        clip_from_local,
        state: State::default(),
    };
    rasteriser.draw_lines(&mut target, &draw);
    assert!(target.ids().any(|id| id == 1));
}

#[test]
fn a_quad_shows_its_picture_upright_and_its_relief_in_depth() {
    let texels: Vec<[f32; 4]> =
        (0..8 * 4).map(|i| [(i % 8) as f32 / 8.0, (i / 8) as f32 / 4.0, 0.0, 1.0]).collect();
    let plain = QuadImage::new(8, 4, texels.clone(), None).unwrap();
    let raised = QuadImage::new(8, 4, texels.clone(), Some(vec![0.25; 32])).unwrap();
    let mut rasteriser = Rasteriser::new();
    let mut target = Target::new(16, 16, Outputs::ALL).unwrap();
    let mut draw = QuadDraw {
        corners: [Vec3::new(4.0, 6.0, 0.5), Vec3::new(12.0, 6.0, 0.5), Vec3::new(4.0, 10.0, 0.5)],
        image: &plain,
        cutoff: 0.0,
        clip_from_local: from_px(16, 16),
        state: State::default(),
    };
    rasteriser.draw_quad(&mut target, &draw);
    for y in 0..16 {
        for x in 0..16 {
            let inside = (4..12).contains(&x) && (6..10).contains(&y);
            assert_eq!(target.id(x, y) == 1, inside);
            if inside {
                let expected = texels[((y - 6) * 8 + x - 4) as usize];
                let got = Vec4::from_array(target.colour(x, y));
                assert!(got.abs_diff_eq(Vec4::from_array(expected), 1e-5), "({x}, {y}) {got}");
                assert_eq!(target.depth(x, y), 0.5);
            }
        }
    }
    // Relief is along the normal; with y down in the pixel frame it points away from the viewer, so depth falls.
    draw.image = &raised;
    rasteriser.draw_quad(&mut target, &draw);
    assert_eq!(target.depth(5, 7), 0.5, "behind the flat one");
    draw.state.depth_test = DepthTest::Always;
    rasteriser.draw_quad(&mut target, &draw);
    assert!((target.depth(5, 7) - 0.25).abs() < 1e-6 || (target.depth(5, 7) - 0.75).abs() < 1e-6);
    assert!(QuadImage::new(8, 4, texels, Some(vec![0.0; 3])).is_err());
    assert!(QuadImage::new(0, 0, vec![], None).is_err());
}
