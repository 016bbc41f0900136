//! Clouds from files.

use farsight_geometry::PointCloud;
use farsight_points::{BuildOptions, BuildReport, Input, LasOptions, PointsError, Progress, Stage, build};
use indicatif::{ProgressBar, ProgressStyle};
use std::error::Error;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Builds `out` from .las, .laz and .ply files.
pub fn build_files(
    paths: &[PathBuf],
    out: &Path,
    options: &BuildOptions,
    attributes: bool,
) -> Result<BuildReport, Box<dyn Error>> {
    let is_ply = |p: &&PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply"));
    let (plys, others): (Vec<&PathBuf>, Vec<&PathBuf>) = paths.iter().partition(is_ply);
    let clouds: Vec<PointCloud> = plys.into_iter().map(|p| load(p)).collect::<Result<_, _>>()?;
    let mut input: Option<Input> = None;
    if !others.is_empty() {
        let mut las = LasOptions::default();
        las.attributes = attributes;
        input = Some(Input::las(&others, &las)?);
    }
    for cloud in &clouds {
        let next = Input::from_cloud(cloud)?;
        input = Some(match input {
            None => next,
            Some(all) => all.join(next)?,
        });
    }
    Ok(with_bar(input.ok_or("no files")?, out, options)?)
}

fn load(path: &Path) -> Result<PointCloud, Box<dyn Error>> {
    let loaded = farsight_geometry::io::load(path)?;
    loaded.into_points().ok_or_else(|| format!("{}: a mesh, not points", path.display()).into())
}

/// Builds with a bar that says how far it is.
pub fn with_bar(input: Input<'_>, out: &Path, options: &BuildOptions) -> Result<BuildReport, PointsError> {
    let bar = ProgressBar::new(0);
    let style = ProgressStyle::with_template("{msg:<12} {bar:40} {human_pos:>12} points {elapsed:>4}");
    bar.set_style(style.expect("a valid template"));
    let last = Mutex::new(None);
    let progress = |p: Progress| {
        let mut last = last.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if *last != Some(p.stage) {
            *last = Some(p.stage);
            bar.set_message(match p.stage {
                Stage::Read => "reading",
                Stage::Count => "counting",
                Stage::Partition => "distributing",
                _ => "building",
            });
        }
        bar.set_length(p.total.max(p.done));
        bar.set_position(p.done);
        ControlFlow::Continue(())
    };
    let report = build(input, out, options, &progress);
    bar.finish_and_clear();
    report
}
