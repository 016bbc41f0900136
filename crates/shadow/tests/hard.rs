//! Hard configurations by the ten thousand, and what must not change from one frame to the next.

mod corpus;

use corpus::{Class, Outcome, run};
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, DAabb};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowError, ShadowLight, Warp};
use glam::{DQuat, DVec3, dvec3};

fn check(per_class: u64) {
    for class in Class::ALL {
        let o: Outcome = run(class, 0, per_class);
        println!("{class:?}: {o:?}");
        assert_eq!((o.not_finite, o.outside, o.wrong_rays), (0, 0, 0), "{class:?}");
        assert!(o.maps > o.tried / 20, "{class:?}: hardly any maps, {o:?}");
        assert!(o.shift_resolved <= 0.01, "{class:?}: {} texels", o.shift_resolved);
    }
}

#[test]
fn twenty_thousand_hard_configurations() {
    check(3000);
}

#[test]
#[ignore = "a million configurations: a minute or two"]
fn a_million_hard_configurations() {
    check(120_000);
}

/// A camera 2 m above a slab of 4 m, looking 5° down, and a sun `elevation` degrees high, behind or ahead; far over near is 400.
fn slab_focus(elevation: f64, ahead: bool) -> (Focus, Camera) {
    let pitch = 5f64.to_radians();
    let camera = Camera::look_at(DVec3::ZERO, dvec3(pitch.cos(), 0.0, -pitch.sin()), DVec3::Z)
        .and_then(|c| c.with_range(1.0, 400.0))
        .and_then(|c| c.with_image(1920, 1080))
        .unwrap();
    let e = elevation.to_radians();
    let travel = dvec3(if ahead { -e.cos() } else { e.cos() }, 0.0, -e.sin());
    let slab = [DAabb::new(dvec3(-1e3, -1e3, -3.0), dvec3(1e3, 1e3, 1.0))];
    let mut focus = Focus::new();
    let light = ShadowLight::directional(travel.normalize());
    assert_eq!(focus.fit(&light, &Scope::new(&camera, 400.0, &slab, &slab, 2048)), Ok(None));
    (focus, camera)
}

#[test]
fn slabs_near_the_view_direction_gain_where_the_paper_s_rule_does_not() {
    for (elevation, ahead) in
        [(10.0, false), (15.0, false), (20.0, false), (25.0, false), (5.0, true), (10.0, true)]
    {
        let (focus, _) = slab_focus(elevation, ahead);
        let texel = |warp| focus.map(&MapOptions::new(2048).with_warp(warp), None).texel.value;
        let [best, paper, tilted, uniform] =
            [Warp::Minimax, Warp::Paper, Warp::PaperTilted, Warp::Uniform].map(texel);
        println!(
            "sun {elevation}° {}: worst texel {best:.3} px, paper {:.1}x, tilted {:.1}x, uniform {:.1}x",
            if ahead { "ahead" } else { "behind" },
            paper / best,
            tilted / best,
            uniform / best
        );
        assert!(paper >= 4.0 * best && uniform >= 4.0 * best);
    }
    // From straight above, the ends decide, and the rule is nearly right.
    let (focus, _) = slab_focus(90.0, false);
    let texel = |warp| focus.map(&MapOptions::new(2048).with_warp(warp), None).texel.value;
    let ratio = texel(Warp::Paper) / texel(Warp::Minimax);
    println!("sun overhead: paper {ratio:.2}x");
    assert!((1.0..2.0).contains(&ratio));
}

fn shift_texels(a: &farsight_shadow::ShadowView, b: &farsight_shadow::ShadowView, points: &[DVec3]) -> f64 {
    let shift = |&p: &DVec3| {
        let (a, b) = (a.map_position(p).unwrap(), b.map_position(p).unwrap());
        (a[0] - b[0]).abs().max((a[1] - b[1]).abs()) * 2048.0
    };
    points.iter().map(shift).fold(0.0, f64::max)
}

