//! A page: frames, and a table that tells what each object was shown as, and why.

use crate::walk::{Frame, Row};
use base64::Engine;
use farsight_lod::{Decision, Kind, Reason};
use farsight_raster::Image;
use std::fmt::Write;

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:76rem;margin:2rem auto;padding:0 1rem}\
 table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums;font-size:.9rem}\
 th,td{padding:.2rem .7rem;text-align:right;border-bottom:1px solid #ddd}th:last-child,td:last-child,td:nth-child(2){text-align:left}\
 img{max-width:100%}figure{margin:1rem 0}figcaption{font-size:.9rem;color:#555}";

pub struct Page {
    body: String,
}

impl Page {
    pub fn new(summary: &str) -> Self {
        let body = format!(
            "<!doctype html><html lang=en><meta charset=utf-8><title>An avenue of approximations</title><style>{STYLE}</style>\n\
             <h1>An avenue of approximations</h1>\n<p>{summary}</p>\n"
        );
        Self { body }
    }

    /// A frame with its table.
    pub fn frame(&mut self, number: usize, frame: &Frame, names: &dyn Fn(usize) -> String) {
        let _ = writeln!(self.body, "<h2>Frame {number}</h2>");
        if let Some(image) = &frame.image {
            self.image(
                image,
                "Lower right: triangles that were drawn in blue, outlines of pictures in orange.",
            );
        }
        let _ = writeln!(
            self.body,
            "<table><tr><th>object<th>model<th>distance<th>shown as<th>error at most<th>made<th>predicted to serve<th>ms a frame: triangles, picture<th>why"
        );
        for row in &frame.rows {
            let costs = row.decision.map_or("–".into(), |d| costs(&d));
            let _ = writeln!(
                self.body,
                "<tr><td>{}<td>{}<td>{:.1} m<td>{}<td>{:.2} px<td>{} frames ago<td>{:.0} frames<td>{costs}<td>{}</tr>",
                row.object,
                names(row.object),
                row.distance,
                row.size,
                row.error_px,
                row.made,
                row.predicted,
                why(row)
            );
        }
        self.body += "</table>\n";
    }

    pub fn image(&mut self, image: &Image, caption: &str) {
        let Ok(png) = image.to_png() else { return };
        let data = base64::engine::general_purpose::STANDARD.encode(png);
        let _ = writeln!(
            self.body,
            "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
        );
    }

    pub fn finish(self) -> String {
        self.body + "</html>\n"
    }
}

fn costs(d: &Decision) -> String {
    let picture = if d.impostor_ms.is_finite() { format!("{:.3}", d.impostor_ms) } else { "–".into() };
    format!("{:.3}, {picture}", d.geometry_ms)
}

fn why(row: &Row) -> String {
    let Some(d) = row.decision else { return String::new() };
    let text = match d.reason {
        Reason::NotSeparable => "something stands between its parts",
        Reason::TooLarge => "a picture would fill too much of the image",
        Reason::NoPicture => "a picture would not serve for a frame",
        Reason::GeometryCheaper => "triangles cost less",
        Reason::ImpostorCheaper => "a picture costs less",
        Reason::WithinMargin => "a picture would not save enough",
        Reason::FirstSeen => "seen for the first time",
        _ => "",
    };
    match (row.kind, d.kind) {
        (Kind::Impostor, Kind::Geometry) | (Kind::Geometry, Kind::Impostor) => {
            format!("{text}; a cached one serves")
        }
        _ => text.into(),
    }
}
