//! The page about a walk through a scene.

use crate::effects;
use crate::frames::FrameReport;
use crate::input::Input;
use crate::page::Page;
use crate::sun::ShadowReport;
use crate::{Shown, Walked};
use farsight_plan::{Choice, Class, Decision, Effect, Form};
use std::error::Error;
use std::time::Duration;

/// What is told of the scene itself.
pub struct Told {
    title: String,
    report: String,
    facts: Vec<String>,
    warnings: Vec<String>,
}

impl Told {
    /// Of an input, whose meshes were found to have the defects of a report.
    pub fn of(input: &Input, report: String) -> Self {
        let scene = &input.scene;
        let size = scene.bounds().extent();
        let facts = vec![
            scene.placed_triangles().to_string(),
            scene.stored_triangles().to_string(),
            scene.instances().len().to_string(),
            scene.lights().len().to_string(),
            [size.x, size.y, size.z].map(short).join(" × "),
            format!("{:.1} MB", scene.bytes() as f64 * 1e-6),
        ];
        Self { title: input.title.clone(), report, facts, warnings: input.warnings.clone() }
    }
}

/// The page of a walk through a scene.
pub fn page(told: &Told, built: &[(String, Duration)], walked: &Walked) -> Result<String, Box<dyn Error>> {
    let frames = &walked.frames;
    let mut page = Page::new(&format!("A tour of {}", told.title), &told.report);
    page.heading("The scene");
    page.table(&[
        head(["triangles placed", "triangles stored", "instances", "lights", "size", "memory"]),
        told.facts.clone(),
    ]);
    told.warnings.iter().for_each(|w| page.paragraph(w));
    page.heading("Frames");
    let captions = frames.iter().enumerate().map(|(i, shown)| (shown.png.clone(), caption(i, &shown.report)));
    page.pictures(&captions.collect::<Vec<_>>());
    page.heading("What each frame took");
    page.table(&frame_table(frames));
    let series =
        |value: fn(&FrameReport) -> f64| frames.iter().map(|f| value(&f.report)).collect::<Vec<f64>>();
    page.plot(
        "Time per frame",
        "processor ms",
        &[
            ("foretold", series(|f| f.predicted.0)),
            ("measured", series(|f| f.time.0)),
            ("of it the shadow map", series(|f| f.shadow.as_ref().map_or(0.0, |s| s.time.0))),
            ("of it culling", series(|f| f.culling.0)),
        ],
    )?;
    page.plot(
        "Objects",
        "objects",
        &[("in view", series(|f| f.in_view as f64)), ("drawn", series(|f| f.drawn as f64))],
    )?;
    page.paragraph(
        "How coarse the shadow map is where it is coarsest: pixels on the screen that one texel covers.",
    );
    page.plot(
        "Worst shadow texel",
        "px",
        &[
            ("as drawn", series(|f| f.shadow.as_ref().map_or(0.0, |s| s.texel))),
            ("without a warp", series(|f| f.shadow.as_ref().map_or(0.0, |s| s.uniform))),
        ],
    )?;
    if !built.is_empty() {
        decisions(&mut page, built, frames);
    }
    moment(&mut page, walked);
    Ok(page.finish())
}

/// A few frames as fast as a user would see them.
fn moment(page: &mut Page, walked: &Walked) {
    let Some(last) = &walked.last else { return };
    page.heading("A moment at full rate");
    page.paragraph(&format!(
        "Frames a sixtieth of a second apart. A picture of an object serves again while it is off by no more than the tolerance, and the cuts of what moves are \
         looked at only where the eye's way since may have changed them. Nodes of hierarchies that were not read in time are missing: coarser ones stand for them, off by \
         more. In all {}.",
        walked.pictures
    ));
    page.table(&moment_table(walked.moment.iter().chain([&last.report])));
    let mut pictures = vec![(last.png.clone(), "The last of these frames".to_string())];
    if let Some(c) = &last.comparison {
        let changed = 100.0 * c.changed;
        let text =
            format!("Four times its difference to everything in full; {changed:.2} % of the pixels changed");
        pictures.push((c.difference.clone(), text));
    }
    page.pictures(&pictures);
    if let Some(plan) = &last.report.plan {
        page.details("The plan of this frame, with its reasons", &plan.to_string());
    }
}

