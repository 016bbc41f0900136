//! Loading against the parser alone: time and peak memory on generated files of about 100 MB.
//!
//! Run with `cargo bench --bench io` (`-- --quick` for 10 MB). Each load runs in a process of its own, so that peaks do
//! not mix; the least of three CPU times counts. "Parser alone" is what a program gets from `tobj`, or from `gltf` with
//! its own readers, into plain vectors.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    if let [_, job, path, ..] = &args[..]
        && job.starts_with("load-")
    {
        return child(job, Path::new(path));
    }
    let side = if args.iter().any(|a| a == "--quick") { 400 } else { 1250 };
    let folder = std::env::temp_dir().join(format!("farsight-bench-io-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    println!(
        "file              MB   parser s   ours s   time ratio   scene MB   peak MB   parser peak   peak / scene"
    );
    // A grid with as many vertices as the square of `side`, in parts of 50 rows.
    for (name, job, write) in [
        ("plain.obj", "obj", write_obj as fn(&Path, usize, bool)),
        ("attributes.obj", "obj", write_obj),
        ("plain.glb", "glb", write_glb),
        ("attributes.glb", "glb", write_glb),
    ] {
        let path = folder.join(name);
        let attributes = name.starts_with('a');
        let scale = if job == "glb" {
            if attributes { 1.06 } else { 1.33 }
        } else if attributes {
            0.57
        } else {
            0.91
        };
        write(&path, (side as f64 * scale) as usize, attributes);
        let megabytes = std::fs::metadata(&path).map_or(0, |m| m.len()) as f64 / 1e6;
        let parser = best(&path, &format!("load-parser-{job}"));
        let ours = best(&path, &format!("load-ours-{job}"));
        println!(
            "{name:15} {megabytes:6.1} {:9.3} {:9.3} {:11.2}x {:10.1} {:9.1} {:12.1} {:13.2}x",
            parser.seconds,
            ours.seconds,
            ours.seconds / parser.seconds,
            ours.scene / 1e6,
            ours.peak / 1e6,
            parser.peak / 1e6,
            ours.peak / ours.scene
        );
        std::fs::remove_file(&path).expect("the file to be there");
    }
    let _ = std::fs::remove_dir(&folder);
}

struct Figures {
    seconds: f64,
    peak: f64,
    scene: f64,
}

/// Best of three runs in processes of their own.
fn best(path: &Path, job: &str) -> Figures {
    let run = || {
        let program: PathBuf = std::env::current_exe().expect("this program's path");
        let output = Command::new(program).arg(job).arg(path).output().expect("a child process");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let numbers: Vec<f64> = text.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        assert!(numbers.len() == 3, "{job}: {text}{}", String::from_utf8_lossy(&output.stderr));
        Figures { seconds: numbers[0], peak: numbers[1], scene: numbers[2] }
    };
    (0..3).map(|_| run()).min_by(|a, b| a.seconds.total_cmp(&b.seconds)).expect("three runs")
}

/// Loads once and prints seconds, peak bytes and scene bytes.
fn child(job: &str, path: &Path) {
    // The peak so far is that of starting up.
    let before = peak();
    let start = Instant::now();
    let scene = match job {
        "load-parser-obj" => parser_obj(path),
        "load-parser-glb" => parser_glb(path),
        _ => farsight_geometry::io::load(path).expect("a good file").into_scene().expect("a scene").bytes(),
    };
    let seconds = start.elapsed().as_secs_f64();
    println!("{seconds} {} {scene}", peak().saturating_sub(before));
}

fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok()).unwrap_or(0) * 1024
}

fn parser_obj(path: &Path) -> u64 {
    let (models, _) = tobj::load_obj(path, &tobj::GPU_LOAD_OPTIONS).expect("a good file");
    let floats = |m: &tobj::Mesh| m.positions.len() + m.normals.len() + m.texcoords.len() + m.indices.len();
    models.iter().map(|m| 4 * floats(&m.mesh) as u64).sum()
}

fn parser_glb(path: &Path) -> u64 {
    let bytes = std::fs::read(path).expect("the file");
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(&bytes).expect("a good file");
    let blob = blob.expect("a binary chunk");
    let mut kept = (vec![], vec![], vec![], vec![]);
    for primitive in document.meshes().flat_map(|m| m.primitives().collect::<Vec<_>>()) {
        let reader = primitive.reader(|_| Some(&blob));
        kept.0.push(reader.read_positions().expect("positions").collect::<Vec<_>>());
        kept.1.push(reader.read_indices().expect("indices").into_u32().collect::<Vec<_>>());
        kept.2.extend(reader.read_normals().map(|n| n.collect::<Vec<_>>()));
        kept.3.extend(reader.read_tex_coords(0).map(|uv| uv.into_f32().collect::<Vec<_>>()));
    }
    let sum = |bytes: &mut dyn Iterator<Item = usize>| bytes.sum::<usize>() as u64;
    sum(&mut kept.0.iter().map(|v| v.len() * 12))
        + sum(&mut kept.1.iter().map(|v| v.len() * 4))
        + sum(&mut kept.2.iter().map(|v| v.len() * 12))
        + sum(&mut kept.3.iter().map(|v| v.len() * 8))
}

