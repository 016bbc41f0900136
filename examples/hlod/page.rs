//! A page with the table and the picture.

use crate::Level;
use std::fmt::Write;

pub fn page(triangles: usize, levels: &[Level]) -> String {
    let mut rows = String::new();
    for l in levels {
        let _ = writeln!(
            rows,
            "<tr><td>{}<td>{:.3e}<td>{}<td>{:.2} %<td>{:.3e}<td>{:.3e}<td>{:.1}<td>{:.2}</tr>",
            l.px,
            l.tolerance,
            l.mesh.triangles().len(),
            100.0 * l.mesh.triangles().len() as f64 / triangles as f64,
            l.claimed,
            l.measured,
            l.time.as_secs_f64() * 1e3,
            l.views.rmse
        );
    }
    format!(
        "<!doctype html><meta charset=utf-8><title>Simplified within a tolerance</title>\n\
         <style>body{{font:16px sans-serif;margin:2em}}td,th{{padding:.2em 1em;text-align:right}}img{{max-width:100%}}</style>\n\
         <h1>{triangles} triangles, simplified within a tolerance</h1>\n\
         <table><tr><th>pixels<th>tolerance<th>triangles<th>kept<th>claimed<th>measured<th>ms<th>RMSE / 255</tr>\n{rows}</table>\n\
         <p>Columns: the original, then each tolerance. Rows: shaded, triangles, difference to the original (four times).</p>\n\
         <img src=comparison.png>\n"
    )
}
