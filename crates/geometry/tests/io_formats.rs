//! Small files written by hand: what each importer must understand and what it must refuse.
#![cfg(all(feature = "obj", feature = "gltf", feature = "ply"))]

use farsight_geometry::glam::{DVec3, Vec2, Vec3};
use farsight_geometry::io::{self, Content, ImportError, Loaded};
use farsight_geometry::scene::{AlphaMode, Light};
use farsight_geometry::{Scene, TriangleMesh};

fn scene(loaded: Loaded) -> Scene {
    loaded.into_scene().unwrap()
}

fn only_mesh(loaded: Loaded) -> TriangleMesh {
    let scene = scene(loaded);
    assert_eq!(scene.meshes().len(), 1);
    scene.meshes()[0].clone()
}

fn obj(text: &str) -> Result<Loaded, ImportError> {
    io::obj::from_bytes(text.as_bytes())
}

#[test]
fn obj_faces_of_all_kinds() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\n# quad, polygon, relative, continued\n\
                f 1 2 3 4\nf 1 2 3 4 5\nf -5 -4 -3\nf 1 \\\n 2 3\r\nf 1 2\nl 1 2\n";
    let loaded = obj(text).unwrap();
    assert_eq!(loaded.warnings.len(), 2, "{:?}", loaded.warnings);
    let mesh = only_mesh(loaded);
    let fan = [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 1, 2], [0, 1, 2]];
    assert_eq!(mesh.triangles(), fan);
    assert_eq!((mesh.positions().len(), mesh.uvs(), mesh.normals()), (5, None, None));
}

#[test]
fn obj_corners_that_disagree_split_a_vertex() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0.25 1\nvn 0 0 1\nvn 0 0 -1\n\
                f 1/1/1 2/2/1 3/3/1\nf 1/1/2 3/3/2 2/2/2\nf 1/3/1 2/2/1 3\n";
    let loaded = obj(text).unwrap();
    assert_eq!(loaded.stored_vertices, 3);
    let mesh = only_mesh(loaded);
    assert_eq!(mesh.triangles(), [[0, 1, 2], [3, 4, 5], [6, 1, 7]]);
    let (uvs, normals) = (mesh.uvs().unwrap(), mesh.normals().unwrap());
    // v is turned to point down; a corner without attributes has zeros.
    assert_eq!(
        (uvs[0], uvs[2], uvs[6], uvs[7]),
        (Vec2::Y, Vec2::new(0.25, 0.0), Vec2::new(0.25, 0.0), Vec2::ZERO)
    );
    assert_eq!((normals[0], normals[5], normals[7]), (Vec3::Z, Vec3::NEG_Z, Vec3::ZERO));
    assert_eq!(mesh.positions()[7], Vec3::Y);
}

#[test]
fn obj_groups_and_materials_become_parts() {
    let text = "mtllib a.mtl\nmtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 7 7 7\no house\nusemtl red\nf 1 2 3\nusemtl blue\nf 1 2 4\n\
                usemtl red\nf 2 3 4\ng roof\nf 1 3 4\n";
    let library = b"newmtl red\nKd 1 0 0\nKd 1\nnewmtl blue\nKd 0 0 1\nd 0.5\nmap_Kd -s 1 1 1 sky.png\n";
    let loaded = io::obj::read(text.as_bytes(), &|name| match name {
        "a.mtl" => Ok(library.to_vec()),
        _ => Err(ImportError::NotAFile),
    })
    .unwrap();
    assert_eq!(loaded.warnings.len(), 3, "{:?}", loaded.warnings);
    let scene = scene(loaded);
    let parts: Vec<_> = scene
        .instances()
        .iter()
        .map(|i| {
            let material = &scene.materials()[i.material.unwrap().0 as usize];
            (i.name.as_str(), material.name.as_str(), scene.mesh_of(i).triangles().len())
        })
        .collect();
    assert_eq!(parts, [("house", "red", 2), ("house", "blue", 1), ("roof", "red", 1)]);
    let red_house = &scene.meshes()[0];
    assert_eq!((red_house.positions().len(), red_house.corners(1)), (4, [Vec3::X, Vec3::Y, Vec3::Z]));
    assert_eq!(scene.materials()[1].base_colour, [0.0, 0.0, 1.0, 0.5]);
    assert_eq!(scene.materials()[1].alpha, AlphaMode::Blend);
}