#[test]
fn a_turn_of_a_millionth_moves_the_map_by_less_than_a_texel() {
    let mut random = Random::new(8);
    let (mut worst, mut pairs, mut warped, mut modes) = (0.0f64, 0, 0, 0);
    for _ in 0..4000 {
        let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
        let (eye, view, axis) = (v() * 1e5, v(), v().normalize());
        let travel = v().normalize();
        let camera = Camera::look_at(eye, eye + view, DVec3::Z).unwrap();
        let far = 0.1 * 10f64.powf(1.0 + 3.0 * random.unit());
        let slab = [DAabb::new(eye - dvec3(far, far, 0.3 * far), eye + dvec3(far, far, 0.1 * far))];
        // Every angle down to the threshold at which the axes stop following the view.
        let gamma = 10f64.powf(-3.0 * random.unit()) * 1.5;
        let side = (travel - camera.forward() * travel.dot(camera.forward())).normalize();
        let travel = (camera.forward() * gamma.cos() + side * gamma.sin()).normalize();
        let mut focus = Focus::new();
        let mut map = |camera: &Camera, travel: DVec3, previous: Option<&farsight_shadow::ShadowView>| {
            let light = ShadowLight::directional(travel);
            let scope = Scope::new(camera, far, &slab, &slab, 2048);
            (focus.fit(&light, &scope) == Ok(None)).then(|| {
                let view = focus.map(&MapOptions::new(2048), previous);
                (view, focus.corners().iter().map(|&p| p + eye).collect::<Vec<_>>())
            })
        };
        let Some((before, points)) = map(&camera, travel, None) else { continue };
        let turn = DQuat::from_axis_angle(axis, 1e-6);
        let turned = Camera::new(eye, turn * camera.world_from_view()).unwrap();
        let after = [map(&turned, travel, Some(&before)), map(&camera, turn * travel, Some(&before))];
        for (view, _) in after.into_iter().flatten() {
            modes += i32::from((view.kappa > 0.0) != (before.kappa > 0.0));
            warped += i32::from(view.kappa > 0.0);
            worst = worst.max(shift_texels(&before, &view, &points));
            pairs += 1;
        }
    }
    println!("{pairs} turns by 1e-6 rad, {warped} warped: the map moves by at most {worst:.3} texels");
    assert!(pairs > 6000 && warped > 1500 && modes == 0, "{pairs} {warped} {modes}");
    assert!(worst < 1.0, "{worst}");
}

#[test]
fn stable_maps_do_not_swim() {
    let light = ShadowLight::directional(dvec3(0.4, 0.3, -0.8).normalize());
    let start = dvec3(3e5, 5e6, 100.0);
    let ground = [DAabb::new(start - dvec3(300.0, 300.0, 3.0), start + dvec3(300.0, 300.0, -2.0))];
    let mut random = Random::new(2);
    let marks: Vec<DVec3> = (0..200)
        .map(|_| start + dvec3(random.unit() * 60.0 - 30.0, random.unit() * 60.0 - 30.0, -2.0))
        .collect();
    let mut focus = Focus::new();
    let mut phases = |camera: &Camera, warp| {
        assert_eq!(focus.fit(&light, &Scope::new(camera, 100.0, &ground, &ground, 2048)), Ok(None));
        let view = focus.map(&MapOptions::new(2048).with_warp(warp), None);
        // As drawn: in f32.
        let phase = |p: &DVec3| {
            let clip = view.matrix() * (*p - view.origin).as_vec3().extend(1.0);
            [clip.x, clip.y].map(|c| f64::from(0.5 + 0.5 * c / clip.w) * 2048.0)
        };
        for &corner in focus.corners() {
            let [s, t] = view.map_position(corner + view.origin).unwrap();
            assert!((0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t), "{warp:?}");
        }
        marks.iter().map(phase).collect::<Vec<_>>()
    };
    let base = Camera::look_at(start, start + dvec3(1.0, 0.2, -0.1), DVec3::Z).unwrap();
    let mut swimming = [0; 2];
    for i in 0..400 {
        let step = 0.01 * f64::from(i) * dvec3(1.0, -0.4, 0.05);
        let turn = DQuat::from_axis_angle(DVec3::Z, 0.1f64.to_radians() * f64::from(i));
        let camera = Camera::new(start + step, turn * base.world_from_view()).unwrap();
        for (k, warp) in [Warp::Stable, Warp::Minimax].into_iter().enumerate() {
            let (a, b) = (phases(&base, warp), phases(&camera, warp));
            let moved = |(a, b): (&[f64; 2], &[f64; 2])| {
                (0..2).any(|c| {
                    let shift = a[c] - b[c];
                    (shift - shift.round()).abs() > 0.02
                })
            };
            swimming[k] += a.iter().zip(&b).filter(|&(a, b)| moved((a, b))).count();
        }
    }
    println!(
        "marks that change their place in a texel by more than 0.02: stable {}, warped {}",
        swimming[0], swimming[1]
    );
    assert_eq!(swimming[0], 0);
    assert!(swimming[1] > 10_000);
}

