//! Damaged files: whatever is done to the bytes, an importer answers, soon and in little memory.
#![cfg(all(feature = "obj", feature = "gltf", feature = "ply", feature = "exr"))]

use farsight_geometry::io::exr::FloatImage;
use farsight_geometry::io::{self, Content, ImportError, Loaded};
use std::time::{Duration, Instant};

const MUTATIONS: u64 = 12_000;

/// SplitMix64; independent of the crate's own generator.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Values that break counts, offsets and indices.
const NUMBERS: [&str; 12] = [
    "0",
    "-1",
    "1",
    "255",
    "65536",
    "4294967295",
    "2147483648",
    "1000000000",
    "18446744073709551615",
    "1e300",
    "nan",
    "99999999999999999999",
];

fn mutate(bytes: &mut Vec<u8>, random: &mut Random) {
    // Half of the files have a single wound, so that the damage gets past the first check.
    for _ in 0..(random.below(8).saturating_sub(3)).max(1) {
        let length = bytes.len();
        let (a, b) = (random.below(length), random.below(length));
        let span = a.min(b)..a.max(b).min(a.min(b) + 64);
        match random.below(8) {
            0 => bytes.truncate(a),
            1 | 2 => {
                if let Some(byte) = bytes.get_mut(a) {
                    *byte ^= 1 << random.below(8);
                }
            }
            3 => {
                let copy = bytes[span].to_vec();
                bytes.splice(b..b, copy);
            }
            4 => {
                bytes.drain(span);
            }
            5 => {
                // Whole words of ones, zeros or noise: lengths and counts of binary formats.
                let word = [u64::MAX, 0, random.next(), 0x7fff_ffff, 0x0100_0000_0000][random.below(5)]
                    .to_le_bytes();
                let width = [1, 2, 4, 8][random.below(4)];
                for (to, from) in bytes.iter_mut().skip(a).zip(&word[..width]) {
                    *to = *from;
                }
            }
            _ => edit_number(bytes, a, random),
        }
    }
}

/// Replaces the first number written in digits at or after `from`.
fn edit_number(bytes: &mut Vec<u8>, from: usize, random: &mut Random) {
    let Some(start) = bytes.iter().skip(from).position(u8::is_ascii_digit).map(|i| i + from) else { return };
    let end = bytes[start..].iter().position(|b| !b.is_ascii_digit()).map_or(bytes.len(), |i| i + start);
    bytes.splice(start..end, NUMBERS[random.below(NUMBERS.len())].bytes());
}

/// Most memory that this process has held, in bytes; zero where the system does not tell.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok()).unwrap_or(0) * 1024
}

/// Feeds mutations of `seeds` to `import`, which returns the size of what it made.
fn torture(name: &str, seeds: &[Vec<u8>], import: impl Fn(&[u8]) -> Result<u64, ImportError>) {
    for (i, seed) in seeds.iter().enumerate() {
        import(seed).unwrap_or_else(|error| panic!("{name} {i} is broken before it is mutated: {error}"));
    }
    let (mut accepted, mut largest, mut slowest) = (0, 0, Duration::ZERO);
    for round in 0..MUTATIONS {
        let mut random = Random(round);
        let mut bytes = seeds[round as usize % seeds.len()].clone();
        mutate(&mut bytes, &mut random);
        let start = Instant::now();
        if let Ok(size) = import(&bytes) {
            accepted += 1;
            largest = largest.max(size);
        }
        slowest = slowest.max(start.elapsed());
        assert!(slowest < Duration::from_secs(5), "{name}: mutation {round} took {slowest:?}");
    }
    let peak = peak_memory();
    println!(
        "{name}: {accepted} of {MUTATIONS} accepted, largest {largest} bytes, slowest {slowest:?}, peak {peak}"
    );
    assert!(accepted < MUTATIONS && accepted > 0);
    // All four importers run in this process at once; a believed count of a billion would be far above.
    assert!(peak < 512 << 20, "{name}: {peak} bytes held");
}

fn size_of(loaded: Loaded) -> u64 {
    match loaded.content {
        Content::Scene(scene) => {
            // Whatever was accepted must also be usable.
            assert!(scene.bounds().is_empty() || scene.bounds().min.is_finite());
            scene.bytes()
        }
        Content::Points(points) => points.bytes(),
    }
}