#[test]
fn obj_far_coordinates_colours_and_points() {
    let text = "v 480000.001 5400000.002 120.003 1 0 0.5\nv 480001 5400000 120 0 0 0\nv 480000 5400001 120\nf 1 2 3\n";
    let mesh = only_mesh(obj(text).unwrap());
    let world = mesh.origin() + mesh.positions()[0].as_dvec3();
    assert!(world.distance(DVec3::new(480_000.001, 5_400_000.002, 120.003)) < 1e-6);
    assert_eq!(mesh.colours().unwrap(), [[255, 0, 128, 255], [0, 0, 0, 255], [255; 4]]);
    let cloud = obj("v 1 2 3\nv 4 5 6\n").unwrap().into_points().unwrap();
    assert_eq!(cloud.positions(), [Vec3::new(1., 2., 3.), Vec3::new(4., 5., 6.)]);
    assert!(scene(obj("").unwrap()).instances().is_empty());
}

#[test]
fn obj_errors_name_the_line() {
    for (text, message) in [
        ("v 0 0\n", "line 1: a number is missing"),
        ("\nv 0 x 0\n", "line 2: 'x' is not a finite number"),
        ("v 0 inf 0\n", "line 1: 'inf' is not a finite number"),
        ("v 0 0 0\nf 1 1 2\n", "line 2: vertex index 2, but there are 1"),
        ("v 0 0 0\nf 1 1 -2\n", "line 2: vertex index -2 leads nowhere"),
        ("v 0 0 0\nf 1 1 0\n", "line 2: vertex index 0; indices begin at 1"),
        ("v 0 0 0\nf 1 1 99999999999999\n", "line 2: '99999999999999' is not an index"),
        ("v 0 0 0\nf 1/1 1/1 1/4294967295\n", "line 2: texture coordinate index 4294967295, but there are 0"),
        ("v 0 0 0\nf 1 1 4294967296\n", "line 2: vertex index 4294967296 leads nowhere"),
        ("v 0 0 2e18\nf 1 1 1\n", "mesh ''"),
    ] {
        let error = obj(text).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
}

#[test]
fn ply_in_three_encodings() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment origin 100 0 -5\nelement vertex 4\nproperty float x\nproperty float y\n\
             property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement extra 1\n\
             property list uchar int things\nelement face 2\nproperty uchar flags\n\
             property list uchar int vertex_indices\nend_header\n"
        )
    };
    let ascii = header("ascii")
        + "0 0 0 1 2 3\n1 0 0 4 5 6\n1 1 0 7 8 9\n0 1 0 10 11 12\n2 5 6\n9 4 0 1 2 3\n9 3 0 1 2\n";
    let mesh = only_mesh(io::ply::from_bytes(ascii.as_bytes()).unwrap());
    assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    assert_eq!((mesh.origin(), mesh.colours().unwrap()[3]), (DVec3::new(100., 0., -5.), [10, 11, 12, 255]));
    for big in [false, true] {
        let again = only_mesh(io::ply::from_bytes(&binary_ply(&header, big)).unwrap());
        assert_eq!(again, mesh);
    }
}

