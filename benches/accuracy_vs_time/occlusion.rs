//! Occlusion culling: what skipping queries, allowing lost pixels and a coarser depth buffer cost and save.
//!
//! Times are those of the simulator's model machine, so they are the same on every computer.

#[path = "../occlusion/sim.rs"]
#[allow(dead_code)]
mod sim;
#[path = "../occlusion/town.rs"]
#[allow(dead_code)]
mod town;

use super::row::{Row, timed};
use farsight_geometry::ClipConvention;
use farsight_geometry::accuracy::{Counters, ErrorBound, Unit};
use farsight_geometry::glam::DMat4;
use farsight_occlusion::{Backend, Coverage, Culler, DepthBuffer, Faces, Options, Policy};
use sim::{Costs, Machine, everything, wrong_pixels};
use std::time::Duration;
use town::{Walk, World, town as build_town};

const PX: [u32; 2] = [320, 240];

pub fn rows(quick: bool) -> Vec<Row> {
    let (side, frames) = if quick { (12, 12) } else { (40, 30) };
    let world = build_town(side, 1);
    let mut rows = Vec::new();
    for walk in [Walk::Street, Walk::Rise] {
        let scene = format!("{walk:?} {side}x{side}").to_lowercase();
        let row = |knob: &str, value: f64, claimed: ErrorBound, options: Options| {
            run(&world, walk, side, frames, scene.clone(), knob, value, claimed, options)
        };
        for threshold in [256, 64, 16, 4, 0u64] {
            let mut options = Options::default();
            options.lossy_threshold = threshold;
            // At most so many pixels of each hidden node; how many nodes there are is not known beforehand.
            let claimed = match threshold {
                0 => ErrorBound::proven(0.0, Unit::Pixels),
                _ => ErrorBound::estimated(threshold as f64, Unit::Pixels),
            };
            rows.push(row("lossy threshold", threshold as f64, claimed, options));
        }
        for frames in [8, 4, 2, 1u32] {
            let mut options = Options::default();
            options.query_leaves_every = frames;
            rows.push(row(
                "leaf queries every",
                frames.into(),
                ErrorBound::proven(0.0, Unit::Pixels),
                options,
            ));
        }
        for frames in [8, 4, 2, 1u32] {
            let mut options = Options::bounded(frames);
            options.adaptive = None;
            debug_assert_ne!(options.policy, Policy::Exact);
            // What may be missing for so many frames is as large as the image.
            let pixels = f64::from(PX[0] * PX[1]);
            rows.push(row(
                "frames late at most",
                frames.into(),
                ErrorBound::proven(pixels, Unit::Pixels),
                options,
            ));
        }
        rows.extend(resolutions(&world, walk, side, &scene));
    }
    rows
}

fn run(
    world: &World,
    walk: Walk,
    side: u32,
    frames: usize,
    scene: String,
    knob: &str,
    value: f64,
    claimed: ErrorBound,
    options: Options,
) -> Row {
    let mut culler = Culler::new(options, Backend::Counts).expect("options in range");
    let mut machine = Machine::new(world, Costs::with_latency(20.0), PX);
    let (mut measured, mut times, mut counters) = (0usize, Vec::new(), Counters::default());
    for i in 0..frames {
        let camera = walk.camera(side, i, frames, PX);
        let frame = machine.frame(&mut culler, &world.bvh, &camera);
        measured = measured.max(wrong_pixels(&machine.image(), &everything(world, &camera)));
        if i > 0 {
            times.push(Duration::from_nanos((frame.time_us * 1e3) as u64));
        }
        counters.add("queries", frame.stats.queries);
        counters.add("draws", frame.draws);
    }
    let bytes = world.bvh.node_capacity() as u64 * 28;
    Row {
        krate: "occlusion",
        scene,
        knob: knob.into(),
        value,
        claimed,
        measured: measured as f64,
        times,
        bytes,
        counters,
    }
}

/// Depth buffers of a part of the image's resolution, from coarse to fine: pixels at which they hide something that is seen, and how
/// many of the hidden objects they find.
fn resolutions(world: &World, walk: Walk, side: u32, scene: &str) -> Vec<Row> {
    let camera = walk.camera(side, 1, 3, PX);
    let eye = camera.eye();
    let truth = everything(world, &camera);
    let seen: std::collections::BTreeSet<u32> = truth.iter().map(|p| p.0).collect();
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, eye);
    let row = |divisor: u32| {
        let (width, height) = (PX[0] / divisor, PX[1] / divisor);
        let coverage = if divisor == 1 { Coverage::Centres } else { Coverage::Whole };
        let mut buffer = DepthBuffer::new(width, height).expect("a small size").with_coverage(coverage);
        let (hidden, times) = timed(5, || {
            buffer.clear();
            for object in &world.objects {
                let clip_from_local = clip * DMat4::from_translation(object.origin - eye);
                buffer.draw(&clip_from_local, &object.positions, object.triangles, Faces::Both);
            }
            let objects = world.objects.iter().enumerate();
            let hidden = objects.filter(|(_, o)| buffer.is_occluded(&clip, eye, &o.bounds().inflated(1e-3)));
            hidden.map(|(i, _)| i as u32 + 1).collect::<Vec<_>>()
        });
        let lost = truth.iter().filter(|p| p.0 != 0 && hidden.binary_search(&p.0).is_ok()).count();
        let mut counters = Counters::default();
        counters.add("seen", seen.len() as u64);
        counters.add("kept", (world.objects.len() - hidden.len()) as u64);
        Row {
            krate: "occlusion",
            scene: scene.into(),
            knob: "buffer resolution".into(),
            value: 1.0 / f64::from(divisor),
            claimed: ErrorBound::proven(0.0, Unit::Pixels),
            measured: lost as f64,
            times,
            bytes: buffer.bytes() as u64,
            counters,
        }
    };
    [4, 2, 1].map(row).into()
}
