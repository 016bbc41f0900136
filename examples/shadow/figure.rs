//! The figures.

use crate::offset::Truth;
use farsight_raster::{Image, RasterError, srgb_byte};
use farsight_shadow::Spacing;
use plotters::prelude::*;
use std::path::Path;

/// A method's shadows, pixel by pixel; `None` where there is nothing to light.
pub struct Row {
    pub lit: Vec<Option<bool>>,
}

/// Parts of the picture that are shown, as shares of its height: centre (x, y) and half the side; near, medium, far.
const WINDOWS: [([f64; 2], f64); 3] = [([0.64, 0.84], 0.15), ([1.02, 0.40], 0.09), ([1.04, 0.385], 0.04)];
/// Side of a window in the figure, in pixels.
const PANEL: u32 = 300;
const GAP: u32 = 8;

/// Rows of three windows, magnified without smoothing; pixels that differ from the rays' are red.
pub fn comparison(truth: &Truth, by_rays: &[Option<bool>], rows: &[Row]) -> Result<Image, RasterError> {
    let (columns, lines) = (WINDOWS.len() as u32, rows.len() as u32);
    let (width, height) = (columns * (PANEL + GAP) + GAP, lines * (PANEL + GAP) + GAP);
    let mut pixels = vec![[255u8; 3]; (width * height) as usize];
    let picture_height = truth.pixels.len() as u32 / truth.width;
    for (j, row) in rows.iter().enumerate() {
        for (i, &(centre, half)) in WINDOWS.iter().enumerate() {
            for y in 0..PANEL {
                for x in 0..PANEL {
                    let at = |k: u32, c: f64, most: u32| {
                        let share = c + half * (2.0 * (f64::from(k) + 0.5) / f64::from(PANEL) - 1.0);
                        ((share * f64::from(picture_height)).max(0.0) as u32).min(most - 1)
                    };
                    let (sx, sy) = (at(x, centre[0], truth.width), at(y, centre[1], picture_height));
                    let source = (sy * truth.width + sx) as usize;
                    let (px, py) = (GAP + i as u32 * (PANEL + GAP) + x, GAP + j as u32 * (PANEL + GAP) + y);
                    pixels[(py * width + px) as usize] = colour(row.lit[source], by_rays[source]);
                }
            }
        }
    }
    Image::new(width, height, pixels)
}

fn colour(lit: Option<bool>, truth: Option<bool>) -> [u8; 3] {
    match (lit, truth) {
        (None, _) => [150, 178, 214],
        (Some(true), Some(false)) => [255, 150, 120],
        (Some(false), Some(true)) => [170, 30, 20],
        (Some(true), _) => [226, 220, 205],
        (Some(false), _) => [84, 82, 90],
    }
}

/// Square grey panels side by side.
pub fn strip(side: u32, panels: &[&[f64]]) -> Result<Image, RasterError> {
    let width = panels.len() as u32 * (side + GAP) + GAP;
    let height = side + 2 * GAP;
    let mut pixels = vec![[255u8; 3]; (width * height) as usize];
    for (i, panel) in panels.iter().enumerate() {
        for (k, &value) in panel.iter().enumerate() {
            let (x, y) = (k as u32 % side, k as u32 / side);
            let at = (y + GAP) * width + GAP + i as u32 * (side + GAP) + x;
            pixels[at as usize] = [srgb_byte((0.85 * value + 0.02) as f32); 3];
        }
    }
    Image::new(width, height, pixels)
}

/// dp/ds along the view for far/near = 400, as in figure 3.6, with the warp of least product and the logarithmic bound.
pub fn curves(path: &Path) -> Result<(), Box<dyn std::error::Error>> {
    const R: f64 = 400.0;
    let cases = [
        ("uniform", Spacing::Uniform, RGBColor(90, 90, 90)),
        ("perspective (n = zn)", Spacing::Warp { n: 1.0 }, RGBColor(220, 50, 32)),
        ("LiSPSM (n = zn + √(zn zf))", Spacing::best_warp(1.0, R), RGBColor(0, 90, 181)),
        ("least product", Spacing::Warp { n: (R - 1.0) / (R.powf(2.0 / 3.0) - 1.0) }, RGBColor(30, 136, 60)),
        ("logarithmic", Spacing::Logarithmic, RGBColor(148, 80, 170)),
    ];
    let root = SVGBackend::new(path, (860, 520)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption("Perspective aliasing dp/ds along the view, far/near = 400", ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(60)
        .build_cartesian_2d((1.0..R).log_scale(), (0.5..600.0f64).log_scale())?;
    chart.configure_mesh().x_desc("z / zn").y_desc("dp/ds").draw()?;
    for (name, spacing, colour) in cases {
        let points = (0..=300).map(|i| {
            let z = R.powf(f64::from(i) / 300.0);
            (z, spacing.dp_ds(1.0, R, z))
        });
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperMiddle)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK)
        .draw()?;
    root.present()?;
    Ok(())
}
