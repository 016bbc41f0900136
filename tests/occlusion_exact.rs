//! Culling never changes the image: latencies × orders of answers × policies × scenes.

#[path = "../benches/occlusion/sim.rs"]
#[allow(dead_code)]
mod sim;
#[path = "../benches/occlusion/town.rs"]
#[allow(dead_code)]
mod town;

use farsight_occlusion::*;
use sim::{Arrival, Costs, Machine, everything, wrong_pixels};
use town::{Walk, World, field, town as build_town};

const PX: [u32; 2] = [160, 120];

fn variants() -> Vec<(&'static str, Options)> {
    let with = |change: &dyn Fn(&mut Options)| {
        let mut options = Options::default();
        change(&mut options);
        options
    };
    let waves = |change: &dyn Fn(&mut Options)| {
        let mut options = Options::waves();
        change(&mut options);
        options
    };
    vec![
        ("frustum", Options::baseline(Algorithm::FrustumOnly)),
        ("naive", Options::baseline(Algorithm::Naive)),
        ("stop and wait", Options::baseline(Algorithm::StopAndWait)),
        ("pseudocode", Options::pseudocode()),
        ("default", Options::default()),
        ("waves", Options::waves()),
        ("stack", with(&|o| o.order = Order::Stack)),
        ("not deferred", with(&|o| o.defer = false)),
        ("geometry", with(&|o| o.query_with_geometry = true)),
        ("every 5", with(&|o| o.query_leaves_every = 5)),
        ("shared", with(&|o| o.nodes_per_query = 8)),
        ("remember", with(&|o| (o.reentry, o.unknown) = (Reentry::Remember, Unknown::Draw))),
        ("adaptive", with(&|o| o.adaptive = Some(Adaptive::default()))),
        ("waves shared", waves(&|o| o.nodes_per_query = 8)),
        ("waves every 5", waves(&|o| (o.query_leaves_every, o.adaptive) = (5, None))),
        ("waves geometry", waves(&|o| (o.query_with_geometry, o.adaptive) = (true, None))),
    ]
}

fn compare(
    world: &World,
    walk: Walk,
    side: u32,
    options: Options,
    latency: f64,
    arrival: Arrival,
    name: &str,
) {
    let mut culler = Culler::new(options, Backend::Boolean).unwrap();
    let mut machine = Machine::new(world, Costs::with_latency(latency), PX);
    machine.arrival = arrival;
    for i in 0..10 {
        let camera = walk.camera(side, i, 10, PX);
        let frame = machine.frame(&mut culler, &world.bvh, &camera);
        let wrong = wrong_pixels(&machine.image(), &everything(world, &camera));
        assert_eq!(wrong, 0, "{name}, {walk:?}, latency {latency}, {arrival:?}, frame {i}");
        let mut drawn: Vec<_> = culler.rendered().to_vec();
        drawn.sort_unstable();
        drawn.dedup();
        assert_eq!(drawn.len() as u64, frame.draws, "{name}: each leaf once");
    }
}

#[test]
fn images_are_those_of_drawing_everything() {
    let side = 8;
    let world = build_town(side, 3);
    for (name, options) in variants() {
        for walk in [Walk::Street, Walk::Rise, Walk::Turn, Walk::Static, Walk::Flyover] {
            for latency in [0.0, 20.0, 5000.0] {
                for arrival in [Arrival::InOrder, Arrival::Reversed, Arrival::Shuffled(7)] {
                    compare(&world, walk, side, options, latency, arrival, name);
                }
            }
        }
    }
}

#[test]
fn nothing_is_lost_where_nothing_hides() {
    let world = field(12, 5);
    for (name, options) in variants() {
        compare(&world, Walk::Flyover, 5, options, 50.0, Arrival::Shuffled(3), name);
    }
}