#[test]
fn corners_order_and_the_world_s_origin_do_not_matter() {
    let mut random = Random::new(3);
    let mut worst = 0.0f64;
    for _ in 0..500 {
        let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
        let (view, travel, moved) = (v(), v().normalize(), v() * 1e6);
        let boxes: Vec<DAabb> = (0..3)
            .map(|_| {
                let c = v() * 40.0;
                DAabb::new(c - v().abs() * 20.0, c + v().abs() * 20.0)
            })
            .collect();
        let turn = DQuat::from_axis_angle(DVec3::Z, std::f64::consts::FRAC_PI_2);
        let place = |p: DVec3| turn * p + moved;
        let map = |camera: &Camera, travel: DVec3, boxes: &[DAabb]| {
            let mut focus = Focus::new();
            let scope = Scope::new(camera, 80.0, boxes, boxes, 2048);
            (focus.fit(&ShadowLight::directional(travel), &scope) == Ok(None)).then(|| {
                (
                    focus.map(&MapOptions::new(2048), None),
                    focus.corners().to_vec(),
                    focus.axes().unwrap().from_view,
                )
            })
        };
        let camera = Camera::look_at(DVec3::ZERO, view, DVec3::Z).unwrap();
        let Some((a, corners, true)) = map(&camera, travel, &boxes) else { continue };
        let there = Camera::look_at(moved, moved + turn * view, DVec3::Z).unwrap();
        let turned: Vec<DAabb> =
            boxes.iter().rev().map(|b| DAabb::from_points(b.corners().map(place))).collect();
        let (b, _, _) = map(&there, turn * travel, &turned).unwrap();
        for p in corners {
            let (p, q) = (a.map_position(p).unwrap(), b.map_position(place(p)).unwrap());
            worst = worst.max((p[0] - q[0]).abs().max((p[1] - q[1]).abs()) * 2048.0);
        }
    }
    println!("moved by 1e6 and turned: at most {worst:.2e} texels");
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn what_is_lit_anyway_need_not_be_covered() {
    let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
    let light = ShadowLight::directional(dvec3(0.2, 0.1, -1.0).normalize());
    let ground = [DAabb::new(dvec3(-500.0, -500.0, -2.0), dvec3(500.0, 500.0, -1.9))];
    let tower = [DAabb::new(dvec3(30.0, -2.0, -2.0), dvec3(34.0, 2.0, 10.0))];
    let mut focus = Focus::new();
    let scope = Scope::new(&camera, 300.0, &ground, &tower, 2048);
    assert_eq!(focus.fit(&light, &scope), Ok(None));
    let (all, extent) = (focus.map(&MapOptions::new(2048), None), focus.extent());
    assert_eq!(focus.fit(&light, &scope.with_lit_outside()), Ok(None));
    let (tight, small) = (focus.map(&MapOptions::new(2048), None), focus.extent());
    assert!(small.x < 0.1 * extent.x && small.y < 0.1 * extent.y);
    assert!(tight.texel.value < 0.2 * all.texel.value, "{} {}", tight.texel, all.texel);
    // Every point of the ground below the tower, seen along the light, is in the map.
    let mut random = Random::new(1);
    for _ in 0..2000 {
        let top = farsight_geometry::sampling::in_box(&tower[0], random.units());
        let travel = dvec3(0.2, 0.1, -1.0);
        let shadow = top + travel * (top.z + 1.9);
        if camera.project(shadow).is_some_and(|(p, _)| p.x > 0.0 && p.x < 1280.0 && p.y > 0.0 && p.y < 720.0)
        {
            let [s, t] = tight.map_position(shadow).unwrap();
            assert!((0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t), "{shadow}");
        }
    }
}

#[test]
fn bad_input_is_named() {
    let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
    let good = [DAabb::new(DVec3::NEG_ONE, DVec3::ONE * 9.0)];
    let fit = |light: ShadowLight, far: f64, boxes: &[DAabb], side: u32| {
        Focus::new().fit(&light, &Scope::new(&camera, far, &good, boxes, side))
    };
    let sun = ShadowLight::directional(DVec3::NEG_Z);
    let spot = |half, near, range| ShadowLight::spot(DVec3::Z * 9.0, DVec3::NEG_Z, half, near, range);
    assert_eq!(fit(sun, 50.0, &good, 64), Ok(None));
    assert_eq!(fit(spot(0.5, 0.1, 50.0), 50.0, &good, 64), Ok(None));
    for direction in [DVec3::ZERO, DVec3::NAN, DVec3::Z * 2.0, DVec3::INFINITY] {
        let bad = ShadowLight::directional(direction);
        assert!(matches!(fit(bad, 50.0, &good, 64), Err(ShadowError::Direction { .. })));
    }
    for far in [0.0, -1.0, f64::NAN, f64::INFINITY, 0.05] {
        assert!(matches!(fit(sun, far, &good, 64), Err(ShadowError::Far { .. })), "{far}");
    }
    assert!(matches!(fit(sun, 50.0, &good, 0), Err(ShadowError::MapSide)));
    for half in [0.0, -1.0, f64::NAN, 1.57, 3.0] {
        assert!(
            matches!(fit(spot(half, 0.1, 9.0), 50.0, &good, 64), Err(ShadowError::Opening { .. })),
            "{half}"
        );
    }
    for (near, range) in [(0.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (f64::INFINITY, f64::INFINITY)] {
        assert!(matches!(fit(spot(0.5, near, range), 50.0, &good, 64), Err(ShadowError::LightRange { .. })));
    }
    let endless = [good[0], DAabb::new(DVec3::ZERO, DVec3::splat(f64::INFINITY))];
    let error = fit(sun, 50.0, &endless, 64).unwrap_err();
    assert_eq!(error, ShadowError::Bounds { what: "caster", index: 1 });
    // Boxes without points, NaN included, are not there.
    assert_eq!(fit(sun, 50.0, &[DAabb::EMPTY], 64), Ok(Some(farsight_shadow::Skip::NoCaster)));
    assert_eq!(
        fit(sun, 50.0, &[DAabb::new(DVec3::NAN, DVec3::NAN)], 64),
        Ok(Some(farsight_shadow::Skip::NoCaster))
    );
}

/// Ground without thickness was once cut away by its own two sides.
#[test]
fn flat_ground_is_covered_wherever_the_camera_looks() {
    let mut random = Random::new(44);
    let ground = [DAabb::new(dvec3(-300.0, -300.0, 0.0), dvec3(300.0, 300.0, 0.0))];
    let caster = [DAabb::new(dvec3(-300.0, -300.0, 0.0), dvec3(300.0, 300.0, 30.0))];
    let light = ShadowLight::directional(dvec3(0.3, 0.2, -0.6).normalize());
    let mut tested = 0;
    for _ in 0..200 {
        let eye = DVec3::from_array(random.units()) * 9.0 + DVec3::Z * 0.5;
        let camera =
            Camera::look_at(eye, eye + DVec3::from_array(random.units()) - dvec3(0.5, 0.5, 0.8), DVec3::Z)
                .and_then(|c| c.with_range(0.1, 100.0))
                .unwrap();
        let mut focus = Focus::new();
        let skip = focus.fit(&light, &Scope::new(&camera, 100.0, &ground, &caster, 1024)).unwrap();
        let view = skip.is_none().then(|| focus.map(&MapOptions::new(1024), None));
        for _ in 0..40 {
            let px = glam::DVec2::from_array(random.units()) * glam::dvec2(1280.0, 720.0);
            let ray = camera.ray(px);
            let p = ray.at(-ray.origin().z / ray.direction().z);
            let depth = camera.forward().dot(p - eye);
            if ray.direction().z < 0.0 && depth > 0.1 && depth < 99.9 && p.abs().max_element() < 300.0 {
                let view = view.expect("the ground is seen");
                let clip = view.clip_from_relative * (p - view.origin).extend(1.0);
                let n = clip / clip.w;
                assert!(n.x.abs() <= 1.0 && n.y.abs() <= 1.0 && n.z >= 0.0 && n.z <= 1.0, "{n}");
                tested += 1;
            }
        }
    }
    assert!(tested > 2000, "{tested}");
}
