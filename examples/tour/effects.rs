//! Tables of the page about single effects: hierarchies that were drawn, and how soft shadows are.

use crate::Shown;
use crate::nodes::NodesReport;
use crate::page::Page;
use crate::planning::TAP;
use crate::report::{head, maps};
use crate::sun::ShadowReport;

/// What was drawn of hierarchies, frame by frame.
pub fn nodes(page: &mut Page, frames: &[Shown]) {
    let drawn = frames.iter().map(|f| &f.report.nodes);
    if drawn.clone().all(|n| n.surfaces == 0) {
        return;
    }
    page.paragraph(
        "Large surfaces are read from hierarchies on disk, as nodes that are as coarse as they may be where they are. Of each frame the error that its nodes have: proven for the \
         shape, estimated for where colours and normals belong.",
    );
    let names = [
        "frame",
        "surfaces",
        "nodes",
        "triangles",
        "off by px",
        "looks off by px",
        "missing",
        "MB in memory",
    ];
    let row = |(i, n): (usize, &NodesReport)| {
        [
            i.to_string(),
            n.surfaces.to_string(),
            n.nodes.to_string(),
            n.triangles.to_string(),
            format!("{:.3}", n.error_px),
            format!("{:.3}", n.look_px),
            n.missing.to_string(),
            format!("{:.1}", n.bytes as f64 * 1e-6),
        ]
        .to_vec()
    };
    page.table(&std::iter::once(head(names)).chain(drawn.enumerate().map(row)).collect::<Vec<_>>());
}

/// How soft shadows are, why, and what that is taken to cost, frame by frame.
pub fn shadows(page: &mut Page, frames: &[Shown]) {
    let drawn = frames.iter().map(|f| f.report.shadow.as_ref());
    if drawn.clone().flatten().all(|s| s.penumbra_px == 0.0) {
        return;
    }
    page.paragraph(
        "The sun has a size. A hard edge in place of its penumbra is off by an eighth of the light for every pixel of its width, half of it at most; a soft one by half of one sample. \
         Wherever the former is more than is tolerated, samples are taken: as many as search for what is in front filter what they find.",
    );
    let names = [
        "frame",
        "maps",
        "widest penumbra px",
        "a hard edge off by",
        "samples",
        "off by",
        "ms for the maps",
        "ms for the samples, as planned with",
    ];
    let share = |s: f64| format!("{:.1} %", 100.0 * s);
    let cells = |s: &ShadowReport| {
        let hard = (s.penumbra_px / 8.0).min(0.5);
        let taps = f64::from(s.taps);
        [
            maps(s),
            format!("{:.2}", s.penumbra_px),
            share(hard),
            s.taps.to_string(),
            share(if s.taps > 1 { 0.5 / taps } else { hard }),
            format!("{:.0}", s.time.0),
            format!("{:.0}", (TAP * (s.samples * taps)).0),
        ]
    };
    let row = |(i, s): (usize, Option<&ShadowReport>)| {
        let cells = s.map_or_else(|| ["-"; 7].map(String::from), cells);
        std::iter::once(i.to_string()).chain(cells).collect::<Vec<_>>()
    };
    page.table(&std::iter::once(head(names)).chain(drawn.enumerate().map(row)).collect::<Vec<_>>());
}
