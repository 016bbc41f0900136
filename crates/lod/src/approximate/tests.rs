//! The loop over recorded paths, against exhaustive simulation.

use super::*;
use crate::ImpostorOptions;
use farsight_geometry::hard_cases;
use farsight_geometry::sampling::Random;
use glam::{DAffine3, DQuat};
use std::time::Duration;

/// An engine that only counts, and whose costs are a formula.
#[derive(Clone, Copy)]
struct Model {
    ns_per_triangle: u64,
    create_us: u64,
    separable: bool,
    rendered: u32,
}

impl Model {
    fn costs_of(&self, work: &Work) -> Costs {
        let ns = Duration::from_nanos;
        Costs {
            extract: ns(20_000 + 5 * work.triangles as u64),
            draw_geometry: ns(2_000 + self.ns_per_triangle * work.triangles as u64),
            create_impostor: ns(1000 * self.create_us
                + self.ns_per_triangle * work.triangles as u64
                + work.texels),
            draw_impostor: ns(2_000 + work.texels / 2),
        }
    }
}

impl ImpostorRenderer for Model {
    type Image = u32;
    type Error = String;
    fn render(&mut self, _: u32, _: &ImpostorView, _: &Placement, _: &[[u32; 3]]) -> Result<u32, String> {
        self.rendered += 1;
        Ok(self.rendered)
    }
}

impl Engine for Model {
    fn costs(&mut self, _: u32, work: &Work) -> Costs {
        self.costs_of(work)
    }
    fn is_separable(&mut self, _: u32, _: &Frustum) -> bool {
        self.separable
    }
}

const FRAMES: usize = 400;

fn camera(eye: DVec3) -> Camera {
    Camera::look_at(eye, DVec3::ZERO, DVec3::Z).and_then(|c| c.with_image(1920, 1080)).unwrap()
}

/// Eyes frame by frame, in units of the object's radius, 60 a second.
fn path(name: &str, scale: f64) -> Vec<DVec3> {
    let mut random = Random::new(77);
    let mut walk = (DVec3::new(scale, 0.0, 1.0), DVec3::ZERO);
    let eye = |i: usize| {
        let t = i as f64;
        match name {
            "static" => DVec3::new(scale, 1.0, 2.0),
            "strafing" => DVec3::new(scale, 0.02 * (t - 250.0), 1.0),
            "orbit" => DVec3::new((0.005 * t).cos(), (0.005 * t).sin(), 0.2) * scale,
            "approach" => DVec3::new(3.0 + scale * (0.5 + 0.5 * (0.012 * t).cos()), 0.3, 1.0),
            "stop and go" => {
                DVec3::new(scale, 0.03 * t.min(100.0) + 0.03 * (t - 250.0).clamp(0.0, 120.0), 1.0)
            }
            "trembling" => DVec3::new(scale, 0.01 * t + 0.02 * (1.1 * t).sin(), 1.0 + 0.02 * (0.7 * t).cos()),
            _ => unreachable!("{name}"),
        }
    };
    if name != "walk" {
        return (0..FRAMES).map(eye).collect();
    }
    (0..FRAMES)
        .map(|_| {
            let push = DVec3::from_array(random.units()) * 2.0 - 1.0;
            walk.1 = walk.1 * 0.98 + push * 0.003;
            walk.0 += walk.1;
            walk.0
        })
        .collect()
}

const PATHS: [&str; 7] = ["static", "strafing", "orbit", "approach", "stop and go", "trembling", "walk"];

/// What was drawn along a path.
struct Run {
    ms: f64,
    kinds: Vec<Kind>,
    /// Achieved and predicted frames of all pictures that expired.
    served: Vec<(f64, f64)>,
    most_error_px: f64,
}