#[test]
fn obj_survives_mutations() {
    let mut plain = String::from("# grid\no grid\n");
    let mut rich = String::from("mtllib a.mtl\n");
    for i in 0..36 {
        let (x, y) = (i % 6, i / 6);
        plain += &format!("v {x}.5 {y} 0.25\n");
        rich += &format!("v {x} {y} 0 1 0.5 0\nvt 0.{x} 0.{y}\nvn 0 0 1\n");
    }
    for i in 0..29 {
        if i % 6 != 5 {
            let [a, b, c, d] = [i + 1, i + 2, i + 8, i + 7];
            plain += &format!("f {a} {b} {c} {d}\n");
            rich += &format!(
                "g part{}\nusemtl m{}\nf {a}/{a}/1 {b}/{b}/2 {c}//1\nf -1 -2/-3 {d}\n",
                i / 6,
                i % 2
            );
        }
    }
    let library = b"newmtl m0\nKd 1 0.5 0\nmap_Kd a.png\nnewmtl m1\nd 0.5\n".to_vec();
    let shallow = [plain.into_bytes(), rich.clone().into_bytes()];
    torture("obj", &shallow, |bytes| io::obj::read(bytes, &|_| Ok(library.clone())).map(size_of));
    torture("mtl", &[library], |bytes| {
        io::obj::read(rich.as_bytes(), &|_| Ok(bytes.to_vec())).map(size_of).and_then(|size| {
            // A material library is never a reason to refuse; count those that lost their colour as refused.
            if bytes.len() % 2 == 0 { Ok(size) } else { Err(ImportError::NotAFile) }
        })
    });
}

#[test]
fn ply_survives_mutations() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment origin 1 2 3\nelement vertex 8\nproperty float x\nproperty float y\n\
             property double z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n\
             property uchar blue\nelement face 4\nproperty list uchar int vertex_indices\nelement tristrips 1\n\
             property list int int vertex_indices\nend_header\n"
        )
    };
    let mut ascii = header("ascii");
    let (mut little, mut big) =
        (header("binary_little_endian").into_bytes(), header("binary_big_endian").into_bytes());
    for i in 0..8u8 {
        let (x, y, z) = (f32::from(i % 2), f32::from(i / 2), f64::from(i));
        ascii += &format!("{x} {y} {z} 0 0 1 {i} {i} {i}\n");
        for v in [x, y] {
            little.extend(v.to_le_bytes());
            big.extend(v.to_be_bytes());
        }
        little.extend(z.to_le_bytes());
        big.extend(z.to_be_bytes());
        for v in [0.0f32, 0.0, 1.0] {
            little.extend(v.to_le_bytes());
            big.extend(v.to_be_bytes());
        }
        little.extend([i; 3]);
        big.extend([i; 3]);
    }
    let lists: [&[i32]; 5] =
        [&[0, 1, 2], &[1, 3, 2], &[2, 3, 5, 4], &[4, 5, 7, 6, 0], &[0, 1, 2, 3, -1, 4, 5, 6, 7]];
    for (i, list) in lists.into_iter().enumerate() {
        ascii += &list.len().to_string();
        if i < 4 {
            little.push(list.len() as u8);
            big.push(list.len() as u8);
        } else {
            little.extend((list.len() as i32).to_le_bytes());
            big.extend((list.len() as i32).to_be_bytes());
        }
        for v in list {
            ascii += &format!(" {v}");
            little.extend(v.to_le_bytes());
            big.extend(v.to_be_bytes());
        }
        ascii += "\n";
    }
    torture("ply", &[ascii.into_bytes(), little, big], |bytes| io::ply::from_bytes(bytes).map(size_of));
}

/// A grey JPEG of 16 x 16 in four blocks: a table of twelve 4-bit codes for the means and one 1-bit code that ends a block.
fn jpeg() -> Vec<u8> {
    let mut bytes = vec![0xff, 0xd8, 0xff, 0xdb, 0, 67, 0];
    bytes.extend([1; 64]);
    bytes.extend([0xff, 0xc0, 0, 11, 8, 0, 16, 0, 16, 1, 1, 0x11, 0]);
    bytes.extend([0xff, 0xc4, 0, 31, 0x00, 0, 0, 0, 12, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend(0..12);
    bytes.extend([0xff, 0xc4, 0, 20, 0x10, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend([0xff, 0xda, 0, 8, 1, 1, 0x00, 0, 63, 0, 0x00, 0x00, 0x0f, 0xff, 0xd9]);
    bytes
}

fn png_picture() -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 4, 4);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(&[200; 64]).unwrap();
    bytes
}

/// A GLB with everything that is read: textures, sparse and strided accessors, a small node tree, a light and a camera.
fn gltf_parts(picture: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let mut bin: Vec<u8> = Vec::new();
    for i in 0..8u8 {
        [f32::from(i % 2), f32::from(i / 2), 0.5].iter().for_each(|v| bin.extend(v.to_le_bytes()));
    }
    bin.extend([0u8, 1, 2, 2, 1, 3, 3, 4, 5, 5, 6, 7]); // 96: indices
    (0..8u8).for_each(|i| bin.extend([i, 255 - i, 0, 0])); // 108: uvs, stride 4
    (0..8u8).for_each(|i| bin.extend([i, i, i, 255])); // 140: colours
    bin.extend([3, 0, 5, 0]); // 172: sparse places
    [9.0f32, 9.0, 9.0, 8.0, 8.0, 8.0].iter().for_each(|v| bin.extend(v.to_le_bytes())); // 176
    let at = bin.len();
    bin.extend(picture);
    bin.resize(bin.len().next_multiple_of(4), 0);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1]}}],"buffers":[{{"byteLength":{}}}],
