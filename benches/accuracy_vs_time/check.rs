//! What must hold of every sweep.

use super::row::{Row, baseline_key};
use farsight_geometry::accuracy::Kind;

/// Allowed growth of a counter over the baseline.
const GROWTH: f64 = 1.05;
/// A finer setting is slower only beyond this factor, and worse only beyond this one: times are noisy.
const SLOWER: f64 = 1.25;
const WORSE: f64 = 1.01;

/// Every promise that the rows break, in words.
pub fn broken_promises(rows: &[Row], baseline: &str) -> Vec<String> {
    let mut broken: Vec<String> = rows.iter().filter_map(exceeded).collect();
    for pair in rows.windows(2) {
        broken.extend(slower_and_worse(&pair[0], &pair[1]));
    }
    for row in rows {
        broken.extend(grown(row, baseline));
    }
    broken
}

fn exceeded(row: &Row) -> Option<String> {
    let over = row.claimed.kind == Kind::Proven && row.measured > row.claimed.value;
    over.then(|| {
        format!("{}: {:e} measured, {:e} proven", baseline_key(row), row.measured, row.claimed.value)
    })
}

/// Rows of one knob on one scene stand from coarse to fine.
fn slower_and_worse(coarse: &Row, fine: &Row) -> Option<String> {
    let same = coarse.scene == fine.scene && coarse.knob == fine.knob;
    let slower = fine.times_ns().1 as f64 > SLOWER * coarse.times_ns().1 as f64;
    let worse = fine.measured > WORSE * coarse.measured;
    (same && slower && worse)
        .then(|| format!("{} is slower and worse than {:e}", baseline_key(fine), coarse.value))
}

fn grown(row: &Row, baseline: &str) -> Vec<String> {
    let key = baseline_key(row) + ",";
    let Some(expected) = baseline.lines().find_map(|line| line.strip_prefix(&key)) else {
        return vec![format!("{key} is not in the baseline; accept it with --bless")];
    };
    let counted = expected.split_whitespace().filter_map(|pair| {
        let (name, count) = pair.split_once('=')?;
        Some((name, count.parse::<u64>().ok()?))
    });
    let grew = |(name, before): (&str, u64)| {
        let now = row.counters.get(name);
        (now as f64 > before as f64 * GROWTH).then(|| format!("{key} {name} grew from {before} to {now}"))
    };
    counted.filter_map(grew).collect()
}