fn run(mesh: &TriangleMesh, eyes: &[DVec3], model: Model, options: ApproximationOptions) -> Run {
    let hierarchy = VertexHierarchy::build(mesh).unwrap();
    let placement = Placement::new(&DAffine3::IDENTITY, mesh.origin()).unwrap();
    let mut cut = Cut::new(&hierarchy);
    let mut engine = model;
    let mut approximations = Approximations::new(1 << 26, options).unwrap();
    let mut run = Run { ms: 0.0, kinds: vec![], served: vec![], most_error_px: 0.0 };
    let mut serving: Option<((Kind, DVec3), f64, usize)> = None;
    for (i, &eye) in eyes.iter().enumerate() {
        approximations.next_frame();
        let mut subject = Subject {
            object: 3,
            version: 0,
            view: 0,
            light: LightKey::custom(1),
            mesh,
            hierarchy: &hierarchy,
            cut: &mut cut,
            placement: &placement,
        };
        let shown = approximations.approximate(&mut subject, &camera(eye), &mut engine).unwrap();
        run.ms += cost_of(shown.approximation, shown.fresh, &model);
        run.kinds.push(shown.approximation.kind());
        run.most_error_px = run.most_error_px.max(shown.error.value);
        let this = (shown.approximation.kind(), shown.approximation.eye());
        if let Some((kind_and_eye, predicted, since)) = serving.filter(|s| s.0 != this || shown.fresh) {
            if kind_and_eye.0 == Kind::Impostor {
                run.served.push(((i - since) as f64, predicted));
            }
            serving = None;
        }
        if shown.fresh {
            serving = Some((this, shown.predicted_frames, i));
        }
    }
    run
}

fn work_of<I>(approximation: &Approximation<I>) -> Work {
    match approximation {
        Approximation::Geometry { triangles, .. } => Work { triangles: triangles.len(), texels: 0 },
        Approximation::Impostor { view, triangles, .. } => {
            Work { triangles: *triangles, texels: view.size().into_iter().map(u64::from).product() }
        }
    }
}

/// What a frame with this takes.
fn cost_of<I>(approximation: &Approximation<I>, fresh: bool, model: &Model) -> f64 {
    let ms = |d: Duration| d.as_secs_f64() * 1e3;
    let costs = model.costs_of(&work_of(approximation));
    match (approximation.kind(), fresh) {
        (Kind::Geometry, true) => ms(costs.extract + costs.draw_geometry),
        (Kind::Geometry, false) => ms(costs.draw_geometry),
        (Kind::Impostor, true) => ms(costs.extract + costs.create_impostor + costs.draw_impostor),
        (Kind::Impostor, false) => ms(costs.draw_impostor),
    }
}

/// The least total cost of all ways to make an approximation of either kind in any frame and to draw it while it serves, knowing the whole path.
fn optimum(mesh: &TriangleMesh, eyes: &[DVec3], model: Model, options: &ApproximationOptions) -> f64 {
    let hierarchy = VertexHierarchy::build(mesh).unwrap();
    let placement = Placement::new(&DAffine3::IDENTITY, mesh.origin()).unwrap();
    let bounds = placement.bounds(&mesh.bounds());
    let mut best = vec![0.0; eyes.len() + 1];
    for i in (0..eyes.len()).rev() {
        let camera = camera(eyes[i]);
        let now = Now { options, bounds, placement, camera: &camera, eye: eyes[i] };
        let mut cut = Cut::new(&hierarchy);
        let tolerance = Tolerance::pixels(options.tolerance_px, &camera).unwrap();
        cut.update(&hierarchy, &placement.observer(eyes[i]).unwrap(), &tolerance).unwrap();
        let subject = Subject {
            object: 3,
            version: 0,
            view: 0,
            light: LightKey::NONE,
            mesh,
            hierarchy: &hierarchy,
            cut: &mut cut,
            placement: &placement,
        };
        best[i] = f64::INFINITY;
        for kind in [Kind::Geometry, Kind::Impostor] {
            let Ok(made) = now.make(&subject, kind, tolerance.tau, &mut model.clone()) else { continue };
            if let Approximation::Impostor { view, .. } = &made
                && view.resolution_ratio(&camera) > options.decision.max_ratio
            {
                continue;
            }
            let (first, more) = (cost_of(&made, true, &model), cost_of(&made, false, &model));
            let mut sum = first;
            for j in i + 1..=eyes.len() {
                best[i] = f64::min(best[i], sum + best[j]);
                let serves = |eye: DVec3| {
                    let camera = self::camera(eye);
                    Now { options, bounds, placement, camera: &camera, eye }.judge(&made).is_some()
                };
                if j < eyes.len() && !serves(eyes[j]) {
                    break;
                }
                sum += more;
            }
        }
    }
    best[0]
}

