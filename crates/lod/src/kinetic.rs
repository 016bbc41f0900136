//! Tests only where the eye has moved far enough to change anything.
//!
//! The distance of a point from the eye changes by no more than the eye moves, and by less where it moves sideways. So a node whose distance is s away from where
//! its state would change needs no test until the eye has come s.

use crate::LodError;
use crate::cut::{Cut, UpdateStats, clear, limit, tau_of, wants_unfolding_from};
use crate::hierarchy::{Node, VertexHierarchy};
use crate::observer::{Observer, Tolerance};
use crate::wheel::Wheel;
use glam::DVec3;

/// Ticks in the radius of the whole mesh: how finely waiting nodes are told apart.
const TICKS: f64 = 4096.0;
/// After a jump of so many ticks every node of the cut is looked at.
const JUMP: u32 = 1 << 16;

/// The eye's path so far, and the nodes that wait.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    wheel: Wheel,
    travelled: f64,
    /// Length of a tick.
    tick: f64,
    seen: Option<(Observer, Tolerance)>,
    due: Vec<u32>,
}

impl Watch {
    /// Forgets everything: the next kinetic update looks at every node of the cut.
    pub(crate) fn forget(&mut self) {
        self.seen = None;
    }

    pub(crate) fn bytes(&self) -> usize {
        self.wheel.bytes() + self.due.capacity() * size_of::<u32>()
    }

    /// The tick at a length of path, rounded down.
    fn tick_at(&self, travelled: f64) -> u32 {
        // Casts saturate.
        ((travelled / self.tick) * (1.0 - 1e-15)) as u32
    }
}

impl Cut {
    /// As [`update`](Self::update), with the same result, for an eye that moves little from call to call: nodes are tested again only when it has
    /// travelled far enough for their state to be in question.
    ///
    /// A change of tolerance or of how the object is stretched makes it look at every node of the cut once, as does a jump by many times the object's size.
    /// Movement of the object counts as movement of the eye.
    ///
    /// # Cost
    /// About 60 ns a node that is due; for an eye on a smooth path one node in dozens.
    ///
    /// # Errors
    /// As [`update`](Self::update).
    ///
    /// # Panics
    /// When the cut belongs to another hierarchy.
    pub fn update_kinetic(
        &mut self,
        hierarchy: &VertexHierarchy,
        observer: &Observer,
        tolerance: &Tolerance,
    ) -> Result<UpdateStats, LodError> {
        self.begin(hierarchy, tolerance)?;
        let before = self.watch.seen.filter(|seen| seen.1 == *tolerance).map(|seen| seen.0);
        let known = before.and_then(|before| Some((before.eye, observer.stretched_as(&before)?)));
        let (step, observer) = match known {
            Some((eye, observer)) if eye == observer.eye => return Ok(self.stats),
            Some((eye, observer)) => (step(hierarchy, eye, &observer, tolerance), observer),
            None => (f64::INFINITY, *observer),
        };
        let observer = &observer;
        self.watch.seen = Some((*observer, *tolerance));
        // Rounded up: the path must not seem shorter than it is.
        let travelled = (self.watch.travelled + step * (1.0 + 1e-12)).next_up();
        let tick = self.watch.tick_at(travelled);
        let mut due = std::mem::take(&mut self.watch.due);
        clear(&mut due);
        if step.is_finite() && tick < Wheel::END && tick - self.watch.wheel.now() < JUMP {
            self.watch.travelled = travelled;
            self.watch.wheel.advance(tick, &mut due);
        } else {
            self.all_of_cut(hierarchy, &mut due);
        }
        while let Some(node) = due.pop() {
            self.look_at(hierarchy, observer, tolerance, node, &mut due);
        }
        self.watch.due = due;
        self.finish(hierarchy);
        Ok(self.stats)
    }

