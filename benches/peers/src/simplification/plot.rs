//! What a true error costs, by tier, beside meshoptimizer.

use plotters::prelude::*;
use std::path::Path;

/// A tier or peer: its name, and what the true error (over the diagonal) costs at each tolerance.
pub type Line = (&'static str, Vec<(f64, f64)>);

/// Writes the plot as SVG.
pub fn cost(
    path: &Path,
    surface: &str,
    what: &str,
    lines: &[Line],
) -> Result<(), Box<dyn std::error::Error>> {
    const COLOURS: [RGBColor; 4] =
        [RGBColor(0, 90, 181), RGBColor(30, 136, 60), RGBColor(200, 130, 0), RGBColor(90, 90, 90)];
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let all = lines.iter().flat_map(|l| l.1.iter().map(pick));
        let (low, high) = all.fold((f64::MAX, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
        // Whole decades: their labels do not collide.
        10f64.powf(low.log10().floor())..10f64.powf(high.log10().ceil())
    };
    let root = SVGBackend::new(path, (720, 440)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(format!("What a true error costs: {surface}"), ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(range(|p| p.0).log_scale(), range(|p| p.1).log_scale())?;
    chart
        .configure_mesh()
        .x_desc(what)
        .y_desc("true error / diagonal")
        .y_label_formatter(&|v| format!("{v:.0e}"))
        .draw()?;
    for ((name, points), colour) in lines.iter().zip(COLOURS) {
        chart
            .draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2)).point_size(4))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
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