#[test]
fn decisions_cost_little_more_than_the_best_in_hindsight() {
    let mesh = hard_cases::bumpy_ball(10);
    let options = ApproximationOptions::default();
    let (mut total, mut least, mut both) = (0.0, 0.0, 0);
    for model in [
        Model { ns_per_triangle: 40, create_us: 60, separable: true, rendered: 0 },
        Model { ns_per_triangle: 120, create_us: 200, separable: true, rendered: 0 },
        Model { ns_per_triangle: 400, create_us: 400, separable: true, rendered: 0 },
    ] {
        for name in PATHS {
            for scale in [8.0, 30.0, 100.0] {
                let eyes = path(name, scale);
                let run = run(&mesh, &eyes, model, options);
                let best = optimum(&mesh, &eyes, model, &options);
                let pictures = run.kinds.iter().filter(|k| **k == Kind::Impostor).count();
                println!(
                    "{:3} ns, {name:>12} at {scale:3}: {:8.3} ms, best {best:8.3}, regret {:5.1} %, pictures in {pictures} frames",
                    model.ns_per_triangle,
                    run.ms,
                    100.0 * (run.ms / best - 1.0)
                );
                assert!(run.most_error_px <= 1.25 * options.tolerance_px + 3.0);
                // Going back to what is cached may beat every single way that the simulation knows.
                (total, least) = (total + run.ms, least + best.min(run.ms));
                both += u32::from(pictures > 0 && pictures < FRAMES - 1);
            }
        }
    }
    println!(
        "in all {total:.1} ms, best {least:.1}: regret {:.1} %; {both} runs used both kinds",
        100.0 * (total / least - 1.0)
    );
    assert!(total <= 1.1 * least);
    assert!(both >= 10);
}

#[test]
fn a_static_eye_changes_nothing_any_more() {
    let mesh = hard_cases::bumpy_ball(10);
    for (ns_per_triangle, create_us) in [(1, 900), (40, 60), (120, 200), (400, 400)] {
        for scale in [3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 60.0, 100.0] {
            let model = Model { ns_per_triangle, create_us, separable: true, rendered: 0 };
            let still = run(&mesh, &path("static", scale), model, ApproximationOptions::default());
            let flips = still.kinds[1..].windows(2).filter(|k| k[0] != k[1]).count();
            assert_eq!(flips, 0, "{ns_per_triangle} at {scale}");
            // Stopping may change the kind, once.
            let eyes: Vec<DVec3> =
                (0..300).map(|i| DVec3::new(scale, 0.05 * f64::from(i.min(100)), 1.0)).collect();
            let stopped = run(&mesh, &eyes, model, ApproximationOptions::default());
            let flips = stopped.kinds[100..].windows(2).filter(|k| k[0] != k[1]).count();
            assert!(flips <= 1 && stopped.kinds[120..].windows(2).all(|k| k[0] == k[1]), "{flips}");
        }
    }
}

#[test]
fn predicted_frames_are_within_a_factor_of_two_on_straight_paths() {
    let mesh = hard_cases::bumpy_ball(10);
    let mut random = Random::new(78);
    let (mut count, mut worst) = (0, 1.0f64);
    for i in 0..120 {
        let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
        let start = v().normalize() * (8.0 + 40.0 * f64::from(i % 5));
        let step = v().normalize() * start.length() * 10f64.powf(-3.5 + 0.25 * f64::from(i % 6));
        let eyes: Vec<DVec3> = (0..400).map(|k| start + step * f64::from(k)).collect();
        if eyes.iter().any(|e| e.length() < 3.0) {
            continue;
        }
        let model = Model { ns_per_triangle: 4000, create_us: 10, separable: true, rendered: 0 };
        for (achieved, predicted) in run(&mesh, &eyes, model, ApproximationOptions::default()).served {
            count += 1;
            // Whole frames: one more or less is no error.
            let ratio = (predicted / (achieved + 1.0)).max((achieved - 1.0) / predicted);
            worst = worst.max(ratio);
            assert!(ratio <= 2.0, "path {i}: {predicted} predicted, {achieved} achieved");
        }
    }
    println!("{count} pictures, worst ratio {worst:.2}");
    assert!(count > 300);
}

