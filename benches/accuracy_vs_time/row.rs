//! One line of a sweep: a setting, what it claims, what was measured, what it took.

use farsight_geometry::accuracy::{Counters, ErrorBound};
use std::fmt::Write;
use std::time::{Duration, Instant};

/// A setting of a crate's knob on a scene, and its outcome.
#[derive(Clone, Debug)]
pub struct Row {
    /// Crate, by its folder's name.
    pub krate: &'static str,
    /// Scene.
    pub scene: String,
    /// Name of the knob (and of the method, where several are compared).
    pub knob: String,
    /// Its value.
    pub value: f64,
    /// What the answer claims.
    pub claimed: ErrorBound,
    /// The true error, measured independently, in the unit of the claim.
    pub measured: f64,
    /// Times of the repeated runs.
    pub times: Vec<Duration>,
    /// Memory of the result.
    pub bytes: u64,
    /// Work.
    pub counters: Counters,
}

impl Row {
    /// Median and least time in nanoseconds.
    pub fn times_ns(&self) -> (u128, u128) {
        let mut sorted = self.times.clone();
        sorted.sort_unstable();
        (sorted[sorted.len() / 2].as_nanos(), sorted[0].as_nanos())
    }
}

/// Runs `work` `runs` times; returns its last answer and all times.
pub fn timed<T>(runs: usize, mut work: impl FnMut() -> T) -> (T, Vec<Duration>) {
    let mut times = Vec::with_capacity(runs);
    loop {
        let start = Instant::now();
        let answer = work();
        times.push(start.elapsed());
        if times.len() >= runs.max(1) {
            return (answer, times);
        }
    }
}

/// The table with all columns.
pub fn to_csv(rows: &[Row]) -> String {
    let mut csv = String::from(
        "crate,scene,knob,value,unit,claimed,kind,measured,norm,median_ns,min_ns,bytes,counters\n",
    );
    for r in rows {
        let (median, min) = r.times_ns();
        let c = &r.claimed;
        writeln!(
            csv,
            "{},{},{},{:e},{},{:e},{},{:e},{},{median},{min},{},{}",
            r.krate,
            r.scene,
            r.knob,
            r.value,
            c.unit,
            c.value,
            c.kind,
            r.measured,
            c.norm,
            r.bytes,
            r.counters
        )
        .expect("writing to a string");
    }
    csv
}

/// What is deterministic: the setting and its counters.
pub fn to_baseline(rows: &[Row]) -> String {
    rows.iter().fold(String::from("scene,knob,value,counters\n"), |text, r| {
        text + &baseline_key(r) + &format!(",{}\n", r.counters)
    })
}

/// The part of a baseline line that names the setting.
pub fn baseline_key(row: &Row) -> String {
    format!("{},{},{:e}", row.scene, row.knob, row.value)
}

/// Prints the rows for people.
pub fn print_table(rows: &[Row]) {
    println!(
        "{:<16} {:<22} {:>9} {:>12} {:<10} {:>12} {:>5} {:>12} {:>12}  work",
        "scene", "knob", "value", "claimed", "kind", "measured", "unit", "median ms", "bytes"
    );
    for r in rows {
        let (median, _) = r.times_ns();
        println!(
            "{:<16} {:<22} {:>9.2e} {:>12.4e} {:<10} {:>12.4e} {:>5} {:>12.4} {:>12}  {}",
            r.scene,
            r.knob,
            r.value,
            r.claimed.value,
            r.claimed.kind.to_string(),
            r.measured,
            r.claimed.unit.to_string(),
            median as f64 * 1e-6,
            r.bytes,
            r.counters
        );
    }
}
