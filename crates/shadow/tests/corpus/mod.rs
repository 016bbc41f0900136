//! Adversarial configurations for shadow maps, and what must hold of each. Uses the crate's public face only.

use farsight_geometry::camera::ClipConvention;
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, DAabb, Projection};
use farsight_shadow::glam::{DMat4, DVec3, DVec4, Vec4};
use farsight_shadow::{CubeFace, Focus, MapOptions, Scope, ShadowLight, ShadowView, Warp};
use std::f64::consts::{PI, TAU};

/// A class of configurations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Angles of 20° to 90°, r to 1e3, eye within 10 m of the origin.
    Plain,
    /// Angle between light and view (or its reverse) 1e-8 to 1e-2 rad.
    NearlyParallel,
    /// Exactly parallel.
    Parallel,
    /// Far over near to 1e6.
    Deep,
    /// Eye 1e4 to 1e6 m from the origin.
    FarOut,
    /// Points, lines, planes, tiny and huge boxes.
    Flat,
    /// Spot lights anywhere: in the view, at the eye, far away.
    Spot,
    /// Cube faces around a light in or near the view.
    Cube,
    /// Everything at once, openings of 20° to 150°, several boxes.
    Everything,
}

impl Class {
    pub const ALL: [Self; 9] = [
        Self::Plain,
        Self::NearlyParallel,
        Self::Parallel,
        Self::Deep,
        Self::FarOut,
        Self::Flat,
        Self::Spot,
        Self::Cube,
        Self::Everything,
    ];
}

/// What was seen over a number of configurations.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outcome {
    /// Configurations tried, and those that gave a map (the others were skipped).
    pub tried: u64,
    pub maps: u64,
    /// Entries or positions that were not finite, or a singular matrix.
    pub not_finite: u64,
    /// Corners of the receivers that `f32` puts outside the map.
    pub outside: u64,
    /// Points whose place in the map, depth or monotony along the light is wrong.
    pub wrong_rays: u64,
    /// Largest distance in texels of a 4096 map between the place of a point in `f32` (matrix and point rounded) and in `f64`.
    pub shift: f64,
    /// The same where a texel spans at least 1000 steps of `f32` coordinates, so that they could be better than 0.01 texel.
    pub shift_resolved: f64,
    /// Points of the latter kind.
    pub resolved: u64,
}

fn log_uniform(u: f64, low: f64, high: f64) -> f64 {
    low * (high / low).powf(u)
}