/// The square of `ply_in_three_encodings` in binary.
fn binary_ply(header: &dyn Fn(&str) -> String, big: bool) -> Vec<u8> {
    let mut bytes = header(if big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
    let ordered = |mut raw: [u8; 4]| {
        if big {
            raw.reverse();
        }
        raw
    };
    for (i, [x, y]) in [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].into_iter().enumerate() {
        [x, y, 0.0].iter().for_each(|v| bytes.extend(ordered(v.to_le_bytes())));
        bytes.extend([1, 2, 3].map(|c| 3 * i as u8 + c));
    }
    let list = |bytes: &mut Vec<u8>, values: &[i32]| {
        bytes.push(values.len() as u8);
        values.iter().for_each(|v| bytes.extend(ordered(v.to_le_bytes())));
    };
    list(&mut bytes, &[5, 6]);
    for face in [&[0, 1, 2, 3][..], &[0, 1, 2]] {
        bytes.push(9);
        list(&mut bytes, face);
    }
    bytes
}

#[test]
fn ply_points_strips_and_doubles() {
    let points = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\nend_header\n\
                  480000.001 5400000.002 1\n480001 5400000 2";
    let cloud = io::ply::from_bytes(points.as_bytes()).unwrap().into_points().unwrap();
    let world = cloud.origin() + cloud.positions()[0].as_dvec3();
    assert!(world.distance(DVec3::new(480_000.001, 5_400_000.002, 1.0)) < 1e-6);
    let strips = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
                  0 0 0 1 0 0 0 1 0 1 1 0\n8 0 1 2 3 -1 0 1 2\n";
    let mesh = only_mesh(io::ply::from_bytes(strips.as_bytes()).unwrap());
    assert_eq!(mesh.triangles(), [[0, 1, 2], [2, 1, 3], [0, 1, 2]]);
}

#[test]
fn ply_counts_are_checked_before_anything_is_allocated() {
    let header = |format: &str, vertices: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0"
        )
    };
    for text in [
        header("ascii", "99999999999"),
        header("binary_little_endian", "18446744073709551615"),
        header("binary_big_endian", "-1"),
        header("ascii", "2"),
        header("utf8", "1"),
        header("ascii", "1").replace("ply", "plx"),
        header("ascii", "1").replace("end_header", "end"),
        header("ascii", "1").replace("property float z\n", ""),
        header("ascii", "1").replace("0 0 0", "0 0 nan"),
    ] {
        assert!(io::ply::from_bytes(text.as_bytes()).is_err(), "{text}");
    }
    assert!(io::ply::from_bytes(header("ascii", "1").as_bytes()).is_ok());
}

/// A .gltf with the given buffer (as a data URI) and the rest of the JSON.
fn gltf(buffer: &[u8], rest: &str) -> Result<Loaded, ImportError> {
    let letters = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in buffer.chunks(3) {
        let mut raw = [0; 3];
        raw[..group.len()].copy_from_slice(group);
        let word = u32::from_be_bytes([0, raw[0], raw[1], raw[2]]);
        for i in 0..4 {
            let letter = letters[(word >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= group.len() { letter as char } else { '=' });
        }
    }
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{},"uri":"data:application/octet-stream;base64,{text}"}}],{rest}}}"#,
        buffer.len()
    );
    io::gltf::from_bytes(json.as_bytes())
}

/// Three floats per corner of a square, then the indices 0 1 2 3 as bytes.
fn square() -> Vec<u8> {
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let mut bytes: Vec<u8> = corners.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0, 1, 2, 3]);
    bytes
}

const SQUARE: &str = r#""bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":4}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"},
                 {"bufferView":1,"componentType":5121,"count":4,"type":"SCALAR"}],"#;

