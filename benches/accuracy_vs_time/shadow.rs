//! Shadow maps: warp, side and cascades against where edges lie; soft shadows: methods against a densely sampled light.

#[path = "../../examples/shadow/logarithmic.rs"]
mod logarithmic;
#[path = "../../examples/shadow/offset.rs"]
mod offset;
#[path = "../../examples/shadow/posts.rs"]
mod posts;
#[path = "../../examples/shadow/soft.rs"]
mod soft;

use super::row::{Row, timed};
use farsight_geometry::accuracy::{Counters, ErrorBound, Norm, Unit};
use farsight_geometry::glam::DVec3;
use farsight_geometry::ray::SceneCaster;
use farsight_geometry::scene::{Light, Scene};
use farsight_geometry::{Camera, DAabb};
use farsight_raster::{Rasteriser, ShadowMap, ShadowOptions};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight, ShadowView, Warp, log_splits};
use logarithmic::Logarithmic;
use soft::Soft;

/// Height of the sun, in degrees.
const ELEVATION: f64 = 35.0;

pub fn rows(quick: bool) -> Vec<Row> {
    let (width, height) = if quick { (480, 270) } else { (960, 540) };
    // Where a coarse texel happens to lie decides much; the mean over several suns does not depend on it.
    let settings = [50.0, 56.0, 62.0, 68.0, 74.0, 80.0, 86.0, 92.0].map(|a| Setting::new(width, height, a));
    let sides = [512, 1024, 2048, 4096];
    let warps = [
        ("uniform", Warp::Uniform),
        ("LiSPSM", Warp::Paper),
        ("PSM", Warp::Perspective),
        ("minimax", Warp::Minimax),
    ];
    let runs = if quick { 2 } else { 5 };
    let mut rows = Vec::new();
    for (name, warp) in warps {
        rows.extend(
            sides.map(|side| row(&settings, format!("map side, {name}"), side.into(), side, 1, warp, runs)),
        );
    }
    rows.extend(sides.map(|side| logarithmic_row(&settings, side, runs)));
    for (name, warp) in [("uniform", Warp::Uniform), ("minimax", Warp::Minimax)] {
        let splits = [1, 2, 4];
        rows.extend(
            splits
                .map(|k| row(&settings, format!("cascades of 1024, {name}"), k.into(), 1024, k, warp, runs)),
        );
    }
    rows.extend(soft_rows(quick));
    rows
}

struct Setting {
    scene: Scene,
    camera: Camera,
    boxes: Vec<DAabb>,
    truth: offset::Truth,
    direction: DVec3,
    name: String,
}

impl Setting {
    fn new(width: u32, height: u32, azimuth: f64) -> Self {
        let scene = posts::scene(ELEVATION, azimuth);
        let camera = posts::camera(width, height).expect("the camera is valid");
        let Light::Directional { direction, .. } = scene.lights()[0] else {
            unreachable!("posts have a sun")
        };
        let caster = SceneCaster::new(&scene).expect("the scene is valid");
        let truth = offset::truth(&scene, &caster, &camera, direction);
        let boxes = scene.instance_bounds();
        Self { scene, camera, boxes, truth, direction, name: format!("posts {height} rows") }
    }

    /// A map for each range of distances that needs one.
    fn maps(&self, side: u32, cascades: u32, warp: Warp) -> Vec<(f64, ShadowView, ShadowMap)> {
        let light = ShadowLight::directional(self.direction);
        let (near, far) = (self.camera.near(), self.camera.far());
        let map = |(from, to): (f64, f64)| {
            let camera = self.camera.with_range(from, to).expect("ranges grow");
            let mut focus = Focus::new();
            let scope = Scope::new(&camera, to, &self.boxes, &self.boxes, side);
            if focus.fit(&light, &scope).expect("the scene is valid").is_some() {
                return None;
            }
            let view = focus.map(&MapOptions::new(side).with_warp(warp), None);
            let options = ShadowOptions::default();
            let mut map =
                ShadowMap::new(side, view.clip_from_relative, view.origin, -self.direction, options)
                    .expect("the size is allowed");
            map.draw_scene(&mut Rasteriser::new(), &self.scene);
            Some((to, view, map))
        };
        log_splits(near, far, cascades).filter_map(map).collect()
    }

    /// Mean offset of edges in pixels.
    fn offset(&self, maps: &[(f64, ShadowView, ShadowMap)]) -> f64 {
        let lit = |seen: &offset::Seen| {
            let depth = self.camera.forward().dot(seen.point - self.camera.eye());
            maps.iter().find(|m| depth <= m.0).is_none_or(|(_, view, map)| offset::lit(map, view, seen))
        };
        offset::compare(&self.truth, lit).0.mean_px
    }
}

