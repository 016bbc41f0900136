//! Builds that are killed, or whose disk is full.
#![cfg(unix)]

mod common;

use common::{Folder, Random, build_points, surface};
use farsight_points::{BuildOptions, Store};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn options() -> BuildOptions {
    let mut options = BuildOptions::default();
    options.memory = 64 << 20;
    options
}

/// The victim: run by the tests below in a process of its own.
#[test]
#[ignore = "only as a child of the other tests"]
fn child() {
    let Some(path) = std::env::var_os("FARSIGHT_POINTS_CHILD") else { return };
    // Large enough to be spilled.
    if let Err(error) = build_points(&surface(1_000_000, 2), Path::new(&path), &options()) {
        eprintln!("error: {error}");
        std::process::exit(7);
    }
}

fn command(path: &Path, shell: &str) -> Command {
    running("child", path, shell)
}

fn running(name: &str, path: &Path, shell: &str) -> Command {
    let mut command = Command::new("sh");
    command
        .arg("-c")
        .arg(format!("{shell} exec \"$0\" --exact {name} --ignored --nocapture"))
        .arg(std::env::current_exe().unwrap())
        .env("FARSIGHT_POINTS_CHILD", path)
        .stdout(Stdio::null());
    command
}

#[test]
fn killed_at_any_instant_the_old_file_or_the_new_one_is_there() {
    let folder = Folder::new("kill");
    let path: PathBuf = folder.path("a.points");
    let start = Instant::now();
    assert!(command(&path, "").status().unwrap().success());
    let whole = start.elapsed();
    let new = std::fs::read(&path).unwrap();
    let mut random = Random(1);
    let (mut unfinished, mut left_behind) = (0, 0);
    for round in 0..50 {
        build_points(&surface(500, 1), &path, &options()).unwrap();
        assert_eq!(folder.names(), ["a.points"], "round {round}: what the killed one left is gone");
        let old = std::fs::read(&path).unwrap();
        let mut victim = command(&path, "").spawn().unwrap();
        std::thread::sleep(whole.mul_f64(random.unit()).min(Duration::from_secs(5)));
        victim.kill().unwrap();
        victim.wait().unwrap();
        let found = std::fs::read(&path).unwrap();
        assert!(found == old || found == new, "round {round}: neither the old file nor the new one");
        Store::open(&path).unwrap();
        unfinished += usize::from(found == old);
        left_behind += usize::from(folder.names().len() > 1);
    }
    assert!(unfinished > 10 && left_behind > 5, "{unfinished} unfinished, {left_behind} with scratch files");
    build_points(&surface(500, 1), &path, &options()).unwrap();
    assert_eq!(folder.names(), ["a.points"]);
}

/// As [`child`], from a LAS file, and able to go on.
#[cfg(feature = "las")]
#[test]
#[ignore = "only as a child of the other tests"]
fn resuming_child() {
    use farsight_points::{Input, LasOptions, Progress, Stage, build};
    let Some(path) = std::env::var_os("FARSIGHT_POINTS_CHILD").map(PathBuf::from) else { return };
    let dies = std::env::var_os("FARSIGHT_POINTS_DIES").is_some();
    let mut options = options();
    options.resume = true;
    let progress = |p: Progress| {
        // As by a kill: nothing is cleaned up.
        if dies && p.stage == Stage::Build && p.done > p.total / 2 {
            std::process::abort();
        }
        std::ops::ControlFlow::Continue(())
    };
    let input = Input::las(&[path.with_extension("las")], &LasOptions::default()).unwrap();
    let report = build(input, &path, &options, &progress).unwrap();
    std::process::exit(if report.cost.counters.get("resumed") == 1 { 11 } else { 12 });
}

#[cfg(feature = "las")]
#[test]
fn a_killed_build_goes_on_where_it_was_and_ends_the_same() {
    use farsight_points::{Input, LasOptions, build, no_progress};
    let folder = Folder::new("resume");
    let path = folder.path("a.points");
    let las = path.with_extension("las");
    std::fs::write(&las, common::las_bytes(&surface(600_000, 3))).unwrap();
    build(Input::las(&[&las], &LasOptions::default()).unwrap(), &path, &options(), &no_progress).unwrap();
    let expected = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    let run = |dies: bool| {
        let mut command = running("resuming_child", &path, "");
        command.stderr(Stdio::null());
        if dies {
            command.env("FARSIGHT_POINTS_DIES", "1");
        }
        command.status().unwrap().code()
    };
    assert_eq!(run(true), None, "died by a signal");
    assert!(folder.names().len() > 2 && !path.exists());
    assert_eq!(run(false), Some(11), "resumed");
    assert!(std::fs::read(&path).unwrap() == expected);
    assert_eq!(folder.names(), ["a.las", "a.points"]);
    // Another input is not taken for the same.
    assert_eq!(run(true), None);
    std::fs::write(&las, common::las_bytes(&surface(600_000, 4))).unwrap();
    assert_eq!(run(false), Some(12), "done anew");
    assert_eq!(folder.names(), ["a.las", "a.points"]);
}

#[test]
fn a_full_disk_is_an_error_that_leaves_nothing() {
    let folder = Folder::new("full");
    let path = folder.path("a.points");
    build_points(&surface(500, 1), &path, &options()).unwrap();
    let old = std::fs::read(&path).unwrap();
    // No file may grow beyond so many blocks of 512 bytes; the signal that goes with it is ignored, so that writing fails.
    for blocks in [0, 100, 2000, 20_000] {
        let run = command(&path, &format!("trap '' XFSZ; ulimit -f {blocks};"))
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        assert_eq!(run.status.code(), Some(7), "{blocks} blocks: {}", String::from_utf8_lossy(&run.stderr));
        assert_eq!(folder.names(), ["a.points"], "{blocks} blocks");
        assert!(std::fs::read(&path).unwrap() == old);
    }
}

#[test]
fn two_builds_of_one_file_do_not_disturb_each_other() {
    let folder = Folder::new("both");
    let path = folder.path("a.points");
    let mut both = [command(&path, "").spawn().unwrap(), command(&path, "").spawn().unwrap()];
    for child in &mut both {
        assert!(child.wait().unwrap().success());
    }
    assert_eq!(Store::open(&path).unwrap().octree().points(), 1_000_000);
    assert_eq!(folder.names(), ["a.points"]);
}
