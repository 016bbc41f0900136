//! The shadows of a light: none, the map of an earlier frame, or one of many kinds of map.

use crate::candidate::{Candidate, strain};
use crate::choice::{Choice, Class, Layout, Reason, Rule};
use crate::state::LightState;
use crate::summary::{LightSummary, LightView, Tolerances};
use crate::work::{CostModel, Work};
use farsight_geometry::Millis;
use farsight_geometry::accuracy::{ErrorBound, Unit};

/// Smallest side of a map that is offered.
const LEAST_SIDE: u32 = 256;
/// Samples of a soft shadow that are offered. The third is a little within the default tolerance, so that it stays when the layout changes.
const TAPS: [u32; 5] = [4, 9, 18, 36, 64];
/// Vertices transformed for a triangle of a mesh with shared vertices.
const VERTICES: f64 = 0.7;
/// A warp comes at this gain and goes below the other: a uniform map can be moved by whole texels, so that it does not flicker.
const GAIN_ON: f64 = 1.25;
const GAIN_OFF: f64 = 1.10;
/// A hard edge differs from a penumbra `s` pixels wide by `s`/8 of the light, averaged over a pixel, and by half of it at most.
const SHADE_PER_PX: f64 = 0.125;
const MOST_SHADE: f64 = 0.5;

/// Why a light needs no shadow at all, whatever the tolerances.
pub fn void(view: &LightView) -> Option<Reason> {
    let rule = if view.receiver_pixels == 0.0 {
        Rule::NoReceiver
    } else if view.caster_triangles == 0.0 {
        Rule::NoCaster
    } else if view.contribution == 0.0 {
        Rule::TooDim
    } else {
        return None;
    };
    Some(Reason::new(Class::Void, rule, 0.0, 0.0))
}

/// How much finer a warp makes the worst texel.
pub fn gain(view: &LightView) -> f64 {
    if view.texels.uniform == view.texels.warped { 1.0 } else { view.texels.uniform / view.texels.warped }
}

/// Gain from which a warp is offered.
pub fn wanted_gain(state: &LightState) -> f64 {
    if state.map.is_some_and(|m| matches!(m.choice, Choice::Map { layout: Layout::Warped, .. })) {
        GAIN_OFF
    } else {
        GAIN_ON
    }
}

/// Everything that may be chosen for a light that needs shadows, into `out`, kind by kind.
pub fn candidates(
    light: &LightSummary,
    view: &LightView,
    tolerances: &Tolerances,
    state: &LightState,
    costs: &(impl CostModel + ?Sized),
    out: &mut Vec<Candidate>,
) {
    out.clear();
    let missing = view.contribution.min(1.0);
    out.push(Candidate {
        choice: Choice::Nothing,
        strain: strain(missing, tolerances.area_shade),
        error: ErrorBound::proven(missing, Unit::Fraction),
        work: Work::default(),
        cost: Millis::ZERO,
    });
    if let Some(map) = state.map.filter(|_| view.unchanged) {
        let work = Work { taps: view.receiver_pixels * f64::from(taps_of(&map.choice)), ..Work::default() };
        out.push(Candidate { choice: Choice::Reuse, cost: costs.time(&work), work, ..map });
    }
    let warp = gain(view) >= wanted_gain(state);
    let sides = std::iter::successors(Some(light.most_side), |s| Some(s / 2));
    let sides = sides.take_while(|&s| s >= LEAST_SIDE.min(light.most_side).max(1));
    let soft = TAPS.into_iter().filter(|&t| view.penumbra_px > 0.0 && t <= light.most_taps);
    for (layout, spread) in layouts(view, light.most_cascades, warp) {
        for taps in std::iter::once(1).chain(soft.clone()) {
            let maps = sides.clone().map(|side| map(layout, spread, side, taps, view, tolerances, costs));
            out.extend(maps);
        }
    }
}

/// Layouts on offer with their spreads.
fn layouts(view: &LightView, most: u32, warp: bool) -> impl Iterator<Item = (Layout, f64)> + '_ {
    let single = [(Layout::Uniform, view.texels.uniform), (Layout::Warped, view.texels.warped)];
    let cascades = view.texels.cascades.iter().zip(2..).map(|(&s, n)| (Layout::Cascades(n), s));
    single
        .into_iter()
        .filter(move |(layout, _)| warp || *layout == Layout::Uniform)
        .chain(cascades.filter(move |(layout, _)| matches!(layout, Layout::Cascades(n) if *n <= most)))
        .filter(|(_, spread)| spread.is_finite())
}

fn map(
    layout: Layout,
    spread: f64,
    side: u32,
    taps: u32,
    view: &LightView,
    tolerances: &Tolerances,
    costs: &(impl CostModel + ?Sized),
) -> Candidate {
    let maps = f64::from(if let Layout::Cascades(n) = layout { n } else { 1 });
    let work = Work {
        // Every cascade is charged for all casters.
        draws: view.caster_draws * maps,
        vertices: view.caster_triangles * maps * VERTICES,
        triangles: view.caster_triangles * maps,
        texels: f64::from(side).powi(2) * maps,
        taps: view.receiver_pixels * f64::from(taps),
        ..Work::default()
    };
    let texel_px = spread / f64::from(side);
    let shade = view.contribution.min(1.0)
        * if taps == 1 {
            (view.penumbra_px * SHADE_PER_PX).min(MOST_SHADE)
        } else {
            MOST_SHADE / f64::from(taps)
        };
    let (coarse, wrong) = (strain(texel_px, tolerances.texel_px), strain(shade, tolerances.edge_shade));
    let error = if coarse >= wrong {
        ErrorBound::proven(texel_px, Unit::Pixels)
    } else {
        ErrorBound::estimated(shade, Unit::Fraction)
    };
    let choice = Choice::Map { layout, side, taps, caster_px: tolerances.position_px };
    Candidate { choice, strain: coarse.max(wrong), error, work, cost: costs.time(&work) }
}

/// Samples that a pixel takes from a map.
fn taps_of(choice: &Choice) -> u32 {
    if let Choice::Map { taps, .. } = choice { *taps } else { 1 }
}
