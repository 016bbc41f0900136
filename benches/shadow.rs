//! What shadow maps cost and how well they keep to their figures: each beside what was asked for.
//!
//! Run with `cargo bench --bench shadow` (`-- --quick` for a tenth of the hard configurations, `-- --cost` for the times alone). Times are the least of many runs in thread
//! CPU time.

#[path = "../crates/shadow/tests/corpus/mod.rs"]
mod corpus;

use corpus::Class;
use farsight_geometry::glam::{DVec3, dvec3};
use farsight_geometry::{Camera, DAabb, Projection};
use farsight_raster::thread_cpu_time;
use farsight_shadow::penumbra::coverage::{sphere_past_half_space, sphere_past_sphere};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight, Spacing, Warp, least_cascades, plan_cascades};
use std::hint::black_box;
use std::time::Duration;

fn main() {
    let asked = |flag: &str| std::env::args().any(|a| a == flag);
    println!("{:<62} {:>14} {:>12}", "figure", "reached", "asked");
    if asked("--cost") {
        return costs();
    }
    let quick = asked("--quick");
    chapter();
    slabs();
    costs();
    cascades();
    hard(if quick { 12_000 } else { 120_000 });
}

fn line(what: &str, reached: String, asked: &str) {
    println!("{what:<62} {reached:>14} {asked:>12}");
}

/// Nanoseconds of CPU time per call, the least of 25 batches.
fn nanoseconds(mut work: impl FnMut()) -> f64 {
    const CALLS: u32 = 4000;
    let mut batch = || {
        let start = thread_cpu_time();
        (0..CALLS).for_each(|_| work());
        thread_cpu_time() - start
    };
    let least = (0..25).map(|_| batch()).min().unwrap_or(Duration::ZERO);
    least.as_secs_f64() * 1e9 / f64::from(CALLS)
}

/// Largest dp/ds and dp/dt on the view axis of the set-up of section 3.5, by finite differences of the matrix.
fn chapter() {
    for r in [100.0f64, 400.0] {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y)
            .and_then(|c| c.with_projection(Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_3 }))
            .and_then(|c| c.with_range(1.0, r))
            .and_then(|c| c.with_image(512, 512))
            .expect("the camera is valid");
        let all = [DAabb::from_points([DVec3::ZERO]).inflated(1e5)];
        let mut focus = Focus::new();
        let scope = Scope::new(&camera, r, &all, &all, 1024);
        focus.fit(&ShadowLight::directional(DVec3::NEG_Y), &scope).expect("valid");
        let view = focus.map(&MapOptions::new(1024).with_warp(Warp::Paper).with_border(0.0), None);
        let (mut s, mut t) = (0.0f64, 0.0f64);
        for i in 0..=200 {
            let z = r.powf(f64::from(i) / 200.0).clamp(1.0 + 1e-4, r * (1.0 - 1e-5));
            let at = |x: f64, z: f64| view.map_position(dvec3(x, 0.0, -z)).expect("ahead of the light");
            let h = 1e-5 * z;
            let ds = (at(0.0, z + h)[0] - at(0.0, z - h)[0]).abs() / (2.0 * h);
            let dt = (at(h, z)[1] - at(-h, z)[1]).abs() / (2.0 * h);
            s = s.max(1.0 / (ds * z));
            t = t.max(1.0 / (dt * z) / (2.0 * 30f64.to_radians().tan()));
        }
        let expected = Spacing::best_warp(1.0, r).largest_dp_ds(1.0, r);
        line(
            &format!("dp/ds, dp/dt of LiSPSM by differences, r = {r}"),
            format!("{s:.4} / {t:.3}"),
            &format!("{expected:.3} / {}", r.sqrt()),
        );
    }
}

fn slab(elevation: f64) -> Focus {
    let pitch = 5f64.to_radians();
    let camera = Camera::look_at(DVec3::ZERO, dvec3(pitch.cos(), 0.0, -pitch.sin()), DVec3::Z)
        .and_then(|c| c.with_range(1.0, 400.0))
        .and_then(|c| c.with_image(1920, 1080))
        .expect("the camera is valid");
    let e = elevation.to_radians();
    let boxes = [DAabb::new(dvec3(-1e3, -1e3, -3.0), dvec3(1e3, 1e3, 1.0))];
    let mut focus = Focus::new();
    let light = ShadowLight::directional(dvec3(e.cos(), 0.0, -e.sin()));
    focus.fit(&light, &Scope::new(&camera, 400.0, &boxes, &boxes, 2048)).expect("valid");
    focus
}