#[test]
fn gltf_strips_fans_and_instances() {
    let rest = SQUARE.to_owned()
        + r#""meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":5},
                                      {"attributes":{"POSITION":0},"mode":6},
                                      {"attributes":{"POSITION":0},"mode":1}]}],
             "nodes":[{"children":[1,2],"translation":[100000000,0,0]},{"mesh":0,"translation":[0.25,0,0]},
                      {"mesh":0,"scale":[-1,1,1],"name":"mirror"}],
             "scenes":[{"nodes":[0]}]"#;
    let loaded = gltf(&square(), &rest).unwrap();
    assert_eq!(loaded.warnings.len(), 1);
    let scene = scene(loaded);
    assert_eq!((scene.meshes().len(), scene.instances().len()), (2, 4));
    assert_eq!(scene.meshes()[0].triangles(), [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(scene.meshes()[1].triangles(), [[0, 1, 2], [0, 2, 3]]);
    // The sum is exact in f64; f32 would lose the quarter.
    assert_eq!(scene.instances()[0].world_from_mesh.translation.x, 100_000_000.25);
    assert_eq!(scene.instances()[2].name, "mirror");
    assert_eq!(scene.bounds().min.x, 99_999_999.0);
}

#[test]
fn gltf_quantised_and_sparse_accessors() {
    // Positions as i16 with a stride of 8, uvs as normalised u8, then a sparse replacement of vertex 2.
    let mut bytes = vec![];
    for [x, y, z] in [[0i16, 0, 0], [1000, 0, 0], [0, 1000, 0]] {
        [x, y, z, 77].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    bytes.extend([0, 0, 255, 0, 51, 255, 0, 0]);
    bytes.extend([2, 0, 0, 0]);
    [0i16, -3, 5].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    let rest = r#""extensionsRequired":["KHR_mesh_quantization"],
        "bufferViews":[{"buffer":0,"byteLength":24,"byteStride":8},{"buffer":0,"byteOffset":24,"byteLength":8},
                       {"buffer":0,"byteOffset":32,"byteLength":4},{"buffer":0,"byteOffset":36,"byteLength":6}],
        "accessors":[{"bufferView":0,"componentType":5122,"count":3,"type":"VEC3",
                      "sparse":{"count":1,"indices":{"bufferView":2,"componentType":5121},"values":{"bufferView":3}}},
                     {"bufferView":1,"componentType":5121,"normalized":true,"count":3,"type":"VEC2"}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1}}]}]"#;
    let mesh = only_mesh(gltf(&bytes, rest).unwrap());
    assert_eq!(mesh.positions(), [Vec3::ZERO, Vec3::X * 1000.0, Vec3::new(0.0, -3.0, 5.0)]);
    assert_eq!(mesh.uvs().unwrap(), [Vec2::ZERO, Vec2::X, Vec2::new(0.2, 1.0)]);
}

#[test]
fn gltf_shared_vertex_lists_are_cut_to_what_is_used() {
    let rest = SQUARE.to_owned()
        + r#""accessors2":[],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":6},
                                                   {"attributes":{"POSITION":0},"indices":1,"mode":5}]}]"#;
    let fan = [0u8, 3, 2];
    let mut bytes = square();
    bytes[48..51].copy_from_slice(&fan);
    let rest = rest.replace(r#""componentType":5121,"count":4"#, r#""componentType":5121,"count":3"#);
    let scene = scene(gltf(&bytes, &rest).unwrap());
    for mesh in scene.meshes() {
        assert_eq!(mesh.positions(), [Vec3::ZERO, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)]);
        assert_eq!(mesh.triangles(), [[0, 2, 1]]);
    }
}

#[test]
fn gltf_materials_cameras_and_lights() {
    let mut png_bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut png_bytes, 2, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&[255, 0, 0, 0, 0, 255]).unwrap();
    let mut bytes = square();
    let start = bytes.len();
    bytes.extend(&png_bytes);
    let views =
        format!(r#""bufferViews":[{{"buffer":0,"byteOffset":{start},"byteLength":{}}},"#, png_bytes.len());
    // The picture's view comes first, the square's two after it.
    let rest = SQUARE
        .replace(r#""bufferViews":["#, &views)
        .replace(r#""bufferView":1"#, r#""bufferView":2"#)
        .replace(r#""bufferView":0,"componentType""#, r#""bufferView":1,"componentType""#)
        + r#""images":[{"bufferView":0,"mimeType":"image/png"},{"uri":"gone%20.png"}],"textures":[{"source":0},{"source":1}],
           "materials":[{"name":"m","alphaMode":"MASK","alphaCutoff":0.25,"doubleSided":true,
                         "pbrMetallicRoughness":{"baseColorFactor":[1,0.5,0,1],"baseColorTexture":{"index":0}}},
                        {"pbrMetallicRoughness":{"baseColorTexture":{"index":1}}}],
           "cameras":[{"type":"perspective","perspective":{"yfov":1,"znear":0.1,"aspectRatio":2}}],
           "extensions":{"KHR_lights_punctual":{"lights":[{"type":"directional","intensity":3,"color":[1,0.5,0]}]}},
           "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":5,"material":0}]}],
           "nodes":[{"mesh":0},{"camera":0,"translation":[0,0,5]},{"extensions":{"KHR_lights_punctual":{"light":0}}}]"#;
    let loaded = gltf(&bytes, &rest).unwrap();
    assert!(loaded.warnings.len() == 1 && loaded.warnings[0].contains("gone .png"), "{:?}", loaded.warnings);
    let scene = scene(loaded);
    let material = &scene.materials()[scene.instances()[0].material.unwrap().0 as usize];
    assert_eq!((material.base_colour, material.two_sided), ([1.0, 0.5, 0.0, 1.0], true));
    assert_eq!(material.alpha, AlphaMode::Mask { cutoff: 0.25 });
    let texture = &scene.textures()[material.texture.unwrap().0 as usize];
    assert_eq!(texture.texels(), [[255, 0, 0, 255], [0, 0, 255, 255]]);
    let camera = &scene.cameras()[0];
    assert_eq!((camera.eye(), camera.width(), camera.height()), (DVec3::new(0.0, 0.0, 5.0), 2160, 1080));
    assert!(matches!(scene.lights()[0], Light::Directional { direction, irradiance, .. }
        if direction == DVec3::NEG_Z && irradiance == Vec3::new(3.0, 1.5, 0.0)));
}