fn direction(random: &mut Random) -> DVec3 {
    let [u, v] = random.units::<2>();
    let z = 2.0 * u - 1.0;
    let (sin, cos) = (TAU * v).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

/// A configuration: camera, shadow distance, light, boxes.
pub struct Setup {
    pub camera: Camera,
    pub far: f64,
    pub light: ShadowLight,
    pub receivers: Vec<DAabb>,
    pub casters: Vec<DAabb>,
    pub options: MapOptions,
}

/// The configuration with this seed.
pub fn setup(class: Class, seed: u64) -> Setup {
    let mut random = Random::new(seed ^ ((class as u64 + 1) << 56));
    let everything = class == Class::Everything;
    let u: [f64; 12] = random.units();
    let r = match class {
        Class::Deep => log_uniform(u[0], 1e3, 1e6),
        Class::Everything => log_uniform(u[0], 2.0, 1e6),
        _ => log_uniform(u[0], 2.0, 1e3),
    };
    let near = if everything { log_uniform(u[1], 1e-3, 10.0) } else { 0.1 };
    let far = near * r;
    let reach = match class {
        Class::FarOut | Class::Everything => log_uniform(u[2], 1e4, 1e6),
        _ => 10.0,
    };
    let eye = direction(&mut random) * reach;
    let fov_y = if everything { (20.0 + 130.0 * u[3]).to_radians() } else { 1.0 };
    let view = direction(&mut random);
    let up = if view.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
    let camera = Camera::look_at(eye, eye + view, up)
        .and_then(|c| c.with_range(near, if u[4] < 0.5 { f64::INFINITY } else { far * 2.0 }))
        .and_then(|c| c.with_image(1920, 1080))
        .and_then(|c| c.with_projection(Projection::Perspective { fov_y }))
        .and_then(|c| match everything && u[5] < 0.1 {
            true => c.with_range(near, far * 2.0)?.with_projection(Projection::Orthographic { height: far }),
            false => Ok(c),
        })
        .expect("the camera is valid");
    let view = camera.forward();
    let gamma = match class {
        Class::Plain | Class::Deep => (20.0 + 70.0 * u[6]).to_radians(),
        Class::Parallel => 0.0,
        Class::NearlyParallel => log_uniform(u[6], 1e-8, 1e-2),
        _ => PI * u[6],
    };
    let gamma = if u[7] < 0.5 { gamma } else { PI - gamma };
    let aside = {
        let (a, b) = view.any_orthonormal_pair();
        let (sin, cos) = (TAU * u[8]).sin_cos();
        a * cos + b * sin
    };
    let travel = if class == Class::Parallel {
        if u[7] < 0.5 { view } else { -view }
    } else {
        (view * gamma.cos() + aside * gamma.sin()).normalize()
    };
    let as_spot = class == Class::Spot || (everything && u[9] < 0.3);
    let light = if as_spot {
        let from = match (u[10] * 4.0) as u32 {
            0 => eye,
            1 => eye + view * far * 0.3,
            2 => eye + direction(&mut random) * far * 0.5,
            _ => eye - travel * far * 10.0,
        };
        ShadowLight::spot(from, travel, 0.05 + 1.2 * u[11], far * 1e-3, f64::INFINITY)
    } else if class == Class::Cube {
        let from =
            if u[10] < 0.5 { eye + view * far * u[10] } else { eye + direction(&mut random) * far * 0.2 };
        let face = CubeFace::ALL[(u[11] * 6.0) as usize];
        ShadowLight::cube_face(from, face, 1e-3, far * 1e-3, far)
    } else {
        ShadowLight::directional(travel)
    };
    let boxes = if everything { 1 + (u[11] * 4.0) as usize } else { 1 };
    let flat = class == Class::Flat || (everything && u[10] < 0.3);
    let mut a_box = || {
        let v: [f64; 8] = random.units();
        let size = far * if flat { log_uniform(v[0], 1e-6, 1e3) } else { 0.3 + 2.0 * v[0] };
        let mut half = DVec3::new(1.0, 0.05 + v[1], 0.3 + v[2]) * 0.5 * size;
        if flat {
            // Points, lines along an axis, flat boxes.
            half *=
                DVec3::new((v[5] < 0.6) as u8 as f64, (v[6] < 0.3) as u8 as f64, (v[7] < 0.6) as u8 as f64);
        }
        let center = eye + view * far * (0.2 + 0.6 * v[3]) + aside * far * 0.2 * (v[4] - 0.5);
        DAabb::new(center - half, center + half)
    };
    let receivers: Vec<DAabb> = (0..boxes).map(|_| a_box()).collect();
    let casters =
        if u[4] < 0.3 { receivers.clone() } else { receivers.iter().copied().chain([a_box()]).collect() };
    let warps = [Warp::Minimax, Warp::Uniform, Warp::Paper, Warp::PaperTilted, Warp::LeastProduct];
    let warp = if u[8] < 0.6 { Warp::Minimax } else { warps[(u[9] * 5.0) as usize] };
    let convention = ClipConvention::all().nth((u[7] * 16.0) as usize).expect("sixteen conventions");
    let options = MapOptions::new(4096).with_warp(warp).with_convention(convention);
    Setup { camera, far, light, receivers, casters, options }
}

/// Tries the configurations with the seeds from `first` on.
pub fn run(class: Class, first: u64, count: u64) -> Outcome {
    let mut focus = Focus::new();
    let mut outcome = Outcome::default();
    for seed in first..first + count {
        let s = setup(class, seed);
        let scope = Scope::new(&s.camera, s.far, &s.receivers, &s.casters, 4096);
        let scope = if seed % 5 == 0 { scope.with_lit_outside() } else { scope };
        outcome.tried += 1;
        if focus.fit(&s.light, &scope).expect("the configuration is valid").is_none() {
            outcome.maps += 1;
            let view = focus.map(&s.options, None);
            judge(&focus, &view, &s, &mut outcome);
        }
    }
    outcome
}

fn judge(focus: &Focus, view: &ShadowView, s: &Setup, outcome: &mut Outcome) {
    let matrix = view.matrix();
    let finite = matrix.is_finite() && view.clip_from_relative.is_finite() && view.texel.value.is_finite();
    if !finite || normalised_determinant(&view.clip_from_relative) < 1e-13 {
        outcome.not_finite += 1;
        return;
    }
    let ray = |p: DVec3| match s.light {
        ShadowLight::Spot { position, .. } => p - (position - view.origin),
        ShadowLight::Directional { direction } => direction * s.far,
        _ => unreachable!("no other lights"),
    };
    for &p in focus.corners() {
        let exact = view.clip_from_relative * p.extend(1.0);
        let rounded: Vec4 = matrix * p.as_vec3().extend(1.0);
        let inside = rounded.w > 0.0 && rounded.x.abs() <= rounded.w && rounded.y.abs() <= rounded.w;
        outcome.outside += u64::from(!inside);
        let (a, b) = (exact / exact.w, rounded.as_dvec4() / f64::from(rounded.w));
        let shift = (a.x - b.x).abs().max((a.y - b.y).abs()) * 2048.0;
        if !shift.is_finite() {
            outcome.not_finite += 1;
            continue;
        }
        outcome.shift = outcome.shift.max(shift);
        if steps_per_texel(view, p, &s.light) >= 1000.0 {
            outcome.resolved += 1;
            outcome.shift_resolved = outcome.shift_resolved.max(shift);
        }
        // A little farther along the ray: the same place, farther from the light.
        let next: DVec4 = view.clip_from_relative * (p + ray(p) * 1e-3).extend(1.0);
        let next_place = next / next.w;
        let moved = (next_place.x - a.x).abs().max((next_place.y - a.y).abs()) * 2048.0;
        let (near, far) = s.options.convention.near_far_depth();
        let deeper = (next_place.z - a.z) * (far - near) > 0.0;
        outcome.wrong_rays += u64::from(moved > 0.01 || !deeper);
    }
}

/// How many steps of `f32` coordinates (of a point relative to the eye, or to a spot light) a texel spans.
fn steps_per_texel(view: &ShadowView, p: DVec3, light: &ShadowLight) -> f64 {
    let offset = match *light {
        ShadowLight::Spot { position, .. } => (position - view.origin).abs().element_sum(),
        _ => 0.0,
    };
    let Some([s, t]) = view.gradients(view.origin + p) else { return 0.0 };
    let step = f64::from(f32::EPSILON) * (p.abs().element_sum() + offset);
    1.0 / (s.length().max(t.length()) * 4096.0 * step)
}

/// |det| after rows and columns were brought to unit length: zero for a singular matrix, whatever its units.
fn normalised_determinant(m: &DMat4) -> f64 {
    let unit_columns = |m: DMat4| {
        let unit = |c: DVec4| c / c.length().max(1e-300);
        DMat4::from_cols(unit(m.x_axis), unit(m.y_axis), unit(m.z_axis), unit(m.w_axis))
    };
    let mut m = *m;
    for _ in 0..4 {
        m = unit_columns(unit_columns(m).transpose()).transpose();
    }
    m.determinant().abs()
}
