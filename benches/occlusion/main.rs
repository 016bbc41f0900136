//! Occlusion culling, each figure beside the floor that it must not fall below.
//!
//! ```text
//! cargo bench --bench occlusion                the table
//! cargo bench --bench occlusion -- --quick     shorter walks, smaller counts
//! cargo bench --bench occlusion -- --buffer    only the depth buffer's speed; --traversal: only that of the traversal
//! cargo bench --bench occlusion -- --check     exits non-zero when a floor is missed
//! ```
//!
//! Times of walks are those of a model machine (see `sim.rs`), so they are the same on every computer. Times of the traversal
//! and of the depth buffer are CPU time of one thread, best of several runs.

mod buffer;
#[allow(dead_code)]
mod sim;
mod town;

use farsight_occlusion::*;
use farsight_raster::thread_cpu_time;
use sim::{Costs, Frame, Machine};
use town::{Walk, World, field, town as build_town};

const PX: [u32; 2] = [320, 240];
const SIDE: u32 = 40;

fn main() {
    let has = |flag: &str| std::env::args().any(|a| a == flag);
    let quick = has("--quick");
    let frames = if quick { 20 } else { 60 };
    let mut table = Table::default();
    if has("--buffer") {
        return buffer::speeds(&mut table, quick);
    }
    if has("--traversal") {
        return traversal_speed(&mut table);
    }
    buffer::speeds(&mut table, quick);
    walks(&mut table, frames);
    still(&mut table, frames);
    queries(&mut table, frames);
    traversal_speed(&mut table);
    if has("--check") && !table.passed {
        std::process::exit(1);
    }
}

/// A walk's frames after the first five, which only learn.
fn walk(world: &World, walk: Walk, side: u32, frames: usize, options: Options, latency: f64) -> Vec<Frame> {
    let mut culler = Culler::new(options, Backend::Boolean).expect("options in range");
    let mut machine = Machine::new(world, Costs::with_latency(latency), PX);
    let run = |i: usize| machine.frame(&mut culler, &world.bvh, &walk.camera(side, i, frames, PX));
    (0..frames).map(run).collect::<Vec<_>>().split_off(5)
}

fn mean(frames: &[Frame], value: impl Fn(&Frame) -> f64) -> f64 {
    frames.iter().map(value).sum::<f64>() / frames.len() as f64
}

fn describe(name: &str, frames: &[Frame]) {
    println!(
        "    {name:<34} {:>9.0} us {:>7.1} draws {:>7.1} queries {:>6.1} late {:>6.2} waves {:>6.1} stalls {:>7.1} visited",
        mean(frames, |f| f.time_us),
        mean(frames, |f| f.draws as f64),
        mean(frames, |f| f.stats.queries as f64),
        mean(frames, |f| f.stats.discoveries as f64),
        mean(frames, |f| f.stats.waves as f64),
        mean(frames, |f| f.stalls as f64),
        mean(frames, |f| f.stats.visited as f64),
    );
}

fn walks(table: &mut Table, frames: usize) {
    let world = build_town(SIDE, 1);
    let time = |f: &[Frame]| mean(f, |f| f.time_us);
    let floors = [(Walk::Street, 15.0, 2.9), (Walk::Rise, 6.5, 3.3), (Walk::Turn, f64::NAN, f64::NAN)];
    for (path, least_frustum, least_wait) in floors {
        println!("{path:?}, 20 us");
        let run = |options, latency| walk(&world, path, SIDE, frames, options, latency);
        let frustum = run(Options::baseline(Algorithm::FrustumOnly), 20.0);
        let wait = run(Options::baseline(Algorithm::StopAndWait), 20.0);
        describe("frustum only", &frustum);
        describe("stop and wait", &wait);
        describe("pseudocode", &run(Options::pseudocode(), 20.0));
        let polling = run(Options::default(), 20.0);
        describe("polling", &polling);
        let waves = run(Options::waves(), 20.0);
        describe("waves", &waves);
        let zero = run(Options::default(), 0.0);
        let slow = run(Options::default(), 200.0);
        describe("polling, 200 us", &slow);
        let zero_waves = run(Options::waves(), 0.0);
        let slow_waves = run(Options::waves(), 200.0);
        describe("waves, 200 us", &slow_waves);
        let name = |what: &str| format!("{path:?}: {what}").to_lowercase();
        if least_frustum.is_finite() {
            table.least(&name("polling over frustum only"), time(&frustum) / time(&polling), least_frustum);
            table.least(&name("polling over stop and wait"), time(&wait) / time(&polling), least_wait);
            table.least(&name("waves over frustum only"), time(&frustum) / time(&waves), least_frustum);
            table.least(&name("waves over stop and wait"), time(&wait) / time(&waves), least_wait);
        }
        if path == Walk::Street {
            table.most(&name("polling, 200 us over 0 us"), time(&slow) / time(&zero), 1.2);
            table.most(&name("waves, 200 us over 0 us"), time(&slow_waves) / time(&zero_waves), 1.2);
            let mut counts: Vec<u64> = waves.iter().map(|f| f.stats.waves).collect();
            counts.sort_unstable();
            table.most(&name("waves, mean"), mean(&waves, |f| f.stats.waves as f64), 3.0);
            table.most(&name("waves, 99th percentile"), counts[(counts.len() - 1) * 99 / 100] as f64, 6.0);
        }
    }
    let world = field(60, 1);
    let run = |options| walk(&world, Walk::Flyover, 24, frames, options, 20.0);
    let frustum = run(Options::baseline(Algorithm::FrustumOnly));
    let waves = run(Options::waves());
    let mut options = Options::default();
    options.adaptive = Some(Adaptive::default());
    let polling = run(options);
    println!("Flyover, 20 us");
    describe("frustum only", &frustum);
    describe("polling, not adaptive", &run(Options::default()));
    describe("polling, adaptive", &polling);
    describe("waves", &waves);
    table.most("flyover: polling, adaptive over frustum only", time(&polling) / time(&frustum), 1.03);
    table.most("flyover: waves over frustum only", time(&waves) / time(&frustum), 1.03);
}