#[test]
fn what_does_not_suit_a_picture_stays_triangles() {
    let mesh = hard_cases::bumpy_ball(10);
    let model = Model { ns_per_triangle: 4000, create_us: 10, separable: false, rendered: 0 };
    let blocked = run(&mesh, &path("static", 30.0), model, ApproximationOptions::default());
    assert!(blocked.kinds.iter().all(|k| *k == Kind::Geometry));
    let model = Model { separable: true, ..model };
    let near = run(&mesh, &path("static", 4.0), model, ApproximationOptions::default());
    assert!(near.kinds.iter().all(|k| *k == Kind::Geometry), "too large a share of the image");
    // So far that one vertex stands for all.
    let far = run(&mesh, &[DVec3::X * 1e5; 3], model, ApproximationOptions::default());
    assert!(far.kinds.iter().all(|k| *k == Kind::Geometry));
}

/// The farthest, in pixels, that a vertex in the image is seen from where it belongs, and how many vertices are: displaced by a fresh cut for the eye that this was made for,
/// and for a picture moved to its plane along the line from there.
fn farthest_off(
    hierarchy: &VertexHierarchy,
    placement: &Placement,
    camera: &Camera,
    shown: &Approximation<u32>,
) -> (f64, usize) {
    let (eye, share) = match shown {
        Approximation::Geometry { eye, share, .. } => (*eye, *share),
        Approximation::Impostor { view, share, .. } => (view.eye(), *share),
    };
    let mut cut = Cut::new(hierarchy);
    let observer = placement.observer(placement.to_world(eye)).unwrap();
    cut.update(hierarchy, &observer, &Tolerance::uniform(share)).unwrap();
    let (mut most, mut seen) = (0.0f64, 0);
    for (v, p) in hierarchy.positions.iter().enumerate().step_by(1 + hierarchy.positions.len() / 40) {
        let own = placement.to_world(*placement.stretch() * p.as_dvec3());
        let moved = *placement.stretch() * crate::tests::place_of(hierarchy, &cut, v);
        let drawn = match shown {
            Approximation::Geometry { .. } => placement.to_world(moved),
            Approximation::Impostor { view, .. } => {
                let quad = view.corners();
                let normal = (quad[1] - quad[0]).cross(quad[3] - quad[0]).normalize();
                let ray = moved - eye;
                placement.to_world(eye + ray * (normal.dot(quad[0] - eye) / normal.dot(ray)))
            }
        };
        let (Some((a, _)), Some((b, _))) = (camera.project(own), camera.project(drawn)) else { continue };
        let [width, height] = [camera.width(), camera.height()].map(f64::from);
        if a.x >= 0.0 && a.y >= 0.0 && a.x <= width && a.y <= height {
            (most, seen) = (most.max(a.distance(b)), seen + 1);
        }
    }
    (most, seen)
}