    /// Starts a new path; every node of the cut is due.
    fn all_of_cut(&mut self, hierarchy: &VertexHierarchy, due: &mut Vec<u32>) {
        self.watch.wheel.reset(hierarchy.nodes.len());
        self.watch.travelled = 0.0;
        self.watch.tick = (hierarchy.radius() / TICKS).max(f64::MIN_POSITIVE);
        let mut node = 0;
        while node < hierarchy.nodes.len() as u32 {
            due.push(node);
            node = if self.is_unfolded(node) { node + 1 } else { hierarchy.nodes[node as usize].end };
        }
        // Nodes above come off first.
        due.reverse();
    }

    /// Tests a node that is due; what comes to light below it is due as well.
    fn look_at(
        &mut self,
        hierarchy: &VertexHierarchy,
        observer: &Observer,
        tolerance: &Tolerance,
        node: u32,
        due: &mut Vec<u32>,
    ) {
        let parent = hierarchy.nodes[node as usize].parent;
        if (parent as usize) < hierarchy.nodes.len() && !self.is_unfolded(parent) {
            // It is looked at again when the node above unfolds.
            self.watch.wheel.forget(node);
            return;
        }
        self.stats.tested += 1;
        let was = self.is_unfolded(node);
        let n = &hierarchy.nodes[node as usize];
        let distance = observer.distance(n.center.as_dvec3());
        let wants = wants_unfolding_from(n, distance, observer, tolerance, was);
        if wants && !was {
            self.unfold(hierarchy, node);
            due.extend(hierarchy.children(node));
        } else if !wants && was {
            self.fold(hierarchy, node);
        }
        let slack = slack(n, distance, observer, tolerance, wants);
        let tick = self.watch.tick_at((self.watch.travelled + slack).next_down().max(0.0));
        self.watch.wheel.wait(node, tick);
    }
}

/// How far an eye has come: no distance from a node has changed by more.
///
/// With m the middle of its way u, distances from a node c before and after differ by 2·∣u·(m − c)∣ over their sum, which is at least 2·∣m − c∣. All nodes lie
/// in one ball, so an eye that passes an object sideways comes far more slowly than it moves. Directions change with
/// the way itself, so where they count the way does.
fn step(hierarchy: &VertexHierarchy, before: DVec3, now: &Observer, tolerance: &Tolerance) -> f64 {
    let way = now.eye - before;
    if tolerance.silhouette != tolerance.back {
        return way.length();
    }
    let (center, radius) = hierarchy.ball;
    let to_middle = now.stretched(before + 0.5 * way - center);
    let way = now.stretched(way);
    let (length, free) = (way.length(), to_middle.length() - radius);
    // Rounding of the product is a share of both lengths.
    let along = way.dot(to_middle).abs() + 1e-15 * length * to_middle.length();
    if free > 0.0 { length.min((along + length * radius) / free) } else { length }
}

/// How far the eye can move before the state of a node, at a distance from it, might change.
fn slack(n: &Node, distance: f64, observer: &Observer, tolerance: &Tolerance, is_unfolded: bool) -> f64 {
    let center = n.center.as_dvec3();
    let limit = |tau| limit(n, tau, tolerance, is_unfolded);
    // Rounding of distance and limit, with room to spare.
    let sure = |limit: f64| ((distance - limit).abs() - 1e-12 * (distance + limit)).max(0.0);
    let (near, far) = (limit(tolerance.back), limit(tolerance.silhouette));
    if distance < near || near == far {
        return sure(near);
    }
    if distance >= far {
        return sure(far);
    }
    let facing = observer.facing(n, center);
    let here = sure(limit(tau_of(facing.class, tolerance))).min(sure(near)).min(sure(far));
    here.min(turning_room(observer.eye.distance(center), f64::from(n.reach), facing.margin))
}

/// How far an eye at a distance can move before a cone that is clear by `margin` radians might not be: a step s turns the direction by
/// at most asin(s/d), and the sphere appears wider by asin(r/(d − s)) − asin(r/d).
fn turning_room(distance: f64, reach: f64, margin: f64) -> f64 {
    let mut step = 0.9 * (distance - reach).max(0.0);
    for _ in 0..60 {
        let turn = (step / distance).asin() + (reach / (distance - step)).asin() - (reach / distance).asin();
        if turn <= 0.999 * margin - 1e-9 {
            return step;
        }
        step *= 0.5;
    }
    0.0
}