/// A camera that does not move.
fn still(table: &mut Table, frames: usize) {
    let world = build_town(SIDE, 1);
    for (name, options) in [("polling", Options::default()), ("waves", Options::waves())] {
        let mut culler = Culler::new(options, Backend::Boolean).expect("options in range");
        let mut machine = Machine::new(&world, Costs::with_latency(20.0), PX);
        let camera = Walk::Static.camera(SIDE, 0, 1, PX);
        let run = |_| {
            // Frames of a still camera come at the display's pace.
            machine.idle(1000.0);
            machine.frame(&mut culler, &world.bvh, &camera)
        };
        let all: Vec<Frame> = (0..frames).map(run).collect();
        for (i, f) in all.iter().enumerate().take(14) {
            let s = &f.stats;
            println!(
                "    {name} frame {}: {} queries, {} late ({} retests), {} must, {} rendered",
                i + 1,
                s.queries,
                s.discoveries,
                s.retests,
                s.must_resolve,
                s.rendered
            );
        }
        // Frames in which nothing was looked at again.
        let quiet: Vec<&Frame> = all[2..].iter().filter(|f| f.stats.retests == 0).collect();
        let changes = quiet.windows(2).filter(|w| w[0].queried != w[1].queried).count();
        let late: u64 = all[2..].iter().map(|f| f.stats.discoveries).sum();
        table.most(&format!("static, {name}: changes of the query set"), changes as f64, 0.0);
        table.most(&format!("static, {name}: late discoveries"), late as f64, 0.0);
    }
}

/// Queries against the fewest that could do, and what taking turns saves.
fn queries(table: &mut Table, frames: usize) {
    let world = build_town(SIDE, 1);
    for path in [Walk::Street, Walk::Rise] {
        let run = |every: u32, shared: u32| {
            let mut options = Options::default();
            options.query_leaves_every = every;
            options.nodes_per_query = shared;
            walk(&world, path, SIDE, frames, options, 20.0)
        };
        let plain = run(1, 1);
        let turns = run(3, 1);
        let both = run(3, 16);
        describe("plain", &plain);
        describe("every 3", &turns);
        describe("every 3, 16 a query", &both);
        describe("16 a query", &run(1, 16));
        let queries = |f: &[Frame]| mean(f, |f| f.stats.queries as f64);
        let draws = |f: &[Frame]| mean(f, |f| f.draws as f64);
        let name = |what: &str| format!("{path:?}: {what}").to_lowercase();
        table.least(
            &name("queries saved by turns and sharing"),
            1.0 - queries(&both) / queries(&plain),
            0.25,
        );
        table.most(&name("draws added by turns and sharing"), draws(&both) / draws(&plain) - 1.0, 0.04);
    }
}

/// CPU time per visited node with answers that cost nothing.
fn traversal_speed(table: &mut Table) {
    let world = build_town(SIDE, 1);
    for (name, options) in [
        ("polling", Options::default()),
        ("waves", Options::waves()),
        ("frustum only", Options::baseline(Algorithm::FrustumOnly)),
    ] {
        let mut culler = Culler::new(options, Backend::Boolean).expect("options in range");
        let mut best = f64::INFINITY;
        let mut asked = Vec::new();
        for i in 0..60 {
            let camera = Walk::Rise.camera(SIDE, i, 60, PX);
            let start = thread_cpu_time();
            culler.begin_frame(View::from_camera(&camera));
            asked.clear();
            loop {
                match culler.next(&world.bvh) {
                    Command::Query { id, node, .. } => asked.push((id, node)),
                    Command::Flush => {
                        for (id, node) in asked.drain(..) {
                            let visible = node.0 % 3 == 0;
                            culler.resolve(id, Answer { visible, samples: None });
                        }
                    }
                    Command::Done => break,
                    Command::Render(_) => {}
                }
            }
            for (id, node) in asked.drain(..) {
                culler.resolve(id, Answer { visible: node.0 % 3 == 0, samples: None });
            }
            let visited = culler.stats().visited;
            let ns = (thread_cpu_time() - start).as_secs_f64() * 1e9 / visited as f64;
            if i > 5 && visited > 50 {
                best = best.min(ns);
            }
        }
        table.most(&format!("{name}: CPU time per visited node, ns"), best, 100.0);
    }
}

struct Table {
    passed: bool,
}

impl Default for Table {
    fn default() -> Self {
        println!("{:<56} {:>9} {:>9}", "", "measured", "floor");
        Self { passed: true }
    }
}

impl Table {
    fn row(&mut self, name: &str, value: f64, bound: f64, ok: bool) {
        println!("{name:<56} {value:>9.3} {bound:>9.2} {}", if ok { "ok" } else { "MISSED" });
        self.passed &= ok;
    }

    fn info(&mut self, name: &str, value: f64) {
        println!("{name:<56} {value:>9.3}");
    }

    fn least(&mut self, name: &str, value: f64, bound: f64) {
        self.row(name, value, bound, value >= bound);
    }

    fn most(&mut self, name: &str, value: f64, bound: f64) {
        self.row(name, value, bound, value <= bound);
    }
}