/// Times and counters are those of the first sun, claims the largest, offsets the mean over all.
fn row(
    settings: &[Setting],
    knob: String,
    value: f64,
    side: u32,
    cascades: u32,
    warp: Warp,
    runs: usize,
) -> Row {
    let (first, times) = timed(runs, || settings[0].maps(side, cascades, warp));
    let mut counters = Counters::new();
    counters.add("maps", first.len() as u64);
    let texels = first.len() as u64 * u64::from(side).pow(2);
    counters.add("texels", texels);
    let (mut texel, mut measured) = (0.0f64, 0.0);
    for setting in settings {
        let maps = setting.maps(side, cascades, warp);
        texel = maps.iter().map(|m| m.1.texel.value).fold(texel, f64::max);
        measured += setting.offset(&maps) / settings.len() as f64;
    }
    Row {
        krate: "shadow",
        scene: settings[0].name.clone(),
        knob,
        value,
        claimed: ErrorBound::estimated(texel * stretch(), Unit::Pixels).with_norm(Norm::Mean),
        measured,
        times,
        bytes: 4 * texels,
        counters,
    }
}

/// As [`row`], for the map that no matrix can give.
fn logarithmic_row(settings: &[Setting], side: u32, runs: usize) -> Row {
    let map = |s: &Setting| {
        let mut focus = Focus::new();
        let scope = Scope::new(&s.camera, s.camera.far(), &s.boxes, &s.boxes, side);
        let skip = focus.fit(&ShadowLight::directional(s.direction), &scope).expect("the scene is valid");
        assert_eq!(skip, None, "posts throw shadows");
        Logarithmic::new(&s.scene, &s.camera, &focus, side).expect("the size is allowed")
    };
    let (first, times) = timed(runs, || map(&settings[0]));
    let mut counters = Counters::new();
    counters.add("maps", 1);
    counters.add("texels", u64::from(side).pow(2));
    counters.add("triangles", first.triangles as u64);
    let (mut texel, mut measured) = (0.0f64, 0.0);
    for setting in settings {
        let map = map(setting);
        texel = texel.max(map.texel_px);
        measured += offset::compare(&setting.truth, |seen| map.lit(seen)).0.mean_px / settings.len() as f64;
    }
    Row {
        krate: "shadow",
        scene: settings[0].name.clone(),
        knob: "map side, logarithmic".into(),
        value: side.into(),
        claimed: ErrorBound::estimated(texel * stretch(), Unit::Pixels).with_norm(Norm::Mean),
        measured,
        times,
        bytes: 4 * u64::from(side).pow(2),
        counters,
    }
}

/// On the ground, texels are stretched by the sun's height.
fn stretch() -> f64 {
    1.0 / ELEVATION.to_radians().sin()
}

/// Soft shadows of a disk light: rays, silhouettes, one blur, none.
fn soft_rows(quick: bool) -> Vec<Row> {
    let (side, dense, runs) = if quick { (96, 24, 2) } else { (192, 40, 3) };
    let soft = Soft::new(side);
    let exact = soft.sampled(dense);
    let pixels = u64::from(side).pow(2);
    let row = |knob: &str, value: f64, claimed: f64, rays: u64, work: &dyn Fn() -> Vec<f64>| {
        let (picture, times) = timed(runs, work);
        let mut counters = Counters::new();
        counters.add("rays", rays * pixels);
        Row {
            krate: "shadow",
            scene: format!("soft {side}²"),
            knob: knob.into(),
            value,
            claimed: ErrorBound::estimated(claimed, Unit::Fraction).with_norm(Norm::Rms),
            measured: soft::rms(&picture, &exact),
            times,
            bytes: 8 * pixels,
            counters,
        }
    };
    // In the penumbra, about a third of this picture, n² strata are off by some n^-1.5 of the light.
    let sampled = |n: u32| {
        row("rays to the light, n²", n.into(), 0.6 * f64::from(n).powf(-1.5), u64::from(n * n), &|| {
            soft.sampled(n)
        })
    };
    let mut rows: Vec<Row> = [2, 4, 8, 16].map(sampled).into();
    rows.push(row("hard", 1.0, 0.5, 1, &|| soft.hard()));
    rows.push(row("one blur", 1.0, 0.5, 1, &|| soft.blurred()));
    rows.push(row("silhouettes", 1.0, 0.1, 1, &|| soft.outlines()));
    rows
}
