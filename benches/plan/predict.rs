//! Predicted against measured cost: plans under a limit, drawn by a simulated card whose law no model knows.

use farsight_plan::*;
use farsight_timing::simulator::{Law, SimScene, Simulator};
use farsight_timing::{Features, Heuristic, Model, Refit, RefitOptions, Residuals, sphere_pixels};
use std::time::Duration;

/// Frames of a walk, how many of them the quantiles are learnt from before they are held to account, and how many they remember.
const FRAMES: usize = 3000;
const LEARNT: usize = 300;
const MEMORY: usize = 1000;
/// The quantile that is held to account.
const SHARE: f64 = 0.95;

/// Prints how many frames stayed below the stated quantile, and below the limit.
pub fn report() {
    println!(
        "\n{:>10} {:>12} {:>14} {:>20} {:>12} {:>18}",
        "scene", "limit ms", "median miss", "below 95 % quantile", "floor", "within the limit"
    );
    for scene in [SimScene::city(1), SimScene::forest(1)] {
        for share in [1.2, 0.7, 0.4] {
            walk(&scene, share);
        }
    }
}

/// A walk whose frames may take a share of what the first ones take in full.
fn walk(scene: &SimScene, share: f64) {
    let mut card = Simulator::new(Law::default(), 5);
    let full = |card: &mut Simulator, i: usize| {
        let camera = scene.camera(0, i as f64 / FRAMES as f64);
        card.time_frame(scene.visible(&camera).into_iter().map(|o| (&scene.objects[o], 0)), &camera)
    };
    let mean = (0..20).map(|i| full(&mut card, i * FRAMES / 20)).sum::<Millis>() * (1.0 / 20.0);
    let limit = mean * share;
    let details: Vec<Vec<Detail>> = scene.objects.iter().map(details).collect();
    let objects: Vec<ObjectSummary> = scene
        .objects
        .iter()
        .zip(&details)
        .map(|(object, details)| ObjectSummary {
            draws: 1.0,
            vertices: object.levels[0].features.vertices,
            triangles: object.levels[0].features.triangles,
            details,
            impostor: false,
        })
        .collect();
    let summary = SceneSummary { objects: &objects, ..SceneSummary::default() };
    let guess = Model { heuristic: Heuristic::Extended, costs: [2e-6, 1e-6, 2e-3, 2e-6] };
    let mut costs = Refit::new(guess, Millis(0.5), RefitOptions::default()).expect("a linear model");
    let (mut planner, mut residuals) = (Planner::new(), Residuals::new(MEMORY));
    let (mut misses, mut below, mut within, mut asked) = (Vec::new(), 0, 0, 0);
    for i in 0..FRAMES {
        let camera = scene.camera(0, i as f64 / FRAMES as f64);
        let visible = scene.visible(&camera);
        let mut seen = vec![ObjectView::default(); objects.len()];
        for &o in &visible {
            let sphere = scene.objects[o].sphere;
            let size_px = camera.sphere_px(&sphere).min(1e4);
            let distance = (sphere.center.distance(camera.eye()) - sphere.radius).max(camera.near());
            seen[o] = ObjectView {
                in_view: true,
                size_px,
                pixels: sphere_pixels(&sphere, &camera),
                px_per_unit: camera.pixels_per_unit() / distance,
                impostor_frames: 0.0,
            };
        }
        let view = ViewSummary {
            pixels: f64::from(camera.width()) * f64::from(camera.height()),
            outputs: Outputs::PICTURE,
            objects: &seen,
            lights: &[],
            clouds: &[],
            cell: None,
            jumped: false,
        };
        // The rest of the frame is none of the planner's business; what the last frames took more is in the costs.
        let rest = costs.constant() * (1.0 + costs.bias());
        let there = (limit - rest).max(Millis::ZERO);
        let plan = planner.plan(&summary, &view, &Budget::within(there, Tolerances::default()), &costs);
        let plan = plan.expect("valid numbers");
        let predicted = plan.cost + rest;
        let level = |o: usize| match plan.objects()[o].choice {
            Choice::Nothing => None,
            Choice::Detail { detail, .. } => Some((&scene.objects[o], detail as usize + 1)),
            _ => Some((&scene.objects[o], 0)),
        };
        let measured = card.time_frame(visible.iter().filter_map(|&o| level(o)), &camera);
        if let Some(quantile) = residuals.quantile(predicted, SHARE).filter(|_| i >= LEARNT) {
            asked += 1;
            below += usize::from(measured <= quantile);
            within += usize::from(measured <= limit);
            misses.push((measured / predicted - 1.0).abs());
        }
        residuals.record(predicted, measured);
        costs.observe(&Features::from(&plan.work), measured).expect("valid numbers");
    }
    misses.sort_by(f64::total_cmp);
    println!(
        "{:>10} {:>12.2} {:>12.1} % {:>18.1} % {:>12} {:>16.1} %",
        scene.name,
        Duration::from(limit).as_secs_f64() * 1e3,
        100.0 * misses[misses.len() / 2],
        100.0 * below as f64 / asked as f64,
        "93 to 97",
        100.0 * within as f64 / asked as f64
    );
}

/// Levels of a simulated object; each is about half of the one before, and twice as far off.
fn details(object: &farsight_timing::simulator::SimObject) -> Vec<Detail> {
    let detail = |(level, i): (&farsight_timing::simulator::SimLevel, i32)| Detail {
        form: Form::Mesh,
        error: object.sphere.radius * 0.01 * 2f64.powi(i),
        kind: Kind::Estimated,
        elements: level.features.triangles,
    };
    object.levels[1..].iter().zip(0..).map(detail).collect()
}