fn slabs() {
    for (elevation, asked) in [(10.0, ">= 4"), (15.0, ">= 4"), (25.0, ">= 4"), (90.0, ">= 1.2")] {
        let focus = slab(elevation);
        let texel = |warp| focus.map(&MapOptions::new(2048).with_warp(warp), None).texel.value;
        let ratio = texel(Warp::Paper) / texel(Warp::Minimax);
        line(
            &format!("worst texel, rule of the paper over minimax, sun {elevation}° behind"),
            format!("{ratio:.2}x"),
            asked,
        );
    }
}

fn costs() {
    let camera = Camera::look_at(dvec3(0.0, 2.0, 0.0), dvec3(30.0, 1.0, 0.0), DVec3::Y).expect("valid");
    let ground = [DAabb::new(dvec3(-500.0, -1.0, -500.0), dvec3(500.0, 3.0, 500.0))];
    let sun = ShadowLight::directional(dvec3(0.5, -0.7, 0.2).normalize());
    let spot = ShadowLight::spot(dvec3(40.0, 60.0, 10.0), DVec3::NEG_Y, 0.7, 1.0, 200.0);
    let uniform = MapOptions::new(2048).with_warp(Warp::Uniform);
    let minimax = MapOptions::new(2048);
    for (name, light, asked) in [("sun", sun, "<= 1.0"), ("spot", spot, "")] {
        let scope = Scope::new(&camera, 400.0, &ground, &ground, 2048);
        let mut focus = Focus::new();
        let ns = nanoseconds(|| {
            black_box(focus.fit(black_box(&light), &scope).expect("valid"));
            black_box(focus.map(&uniform, None));
        });
        line(&format!("{name}: matrix with clip, us"), format!("{:.3}", ns * 1e-3), asked);
        let ns = nanoseconds(|| {
            black_box(focus.map(&minimax, None));
        });
        let corners = focus.corners().len();
        line(&format!("{name}: minimax map of {corners} corners, us"), format!("{:.3}", ns * 1e-3), "<= 5");
    }
    let half = nanoseconds(|| {
        black_box(sphere_past_half_space(black_box(0.1), black_box(0.3)));
    });
    let ball = nanoseconds(|| {
        black_box(sphere_past_sphere(black_box(0.1), black_box(0.3), black_box(0.2)));
    });
    line("coverage: sphere past an edge, past a ball, ns", format!("{half:.0} / {ball:.0}"), "");
}

fn cascades() {
    let e = 2.0 * 30f64.to_radians().tan() * 2048.0 / 1080.0;
    let counts = |warped| [1e2, 4e2, 1e3, 1e4].map(|r| least_cascades(r, e, warped).to_string()).join("/");
    line("least log splits, 2048 map, 1080 rows, r 1e2..1e4: uniform", counts(false), "4/6/6/8");
    line("the same, warped", counts(true), "3/4/4/5");
    let camera = Camera::look_at(dvec3(0.0, 2.0, 0.0), dvec3(30.0, 1.0, 0.0), DVec3::Y).expect("valid");
    let ground = [DAabb::new(dvec3(-500.0, -1.0, -500.0), dvec3(500.0, 3.0, 500.0))];
    let sun = ShadowLight::directional(dvec3(0.5, -0.7, 0.2).normalize());
    let scope = Scope::new(&camera, 400.0, &ground, &ground, 2048);
    let options = MapOptions::new(2048);
    let ns = nanoseconds(|| drop(black_box(plan_cascades(&sun, &scope, &options, 2.0, 8))));
    let plan = plan_cascades(&sun, &scope, &options, 2.0, 8).expect("valid").expect("a map is needed");
    line(&format!("plan for 2 px: {} maps, us", plan.cascades.len()), format!("{:.1}", ns * 1e-3), "");
}

fn hard(per_class: u64) {
    for class in Class::ALL {
        let o = corpus::run(class, 1 << 40, per_class);
        let bad = o.not_finite + o.outside + o.wrong_rays;
        line(
            &format!("hard {class:?}: failures in {} configurations, {} maps", o.tried, o.maps),
            bad.to_string(),
            "0",
        );
        line(
            "    texels off at 4096, where f32 resolves them / anywhere",
            format!("{:.4} / {:.2}", o.shift_resolved, o.shift),
            "<= 0.01",
        );
    }
}
