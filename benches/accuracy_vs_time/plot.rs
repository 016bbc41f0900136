//! Error against time, both logarithmic: one line per scene and knob.

use super::row::Row;
use plotters::prelude::*;
use std::path::Path;

const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 90, 181),
    RGBColor(220, 50, 32),
    RGBColor(30, 136, 60),
    RGBColor(148, 80, 170),
    RGBColor(200, 130, 0),
    RGBColor(90, 90, 90),
];
/// Errors at and below this are drawn here, so that an exact answer has a place on a logarithmic axis.
const FLOOR: f64 = 1e-9;

/// Writes the plot as SVG: the rows in the unit of the first one. Errors of other units stand in the table only.
pub fn pareto(path: &Path, caption: &str, rows: &[Row]) -> Result<(), Box<dyn std::error::Error>> {
    let rows: Vec<&Row> = rows.iter().filter(|r| r.claimed.unit == rows[0].claimed.unit).collect();
    let point = |r: &Row| (r.times_ns().0 as f64 * 1e-6, r.measured.max(FLOOR));
    let claim = |r: &Row| (r.times_ns().0 as f64 * 1e-6, r.claimed.value.max(FLOOR));
    let all = || rows.iter().flat_map(|&r| [point(r), claim(r)]).filter(|p| p.1.is_finite());
    let range = |pick: fn((f64, f64)) -> f64| {
        let (lo, hi) =
            all().map(pick).fold((f64::MAX, f64::MIN_POSITIVE), |(lo, hi), v| (lo.min(v), hi.max(v)));
        lo * 0.5..hi * 2.0
    };
    let root = SVGBackend::new(path, (860, 520)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(caption, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(72)
        .build_cartesian_2d(range(|p| p.0).log_scale(), range(|p| p.1).log_scale())?;
    let unit = rows.first().map_or(String::new(), |r| r.claimed.unit.to_string());
    chart
        .configure_mesh()
        .x_desc("median time, ms")
        .y_desc(format!("error, {unit}: measured (dots), claimed (crosses)"))
        .x_label_formatter(&|v| format!("{v:.0e}"))
        .y_label_formatter(&|v| format!("{v:.0e}"))
        .draw()?;
    for (i, line) in rows.chunk_by(|a, b| a.scene == b.scene && a.knob == b.knob).enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let measured: Vec<(f64, f64)> = line.iter().copied().map(point).collect();
        chart
            .draw_series(LineSeries::new(measured.clone(), colour.stroke_width(2)))?
            .label(format!("{}: {}", line[0].scene, line[0].knob))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        chart.draw_series(measured.iter().map(|&p| Circle::new(p, 3, colour.filled())))?;
        let claims = line.iter().copied().map(claim).filter(|p| p.1.is_finite());
        chart.draw_series(claims.map(|p| Cross::new(p, 4, colour.stroke_width(1))))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerLeft)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK)
        .draw()?;
    root.present()?;
    Ok(())
}
