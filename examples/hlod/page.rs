//! A page with the tables and the picture.

use crate::Level;
use farsight_hlod::BuildReport;
use std::fmt::Write;

pub fn page(report: &BuildReport, levels: &[Level]) -> String {
    let mut rows = String::new();
    for l in levels {
        let _ = writeln!(
            rows,
            "<tr><td>{}<td>{}<td>{}<td>{:.2} %<td>{:.3}<td>{:.3}<td>{:.2}</tr>",
            l.px,
            l.nodes,
            l.triangles,
            100.0 * l.triangles as f64 / report.triangles.max(1) as f64,
            l.claimed,
            l.measured,
            l.views.rmse
        );
    }
    let mut tree = String::new();
    for (i, l) in report.levels.iter().enumerate() {
        let _ = writeln!(
            tree,
            "<tr><td>{i}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{:.3e}</tr>",
            l.nodes,
            l.leaves,
            l.triangles,
            l.triangles / l.nodes.max(1),
            l.bytes,
            l.error
        );
    }
    format!(
        "<!doctype html><meta charset=utf-8><title>A surface as a hierarchy</title>\n\
         <style>body{{font:16px sans-serif;margin:2em}}td,th{{padding:.2em 1em;text-align:right}}img{{max-width:100%}}</style>\n\
         <h1>{} triangles as a hierarchy: {} bytes, built in {:.1} s</h1>\n\
         <table><tr><th>pixels<th>nodes<th>triangles<th>of all<th>claimed px<th>measured px<th>RMSE / 255</tr>\n{rows}</table>\n\
         <p>Columns: the original, then each tolerance. Rows: shaded, nodes, difference to the original (four times).</p>\n\
         <img src=comparison.png>\n\
         <h2>Levels</h2>\n\
         <table><tr><th>level<th>nodes<th>leaves<th>triangles<th>a node<th>bytes<th>error</tr>\n{tree}</table>\n",
        report.triangles,
        report.bytes,
        report.cost.time.as_secs_f64()
    )
}
