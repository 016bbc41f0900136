//! Real files against the counts that their collection publishes. Skipped, with a note, where the collection is missing.
#![cfg(all(feature = "obj", feature = "gltf", feature = "ply"))]

use farsight_geometry::glam::Vec3;
use farsight_geometry::{MeshReport, TriangleMesh, io};
use std::path::PathBuf;

fn folder() -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let path = PathBuf::from(std::env::var("FARSIGHT_DATA").unwrap_or(beside.into()));
    if path.join("README.md").is_file() {
        return Some(path);
    }
    println!("skipped: no model files at {} (set FARSIGHT_DATA)", path.display());
    None
}

/// The number before `what` in a list such as "223 border, 1 slivers".
fn count_of(defects: &str, what: &str) -> usize {
    let entry = defects.split(", ").find(|entry| entry.ends_with(what));
    entry.map_or(0, |e| number(e.trim_end_matches(what)))
}

fn number(text: &str) -> usize {
    let digits: String = text.chars().take_while(|c| *c != '(').filter(char::is_ascii_digit).collect();
    digits.parse().unwrap()
}

/// Columns of every row of the collection's tables whose file has one of the endings.
fn rows(endings: &[&str]) -> Vec<Vec<String>> {
    let Some(folder) = folder() else { return vec![] };
    let text = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let cells =
        |line: &str| line.split('|').map(|c| c.trim().trim_matches('`').to_owned()).collect::<Vec<_>>();
    let rows: Vec<_> = text.lines().map(cells).collect();
    rows.into_iter()
        .filter(|row| row.len() > 6 && endings.iter().any(|e| row[1].ends_with(e)))
        .map(|mut row| {
            row[0] = folder.join(&row[1]).to_string_lossy().into_owned();
            row
        })
        .collect()
}

/// Triangles whose height is below `limit` of their longest side.
fn thinner_than(mesh: &TriangleMesh, limit: f64) -> usize {
    let thin = |[a, b, c]: [Vec3; 3]| {
        let sides = [b - a, c - b, a - c].map(|s| s.as_dvec3());
        let longest = sides.into_iter().max_by(|s, t| s.length().total_cmp(&t.length())).unwrap();
        let height = (sides[0].cross(sides[1]).length() / longest.length()).max(0.0);
        longest.length() == 0.0 || height < limit * longest.length()
    };
    mesh.corner_iter().filter(|corners| thin(*corners)).count()
}

#[test]
fn meshes_have_their_published_counts() {
    let rows = rows(&[".obj", ".glb"]);
    let mut wrong = Vec::new();
    for row in &rows {
        let (path, file, defects) = (&row[0], &row[1], &row[7]);
        let loaded = io::load(path).unwrap();
        let stored = loaded.stored_vertices as usize;
        let warnings = loaded.warnings.clone();
        let scene = loaded.into_scene().unwrap();
        // The published defects of an instanced file are those of its stored meshes.
        let instanced = row[3].contains("instanced");
        let report = if instanced {
            assert_eq!(number(row[3].split('(').nth(1).unwrap()) as u64, scene.placed_triangles());
            scene.meshes().iter().map(|m| m.report()).fold(MeshReport::default(), MeshReport::plus)
        } else {
            scene.flattened().unwrap().report()
        };
        let pieces =
            if defects.contains("pieces") { count_of(defects, " pieces") } else { report.components };
        // Vertices that our mesh has more than the file were split where normals or texture coordinates differ.
        let repeated = stored - (report.vertices - report.repeated_vertices);
        for (what, ours, published) in [
            ("triangles", report.triangles, number(&row[3])),
            ("vertices", stored, number(&row[4])),
            ("border", report.border_edges, count_of(defects, " border")),
            ("non-manifold", report.non_manifold_edges, count_of(defects, " non-manifold")),
            ("doubled", report.doubled, count_of(defects, " doubled triangles")),
            ("repeated", repeated, count_of(defects, " repeated vertices")),
            ("unreferenced", report.unreferenced, count_of(defects, " unreferenced")),
            ("pieces", report.components, pieces),
        ] {
            // Nodes of this file turn their meshes: which corners then coincide is a matter of rounding. (Its
            // description itself gives two numbers of zero-area triangles.)
            let slack = if file == "jungle.glb" { 3 } else { 0 };
            if ours.abs_diff(published) > slack {
                wrong.push(format!("{file}: {what} {ours}, published {published}"));
            }
        }
        // Many triangles of the game levels are as thin as the limit exactly; rounding decides on which side they are.
        let flat = if instanced { None } else { Some(scene.flattened().unwrap()) };
        for (what, limit, ours) in
            [(" zero-area", 1e-7, report.zero_area), (" slivers", 1e-2, report.slivers)]
        {
            let published = count_of(defects, what);
            let at = |limit: f64| flat.as_ref().map_or(ours, |mesh| thinner_than(mesh, limit));
            let slack = if file == "jungle.glb" { 3 } else { 0 };
            let range = at(limit * (1.0 - 1e-4)).saturating_sub(slack)..=at(limit * (1.0 + 1e-4)) + slack;
            if !range.contains(&published) || !range.contains(&ours) {
                wrong.push(format!("{file}:{what} {ours}, {range:?} near the limit, published {published}"));
            }
        }
        println!("{file}: {report}; {} instances; {warnings:?}", scene.instances().len());
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
    println!("{} files checked", rows.len());
}

#[test]
fn point_clouds_have_their_published_counts() {
    for row in rows(&[".ply"]) {
        let cloud = io::load(&row[0]).unwrap().into_points().unwrap();
        assert_eq!(cloud.len(), number(&row[3]), "{}", row[1]);
        assert_eq!(cloud.colours().is_some(), row[4] == "yes", "{}", row[1]);
        let diagonal: f64 = row[6].parse().unwrap();
        assert!((cloud.world_bounds().diagonal() / diagonal - 1.0).abs() < 1e-3, "{}", row[1]);
        let far = row[1].contains("lone_star");
        assert_eq!(cloud.origin().y > 4e6, far, "{}: {}", row[1], cloud.origin());
    }
}