fn moment_table<'a>(frames: impl Iterator<Item = &'a FrameReport>) -> Vec<Vec<String>> {
    let names = [
        "frame",
        "pictures made",
        "drawn again",
        "parallax px",
        "ms for them",
        "tests of cuts",
        "nodes drawn",
        "missing",
        "off by px",
        "triangles",
        "culling ms",
        "foretold",
        "ms",
    ];
    let row = |(i, f): (usize, &FrameReport)| {
        [
            i.to_string(),
            f.pictures.made.to_string(),
            f.pictures.kept.to_string(),
            format!("{:.2}", f.pictures.parallax),
            format!("{:.1}", f.pictures.time.0),
            f.tests.to_string(),
            f.nodes.nodes.to_string(),
            f.nodes.missing.to_string(),
            format!("{:.2}", f.nodes.error_px),
            f.counters.triangles.to_string(),
            format!("{:.1}", f.culling.0),
            format!("{:.0}", f.predicted.0),
            format!("{:.0}", f.time.0),
        ]
        .to_vec()
    };
    std::iter::once(head(names)).chain(frames.enumerate().map(row)).collect()
}

/// What was decided, why, and what that saved.
fn decisions(page: &mut Page, built: &[(String, Duration)], frames: &[Shown]) {
    page.heading("What was built before the walk");
    let seconds =
        |time: &Duration| if time.is_zero() { "".into() } else { format!("{:.2} s", time.as_secs_f64()) };
    let rows = built.iter().map(|(what, time)| vec![what.clone(), seconds(time)]);
    page.table(&std::iter::once(vec!["what".into(), "time".into()]).chain(rows).collect::<Vec<_>>());
    page.heading("What was decided, and what that saved");
    page.table(&decision_table(frames));
    effects::nodes(page, frames);
    effects::shadows(page, frames);
    page.paragraph(
        "Some frames were drawn without a plan as well: all triangles of all objects in view, and the finest shadow maps. \
         Changed are pixels that differ by more than 4 of 255.",
    );
    page.table(&saving_table(frames));
    let compared = |(i, shown): (usize, &Shown)| {
        let c = shown.comparison.as_ref()?;
        let text =
            format!("Frame {i}: four times the difference; {:.2} % of the pixels changed", 100.0 * c.changed);
        Some((c.difference.clone(), text))
    };
    page.pictures(&frames.iter().enumerate().filter_map(compared).collect::<Vec<_>>());
    for (i, plan) in frames.iter().enumerate().filter_map(|(i, f)| Some((i, f.report.plan.as_ref()?))) {
        page.details(&format!("The plan of frame {i}, with its reasons"), &plan.to_string());
    }
}

/// Objects by what was decided, and the shadow, frame by frame.
fn decision_table(frames: &[Shown]) -> Vec<Vec<String>> {
    let names = [
        "frame",
        "out of view",
        "too small",
        "nodes",
        "coarser",
        "pictures",
        "in full",
        "hidden",
        "occlusion",
        "shadow",
    ];
    let mut rows = vec![head(names)];
    for (i, plan) in frames.iter().enumerate().filter_map(|(i, f)| Some((i, f.report.plan.as_ref()?))) {
        let count = |is: fn(&Decision) -> bool| plan.objects().iter().filter(|d| is(d)).count();
        let chosen = |effect| match plan.decision(effect) {
            Some(d) => format!("{} ({})", d.choice, d.because.class),
            None => "-".into(),
        };
        let nodes = count(|d| matches!(d.choice, Choice::Detail { form: Form::Mesh, .. }));
        let coarser = count(|d| matches!(d.choice, Choice::Detail { .. })) - nodes;
        let full = count(|d| d.choice == Choice::Full);
        let pictures = count(|d| matches!(d.choice, Choice::Impostor { .. }));
        let cells = [
            i.to_string(),
            count(|d| d.because.class == Class::Void).to_string(),
            count(|d| d.choice == Choice::Nothing && d.because.class != Class::Void).to_string(),
            nodes.to_string(),
            coarser.to_string(),
            pictures.to_string(),
            full.to_string(),
            (nodes + coarser + pictures + full).saturating_sub(frames[i].report.drawn).to_string(),
            chosen(Effect::Occlusion),
            chosen(Effect::Shadow { light: 0 }),
        ];
        rows.push(cells.to_vec());
    }
    rows
}