/// Everything at once in every state: moving, turning, stretched objects of the catalogue, a small cache, lights that turn.
#[test]
fn hard_cases_are_drawn_with_a_bounded_error() {
    let mut random = Random::new(79);
    let options = ApproximationOptions { tolerance_px: 2.0, ..ApproximationOptions::default() };
    let (mut pictures, mut uncached, mut measured, mut worst) = (0, 0, 0, 0.0f64);
    for hard in hard_cases::meshes() {
        let Ok(hierarchy) = VertexHierarchy::build(&hard.mesh) else { continue };
        let mut cut = Cut::new(&hierarchy);
        let size = f64::from(hard.mesh.bounds().diagonal()).max(1e-30);
        let mut approximations = Approximations::new(2_500, options).unwrap();
        let mut engine = Model { ns_per_triangle: 400, create_us: 50, separable: true, rendered: 0 };
        let origin = hard.mesh.origin();
        for i in 0..120u32 {
            let t = f64::from(i);
            let uneven = DVec3::new(1.0, 0.3, 2.0) * size;
            let place = DAffine3::from_scale_rotation_translation(
                if i < 60 { uneven } else { DVec3::splat(size) } / size,
                DQuat::from_rotation_y(0.01 * t),
                DVec3::new(0.01 * t, 0.0, 0.0) * size,
            );
            let place = DAffine3 { translation: place.translation - place.matrix3 * origin, ..place };
            let placement = Placement::new(&place, origin).unwrap();
            let away = DVec3::new(3.0 + 0.2 * t, 1.0 + random.unit() * 0.01, 0.4) * size;
            let eye = placement.to_world(placement.bounds(&hard.mesh.bounds()).center()) + away;
            let ahead = Camera::look_at(DVec3::ZERO, -away.normalize(), DVec3::Z).unwrap();
            let camera = Camera::new(eye, ahead.world_from_view()).and_then(|c| c.with_image(800, 600));
            let camera = camera.unwrap();
            approximations.next_frame();
            let mut subject = Subject {
                object: 1,
                version: i / 90,
                view: 0,
                light: LightKey::direction(placement.direction_to_rigid(DVec3::ONE), 0.05).unwrap(),
                mesh: &hard.mesh,
                hierarchy: &hierarchy,
                cut: &mut cut,
                placement: &placement,
            };
            let shown = approximations.approximate(&mut subject, &camera, &mut engine).unwrap();
            let limit = options.tolerance_px * options.growth + 1.01;
            assert!(shown.error.value <= limit, "{}: {}", hard.name, shown.error);
            let (off, seen) = farthest_off(&hierarchy, &placement, &camera, shown.approximation);
            assert!(off <= shown.error.value, "{}, frame {i}: {off} px, {}", hard.name, shown.error);
            (measured, worst) = (measured + seen, worst.max(off / shown.error.value));
            pictures += u32::from(shown.approximation.kind() == Kind::Impostor);
            uncached += u32::from(!shown.cached);
            if i == 60 {
                assert!(shown.fresh, "stretched otherwise, it is another shape");
            }
            if i == 90 {
                assert!(shown.fresh, "another version is another geometry");
                approximations.keep_version(1, 1);
            }
            assert!(approximations.cache_stats().bytes <= 2_500);
        }
        assert!(approximations.remove_object(1) > 0 || uncached > 0);
        assert_eq!(approximations.cache_stats().bytes, 0);
    }
    println!(
        "{pictures} pictures, {uncached} uncached; {measured} vertices, at most {worst:.3} of what is claimed"
    );
    assert!(measured > 50_000 && worst > 0.2);
    assert!(pictures > 500 && uncached > 50);
}

#[test]
fn options_out_of_range_are_named() {
    let d = ApproximationOptions::default();
    for (options, name) in [
        (ApproximationOptions { tolerance_px: 0.0, ..d }, "tolerance_px"),
        (ApproximationOptions { growth: 0.5, ..d }, "growth"),
        (ApproximationOptions { parallax: ParallaxTest::Pixels(f64::NAN), ..d }, "parallax px"),
        (ApproximationOptions { minification: f64::INFINITY, ..d }, "minification"),
        (ApproximationOptions { impostor: ImpostorOptions { gutter: 0, ..d.impostor }, ..d }, "gutter"),
    ] {
        let error = Approximations::<u32>::new(1, options).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
}

/// What moves between an object and its picture ends the picture, though the eye stands still.
#[test]
fn a_picture_ends_when_something_comes_between() {
    let mesh = hard_cases::bumpy_ball(10);
    let hierarchy = VertexHierarchy::build(&mesh).unwrap();
    let placement = Placement::new(&DAffine3::IDENTITY, mesh.origin()).unwrap();
    let mut cut = Cut::new(&hierarchy);
    let mut engine = Model { ns_per_triangle: 4000, create_us: 10, separable: true, rendered: 0 };
    let mut approximations = Approximations::new(1 << 26, ApproximationOptions::default()).unwrap();
    let kinds: Vec<Kind> = (0..30)
        .map(|i| {
            engine.separable = !(10..20).contains(&i);
            approximations.next_frame();
            let mut subject = Subject {
                object: 0,
                version: 0,
                view: 0,
                light: LightKey::custom(0),
                mesh: &mesh,
                hierarchy: &hierarchy,
                cut: &mut cut,
                placement: &placement,
            };
            let eye = DVec3::X * 30.0;
            approximations.approximate(&mut subject, &camera(eye), &mut engine).unwrap().approximation.kind()
        })
        .collect();
    assert!(kinds[1..10].iter().all(|k| *k == Kind::Impostor));
    assert!(kinds[10..20].iter().all(|k| *k == Kind::Geometry));
    assert_eq!(kinds[29], Kind::Impostor, "and serves again");
    assert_eq!(engine.rendered, 1);
}
