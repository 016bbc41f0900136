//! The growth of sets with rays.

use super::Sampled;
use plotters::prelude::*;
use std::error::Error;
use std::path::Path;

pub fn growth(path: &Path, all: &[Sampled]) -> Result<(), Box<dyn Error>> {
    let rays = all.iter().flat_map(|s| &s.growth).map(|g| g.0).max().unwrap_or(1) as f64 * 1e-6;
    let most = all.iter().flat_map(|s| &s.growth).map(|g| g.1).max().unwrap_or(1);
    let root = SVGBackend::new(path, (900, 500)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(16)
        .x_label_area_size(40)
        .y_label_area_size(70)
        .build_cartesian_2d(0.0..rays, 0..most + most / 20)?;
    chart.configure_mesh().x_desc("million rays").y_desc("visible triangles found").draw()?;
    let colours = [RGBColor(20, 90, 180), RGBColor(200, 90, 20), RGBColor(110, 110, 110)];
    for (sampled, colour) in all.iter().zip(colours) {
        let line = sampled.growth.iter().map(|&(rays, found)| (rays as f64 * 1e-6, found));
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
            .label(sampled.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .draw()?;
    root.present()?;
    Ok(())
}
