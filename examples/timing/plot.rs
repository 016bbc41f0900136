//! The two plots.

use farsight_timing::Millis;
use plotters::prelude::*;
use std::error::Error;
use std::path::Path;

/// A frame: by the calibration alone, refitted, with the band of nine in ten frames, and what it took.
pub struct Predicted {
    pub alone: Millis,
    pub predicted: Millis,
    pub band: [Millis; 2],
    pub measured: Millis,
}

const BLUE: RGBColor = RGBColor(0, 90, 181);
const COLOURS: [RGBColor; 3] = [RGBColor(150, 150, 150), RGBColor(220, 50, 32), RGBColor(30, 136, 60)];

type Chart<'a, 'b> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordusize, plotters::coord::types::RangedCoordf64>,
>;

pub fn predicted(path: &Path, frames: &[Predicted]) -> Result<(), Box<dyn Error>> {
    let top = frames.iter().flat_map(|f| [f.measured.0, f.band[1].0]).fold(0.0, f64::max) * 1.15;
    let root = SVGBackend::new(path, (960, 420)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption("Frames of a walk: predicted before, measured after", ("sans-serif", 18))
        .margin(10)
        .x_label_area_size(36)
        .y_label_area_size(56)
        .build_cartesian_2d(0..frames.len().max(2) - 1, 0.0..top)?;
    chart.configure_mesh().x_desc("frame").y_desc("ms").light_line_style(WHITE).draw()?;
    let upper = frames.iter().enumerate().map(|(i, f)| (i, f.band[1].0));
    let lower = frames.iter().enumerate().rev().map(|(i, f)| (i, f.band[0].0));
    chart
        .draw_series([Polygon::new(upper.chain(lower).collect::<Vec<_>>(), BLUE.mix(0.2))])?
        .label("5 % to 95 % quantile")
        .legend(|(x, y)| Rectangle::new([(x, y - 5), (x + 18, y + 5)], BLUE.mix(0.2).filled()));
    let clipped = frames.iter().map(|f| f.alone.min(Millis(top)));
    line(&mut chart, "calibrated on single objects", COLOURS[0], clipped)?;
    line(&mut chart, "refitted on frames", BLUE, frames.iter().map(|f| f.predicted))?;
    line(&mut chart, "measured", COLOURS[1], frames.iter().map(|f| f.measured))?;
    legend(&mut chart)?;
    root.present()?;
    Ok(())
}

pub fn held(path: &Path, target: Millis, lines: &[(&str, Vec<Millis>)]) -> Result<(), Box<dyn Error>> {
    let frames = lines.iter().map(|l| l.1.len()).max().unwrap_or(0).max(2);
    let top = lines.iter().flat_map(|l| &l.1).fold(0.0, |m: f64, t| m.max(t.0)) * 1.15;
    let root = SVGBackend::new(path, (960, 420)).into_drawing_area();
    root.fill(&WHITE)?;
    let caption = format!("Holding {} ms; everything takes 1.5 times as long from two thirds on", target.0);
    let mut chart = ChartBuilder::on(&root)
        .caption(caption, ("sans-serif", 18))
        .margin(10)
        .x_label_area_size(36)
        .y_label_area_size(56)
        .build_cartesian_2d(0..frames - 1, 0.0..top)?;
    chart.configure_mesh().x_desc("frame").y_desc("ms").light_line_style(WHITE).draw()?;
    line(&mut chart, "target", BLACK, std::iter::repeat_n(target, frames))?;
    for ((name, times), colour) in lines.iter().zip(COLOURS) {
        line(&mut chart, name, colour, times.iter().copied())?;
    }
    legend(&mut chart)?;
    root.present()?;
    Ok(())
}

fn line(
    chart: &mut Chart,
    name: &str,
    colour: RGBColor,
    times: impl Iterator<Item = Millis>,
) -> Result<(), Box<dyn Error>> {
    let points = times.enumerate().map(|(i, t)| (i, t.0));
    chart
        .draw_series(LineSeries::new(points, colour.stroke_width(2)))
        .map_err(|e| e.to_string())?
        .label(name)
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    Ok(())
}

fn legend<'a>(chart: &mut Chart<'a, 'a>) -> Result<(), Box<dyn Error>> {
    let labels = &mut chart.configure_series_labels();
    let labels = labels
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK);
    labels.draw().map_err(|e| e.to_string())?;
    Ok(())
}