fn height(x: usize, y: usize) -> f32 {
    (x as f32 * 0.37).sin() * (y as f32 * 0.11).cos() * 20.0
}

/// Rows in one part of the file.
const ROWS: usize = 50;

fn write_obj(path: &Path, side: usize, attributes: bool) {
    let mut text = String::new();
    for y in 0..side {
        if y % ROWS == 0 {
            let _ = writeln!(text, "o part{}", y / ROWS);
        }
        for x in 0..side {
            let _ = writeln!(text, "v {:.4} {:.4} {:.6}", x as f32 * 0.31, y as f32 * 0.29, height(x, y));
            if attributes {
                let _ = writeln!(text, "vt {:.5} {:.5}", x as f32 / side as f32, y as f32 / side as f32);
                let _ = writeln!(text, "vn 0.0123 {:.4} 0.9987", height(y, x) * 0.01);
            }
        }
        for x in 1..if y == 0 { 0 } else { side } {
            let (a, b) = ((y - 1) * side + x, y * side + x);
            let [a, b, c, d] = [a, a + 1, b + 1, b];
            let _ = if attributes {
                writeln!(text, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}\nf {a}/{a}/{a} {c}/{c}/{c} {d}/{d}/{d}")
            } else {
                writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}")
            };
        }
    }
    std::fs::write(path, text).expect("room in the temporary folder");
}

fn write_glb(path: &Path, side: usize, attributes: bool) {
    let mut bin: Vec<u8> = Vec::new();
    let (mut views, mut accessors, mut primitives) = (String::new(), String::new(), String::new());
    let mut accessor = |bin: &mut Vec<u8>, data: &[u8], kind: &str, component: u32, width: usize| -> usize {
        let number = accessors.matches("count").count();
        let comma = if number == 0 { "" } else { "," };
        let _ =
            write!(views, r#"{comma}{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, bin.len(), data.len());
        let limits = if kind == "VEC3" { r#","min":[0,0,0],"max":[1,1,1]"# } else { "" };
        let _ = write!(
            accessors,
            r#"{comma}{{"bufferView":{number},"componentType":{component},"count":{},"type":"{kind}"{limits}}}"#,
            data.len() / width
        );
        bin.extend_from_slice(data);
        number
    };
    let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    for (part, first) in (0..side - 1).step_by(ROWS).enumerate() {
        let rows = ROWS.min(side - 1 - first) + 1;
        let grid: Vec<(usize, usize)> = (0..rows * side).map(|i| (i % side, first + i / side)).collect();
        let points: Vec<f32> = grid.iter().flat_map(|&(x, y)| [x as f32, y as f32, height(x, y)]).collect();
        let quad = |i: usize| {
            let a = (i / (side - 1) * side + i % (side - 1)) as u32;
            let (b, c, d) = (a + 1, a + side as u32 + 1, a + side as u32);
            [a, b, c, a, c, d]
        };
        let indices: Vec<u8> =
            (0..(rows - 1) * (side - 1)).flat_map(quad).flat_map(u32::to_le_bytes).collect();
        let position = accessor(&mut bin, &bytes(&points), "VEC3", 5126, 12);
        let index = accessor(&mut bin, &indices, "SCALAR", 5125, 4);
        let mut extra = String::new();
        if attributes {
            let normal = accessor(&mut bin, &bytes(&points), "VEC3", 5126, 12);
            let uvs: Vec<f32> = grid.iter().flat_map(|&(x, y)| [x as f32, y as f32]).collect();
            let uv = accessor(&mut bin, &bytes(&uvs), "VEC2", 5126, 8);
            extra = format!(r#","NORMAL":{normal},"TEXCOORD_0":{uv}"#);
        }
        let comma = if part == 0 { "" } else { "," };
        let _ = write!(
            primitives,
            r#"{comma}{{"attributes":{{"POSITION":{position}{extra}}},"indices":{index}}}"#
        );
    }
    let mut json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],"buffers":[{{"byteLength":{}}}],"bufferViews":[{views}],"accessors":[{accessors}],"meshes":[{{"primitives":[{primitives}]}}]}}"#,
        bin.len()
    );
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", &bin[..])] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    std::fs::write(path, file).expect("room in the temporary folder");
}