#[test]
fn gltf_lies_are_found() {
    let mesh = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":5}]}]"#;
    let good = SQUARE.to_owned() + mesh;
    assert!(gltf(&square(), &good).is_ok());
    for (from, to) in [
        (r#""count":4,"type":"VEC3""#, r#""count":5,"type":"VEC3""#),
        (r#""count":4,"type":"VEC3""#, r#""count":18446744073709551615,"type":"VEC3""#),
        (r#""byteLength":48"#, r#""byteLength":48,"byteStride":4"#),
        (r#""byteLength":48"#, r#""byteLength":4800"#),
        (r#""byteOffset":48"#, r#""byteOffset":18446744073709551615"#),
        (r#""bufferView":0"#, r#""bufferView":9"#),
        (r#""bufferView":0"#, r#""byteOffset":0"#),
        (r#""VEC3""#, r#""VEC2""#),
        (r#""componentType":5126"#, r#""componentType":1"#),
        (r#""indices":1"#, r#""indices":0"#),
        (r#""indices":1"#, r#""indices":7"#),
        (r#""meshes""#, r#""nodes":[{"mesh":3}],"meshes""#),
        (r#""meshes""#, r#""nodes":[{"children":[0]}],"scenes":[{"nodes":[0]}],"meshes""#),
        (r#""meshes""#, r#""nodes":[{"children":[1,1]},{}],"meshes""#),
        (r#""meshes""#, r#""nodes":[{"mesh":0,"rotation":[0,0,0,0]}],"meshes""#),
        (r#""meshes""#, r#""extensionsRequired":["KHR_draco_mesh_compression"],"meshes""#),
    ] {
        let rest = good.replacen(from, to, 1);
        assert_ne!(rest, good);
        let result = gltf(&square(), &rest);
        // Zeros without a buffer view are legal, an index out of range after them is not asked for.
        let legal = to == r#""byteOffset":0"#;
        assert_eq!(result.is_ok(), legal, "{to}");
    }
    // A billion zeros that no byte stands for.
    let zeros = good.replacen(
        r#""bufferView":0,"componentType":5126,"count":4"#,
        r#""componentType":5126,"count":1000000000"#,
        1,
    );
    assert!(matches!(gltf(&square(), &zeros), Err(ImportError::Limit { .. })));
}

#[test]
fn the_front_door_names_file_and_cause() {
    let folder = std::env::temp_dir().join(format!("farsight-io-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("Tri.OBJ");
    std::fs::write(
        &path,
        "mtllib ../../etc/passwd\nmtllib /etc/passwd\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n",
    )
    .unwrap();
    let loaded = io::load(&path).unwrap();
    assert!(matches!(loaded.content, Content::Scene(_)));
    assert!(loaded.warnings.iter().all(|w| w.contains("leaves the folder")) && loaded.warnings.len() == 2);
    std::fs::create_dir_all(folder.join("folder.ply")).unwrap();
    for (name, cause) in [
        ("none.glb", "No such file"),
        ("a.step", "unknown extension 'step'"),
        ("README", "unknown extension ''"),
        ("folder.ply", "not a regular file"),
    ] {
        let error = io::load(folder.join(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(cause), "{error}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
