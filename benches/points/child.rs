//! Work in a process of its own, so that its CPU time and peak memory are its own.

use farsight_points::{BuildOptions, Input, LasOptions, Progress, Stage, build};
use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::time::Instant;

/// What a build took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Usage {
    pub wall: f64,
    pub cpu: f64,
    /// Peak resident memory in MiB.
    pub peak: f64,
    pub nodes: f64,
    pub payload: f64,
    pub structure: f64,
}

/// A build to run.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    pub input: &'a Path,
    pub out: &'a Path,
    pub threads: usize,
    pub memory_mib: u64,
    pub attributes: bool,
}

/// Builds in a child process.
pub fn run(job: &Job) -> Result<Usage, Box<dyn Error>> {
    let output = Command::new(std::env::current_exe()?)
        .arg("--child")
        .args([job.input, job.out])
        .args([job.threads.to_string(), job.memory_mib.to_string(), job.attributes.to_string()])
        .output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned().into());
    }
    let text = String::from_utf8(output.stdout)?;
    let v: Vec<f64> = text.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
    let [wall, cpu, peak, nodes, payload, structure] = v[..] else { return Err(text.into()) };
    Ok(Usage { wall, cpu, peak, nodes, payload, structure })
}

/// The child's side.
pub fn main(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let [input, out, threads, memory, attributes] = arguments else { return Err("five arguments".into()) };
    let mut options = BuildOptions::default();
    (options.threads, options.memory) = (threads.parse()?, memory.parse::<u64>()? << 20);
    let mut las = LasOptions::default();
    las.attributes = attributes.parse()?;
    let start = Instant::now();
    let stages = Mutex::new(Vec::<(Stage, f64)>::new());
    let progress = |p: Progress| {
        let mut stages = stages.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if stages.last().is_none_or(|s| s.0 != p.stage) {
            stages.push((p.stage, start.elapsed().as_secs_f64()));
        }
        ControlFlow::Continue(())
    };
    let report = build(Input::las(&[input], &las)?, out, &options, &progress)?;
    if std::env::var_os("STAGES").is_some() {
        eprintln!("{:?} {}", stages.lock(), start.elapsed().as_secs_f64());
    }
    let wall = start.elapsed().as_secs_f64();
    println!(
        "{wall} {} {} {} {} {}",
        cpu_seconds(),
        peak_mib(),
        report.nodes,
        report.payload_bytes,
        report.structure_bytes
    );
    Ok(())
}

/// CPU time of this process and all its threads, user and system.
pub fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in parentheses may hold blanks; utime and stime are the 14th and 15th field, in hundredths of a second.
    let rest = stat.rsplit(')').next().unwrap_or_default();
    let ticks: u64 = rest.split_whitespace().skip(11).take(2).filter_map(|v| v.parse::<u64>().ok()).sum();
    ticks as f64 / 100.0
}

/// Peak resident memory of this process.
pub fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or_default();
    line.split_whitespace().next().and_then(|v| v.parse::<f64>().ok()).unwrap_or(f64::NAN) / 1024.0
}