/// Planned frames beside the same with everything on.
fn saving_table(frames: &[Shown]) -> Vec<Vec<String>> {
    let names = [
        "frame",
        "triangles",
        "everything",
        "casters' triangles",
        "everything",
        "maps",
        "everything",
        "ms",
        "everything",
        "saved",
        "changed",
        "rmse",
    ];
    let mut rows = vec![head(names)];
    for (i, shown) in frames.iter().enumerate() {
        let Some(c) = &shown.comparison else { continue };
        let (planned, full) = (&shown.report, &c.full);
        let cast = |f: &FrameReport| f.shadow.as_ref().map_or("-".into(), |s| s.triangles.to_string());
        let side = |f: &FrameReport| f.shadow.as_ref().map_or("-".into(), maps);
        let cells = [
            i.to_string(),
            planned.counters.triangles.to_string(),
            full.counters.triangles.to_string(),
            cast(planned),
            cast(full),
            side(planned),
            side(full),
            format!("{:.0}", planned.time.0),
            format!("{:.0}", full.time.0),
            format!("{:.0} %", 100.0 * (1.0 - planned.time / full.time)),
            format!("{:.2} %", 100.0 * c.changed),
            format!("{:.2}", c.rmse),
        ];
        rows.push(cells.to_vec());
    }
    rows
}

/// The first row of a table.
pub fn head<const N: usize>(names: [&str; N]) -> Vec<String> {
    names.map(String::from).to_vec()
}

/// A length with four digits that mean something.
fn short(x: f64) -> String {
    let decimals = (3.0 - x.abs().max(1e-9).log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{x:.decimals$}")
}

/// Number and size of shadow maps.
pub fn maps(shadow: &ShadowReport) -> String {
    match shadow.maps {
        1 => format!("{}²", shadow.side),
        n => format!("{n} × {}²", shadow.side),
    }
}

/// How soft shadows are.
fn softness(shadow: &ShadowReport) -> String {
    let taps = if shadow.taps > 1 { format!("soft, {} samples", shadow.taps) } else { "hard".into() };
    format!("{taps}, penumbrae at most {:.0} px", shadow.penumbra_px)
}

fn caption(i: usize, frame: &FrameReport) -> String {
    let shadow = match &frame.shadow {
        None => "no shadow map".into(),
        Some(s) => {
            let plural = if s.maps > 1 { "s" } else { "" };
            format!(
                "shadow map{plural} of {}, texel at most {:.1} px, {:.1} in one map without a warp; {}",
                maps(s),
                s.texel,
                s.uniform,
                softness(s)
            )
        }
    };
    format!("Frame {i}: {} objects in view, {} drawn; {shadow}", frame.in_view, frame.drawn)
}

/// Frame by frame, the head first.
pub fn frame_table(frames: &[Shown]) -> Vec<Vec<String>> {
    let names = [
        "frame",
        "in view",
        "drawn",
        "triangles",
        "nodes",
        "casters",
        "maps",
        "taps",
        "texel px",
        "foretold",
        "ms",
        "everything",
    ];
    let mut rows = vec![head(names)];
    for (i, Shown { report: f, comparison, .. }) in frames.iter().enumerate() {
        let none = || ["-"; 4].map(String::from);
        let [casters, side, taps, texel] = f.shadow.as_ref().map_or_else(none, |s| {
            [s.casters_drawn.to_string(), maps(s), s.taps.to_string(), format!("{:.2}", s.texel)]
        });
        rows.push(vec![
            i.to_string(),
            f.in_view.to_string(),
            f.drawn.to_string(),
            f.counters.triangles.to_string(),
            f.nodes.nodes.to_string(),
            casters,
            side,
            taps,
            texel,
            format!("{:.0}", f.predicted.0),
            format!("{:.0}", f.time.0),
            comparison.as_ref().map_or("-".into(), |c| format!("{:.0}", c.full.time.0)),
        ]);
    }
    rows
}