"bufferViews":[{{"buffer":0,"byteLength":96}},{{"buffer":0,"byteOffset":96,"byteLength":12}},
{{"buffer":0,"byteOffset":108,"byteLength":32,"byteStride":4}},{{"buffer":0,"byteOffset":140,"byteLength":32}},
{{"buffer":0,"byteOffset":172,"byteLength":4}},{{"buffer":0,"byteOffset":176,"byteLength":24}},{{"buffer":0,"byteOffset":{at},"byteLength":{}}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","sparse":{{"count":2,"indices":{{"bufferView":4,"componentType":5123}},"values":{{"bufferView":5}}}}}},
{{"bufferView":1,"componentType":5121,"count":12,"type":"SCALAR"}},{{"bufferView":2,"componentType":5121,"normalized":true,"count":8,"type":"VEC2"}},
{{"bufferView":3,"componentType":5121,"normalized":true,"count":8,"type":"VEC4"}}],
"images":[{{"bufferView":6,"mimeType":"image/png"}}],"textures":[{{"source":0}}],
"materials":[{{"alphaMode":"MASK","pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":2,"COLOR_0":3}},"indices":1,"material":0}},{{"attributes":{{"POSITION":0}},"indices":1,"mode":5}}]}}],
"cameras":[{{"type":"perspective","perspective":{{"yfov":1,"znear":0.1}}}}],
"extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"spot","spot":{{}}}}]}}}},
"nodes":[{{"mesh":0,"children":[2],"rotation":[0,0,0,1]}},{{"camera":0}},{{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,3,4,5,1],"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}]}}"#,
        bin.len(),
        picture.len()
    );
    (json.into_bytes(), bin)
}

fn wrap(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", bin)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

fn glb(picture: &[u8]) -> Vec<u8> {
    let (json, bin) = gltf_parts(picture);
    wrap(&json, &bin)
}

#[test]
fn gltf_survives_mutations() {
    for picture in [png_picture(), jpeg()] {
        let loaded = io::gltf::from_bytes(&glb(&picture)).unwrap();
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    }
    let seeds = [glb(&png_picture()), glb(&jpeg())];
    torture("glb", &seeds, |bytes| io::gltf::from_bytes(bytes).map(size_of));
    // The container stays whole around a damaged text, and around damaged numbers.
    let (json, bin) = gltf_parts(&png_picture());
    torture("json", std::slice::from_ref(&json), |json| io::gltf::from_bytes(&wrap(json, &bin)).map(size_of));
    let numbers = std::slice::from_ref(&bin);
    torture("bin", numbers, |bin| io::gltf::from_bytes(&wrap(&json, bin)).map(size_of));
}

#[test]
fn pictures_survive_mutations() {
    // Through a glTF whose picture lies beside it, so that every mutation hits the picture.
    let json = br#"{"asset":{"version":"2.0"},"images":[{"uri":"a"}],"textures":[{"source":0}],
        "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}]}"#;
    torture("picture", &[png_picture(), jpeg()], |bytes| {
        let scene = io::gltf::read(json, &|_| Ok(bytes.to_vec()))?.into_scene().unwrap();
        if scene.textures().is_empty() { Err(ImportError::NotAFile) } else { Ok(scene.bytes()) }
    });
}

#[test]
fn exr_survives_mutations() {
    let ramp: Vec<f32> = (0..24 * 20).map(|i| i as f32 * 0.25).collect();
    let pixels: Vec<[f32; 4]> = (0..64).map(|i| [i as f32, 0.5, 0.25, 1.0]).collect();
    let depth = FloatImage::depth(24, 20, ramp).unwrap().to_bytes().unwrap();
    let colour = FloatImage::rgba(8, 8, &pixels).unwrap().to_bytes().unwrap();
    torture("exr", &[depth, colour], |bytes| {
        let image = FloatImage::from_bytes(bytes)?;
        Ok(4 * (image.width() * image.height() * image.channel_names().count()) as u64)
    });
}
