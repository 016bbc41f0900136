//! Pictures of a level: shaded, its nodes, and what differs from the original.

use farsight_geometry::glam::{DVec3, Vec3, Vec4};
use farsight_geometry::{Camera, ClipConvention, TriangleMesh};
use farsight_raster::{Draw, Fragment, Image, LineDraw, Outputs, Rasteriser, State, Target};
use std::error::Error;

/// Samples along a side of a pixel.
const FINE: u32 = 2;

/// A mesh to draw, and sides of it that are drawn as lines too.
pub struct Part {
    pub mesh: TriangleMesh,
    pub rims: Vec<[u32; 2]>,
}

impl Part {
    pub fn whole(mesh: &TriangleMesh) -> Self {
        Self { mesh: mesh.clone(), rims: Vec::new() }
    }
}

/// Pictures of one surface.
pub struct Views {
    pub shaded: Image,
    pub nodes: Image,
    /// Difference to the original, four times enlarged.
    pub difference: Image,
    /// Root of the mean squared difference.
    pub rmse: f64,
}

/// Draws a surface; `original` is what it is compared with.
pub fn views(parts: &[Part], camera: &Camera, original: Option<&Views>) -> Result<Views, Box<dyn Error>> {
    let (width, height) = (camera.width(), camera.height());
    let fine = camera.with_image(FINE * width, FINE * height)?;
    let mut target = Target::new(fine.width(), fine.height(), Outputs::ALL)?;
    let light = (camera.up() - camera.forward() * 0.6 - camera.right()).normalize().as_vec3();
    parts.iter().for_each(|p| draw(&mut target, &fine, p, light));
    let shaded = Image::from_colour(&target.downsampled(FINE));
    let mut target = Target::new(width, height, Outputs::ALL)?;
    for (i, part) in parts.iter().enumerate() {
        // Each node in a tint of its own, each triangle in a shade of it.
        let tint = (i as u32 + 1).wrapping_mul(2_654_435_761);
        let colour = [0, 8, 16].map(|s| 0.25 + 0.5 * (tint >> s & 255) as f32 / 255.0);
        let shade = |f: &Fragment| {
            let grey = 0.7 + 0.3 * (f.triangle.wrapping_mul(2_246_822_519) >> 24) as f32 / 255.0;
            Some((Vec3::from_array(colour) * grey).extend(1.0))
        };
        let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, part.mesh.origin());
        let (positions, triangles) = (part.mesh.positions(), part.mesh.triangles());
        let state = State::default();
        Rasteriser::new().draw_shaded(
            &mut target,
            &Draw { positions, triangles, clip_from_local: clip, state },
            &shade,
        );
    }
    let nodes = Image::from_colour(&target);
    let difference = shaded.compare(original.map_or(&shaded, |o| &o.shaded))?;
    Ok(Views { difference: difference.to_image(width, height, 4)?, rmse: difference.rmse, shaded, nodes })
}

fn draw(target: &mut Target, camera: &Camera, part: &Part, light: Vec3) {
    let mesh = &part.mesh;
    let (positions, triangles) = (mesh.positions(), mesh.triangles());
    let faces: Vec<Vec3> =
        mesh.corner_iter().map(|[a, b, c]| (b - a).cross(c - a).normalize_or_zero()).collect();
    let eye = (camera.eye() - mesh.origin()).as_vec3();
    let lit = |normal: Vec3, at: Vec3| {
        let normal = if normal.dot(eye - at) < 0.0 { -normal } else { normal };
        let shade = 0.08 + 0.7 * normal.dot(light).max(0.0);
        Vec4::new(shade, shade, shade * 0.95, 1.0)
    };
    let shade = |f: &Fragment| {
        let (t, w) = (triangles[f.triangle as usize], f.weights().to_array());
        let mix = |of: &[Vec3]| (0..3).map(|i| of[t[i] as usize] * w[i]).sum::<Vec3>();
        let normal = mesh.normals().map_or(faces[f.triangle as usize], |n| mix(n).normalize_or_zero());
        Some(lit(normal, mix(positions)))
    };
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, mesh.origin());
    let state = State::default();
    let mut rasteriser = Rasteriser::new();
    rasteriser.draw_shaded(target, &Draw { positions, triangles, clip_from_local: clip, state }, &shade);
    // What lies between two nodes is hidden behind their rims, one pixel wide.
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for (t, n) in triangles.iter().zip(&faces) {
        t.iter().for_each(|&v| normals[v as usize] = *n);
    }
    for rim in &part.rims {
        let normal = mesh.normals().unwrap_or(&normals)[rim[0] as usize];
        let segments = [rim.map(|v| positions[v as usize])];
        let colour = lit(normal, segments[0][0]);
        let lines = LineDraw { segments: &segments, colour, width_px: FINE, clip_from_local: clip, state };
        rasteriser.draw_lines(target, &lines);
    }
}

/// Visible points of a surface, a few thousand of them.
pub fn visible_points(mesh: &TriangleMesh, camera: &Camera) -> Result<Vec<DVec3>, Box<dyn Error>> {
    let mut target = Target::new(camera.width(), camera.height(), Outputs::DEPTH)?;
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, mesh.origin());
    let state = State::default();
    let draw =
        Draw { positions: mesh.positions(), triangles: mesh.triangles(), clip_from_local: clip, state };
    Rasteriser::new().draw(&mut target, &draw);
    let back = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye()).inverse();
    let mut points = Vec::new();
    for y in (0..camera.height()).step_by(3) {
        for x in (0..camera.width()).step_by(3) {
            let depth = f64::from(target.depth(x, y));
            if depth > 0.0 {
                let ndc = |v: u32, side: u32| (f64::from(v) + 0.5) / f64::from(side) * 2.0 - 1.0;
                let clip = DVec3::new(ndc(x, camera.width()), -ndc(y, camera.height()), depth);
                points.push(camera.eye() + back.project_point3(clip));
            }
        }
    }
    Ok(points)
}

/// All views in one picture: a column a surface.
pub fn comparison(columns: &[&Views]) -> Result<Image, Box<dyn Error>> {
    let (width, height) = (columns[0].shaded.width() as usize, columns[0].shaded.height() as usize);
    let mut pixels = Vec::with_capacity(3 * width * height * columns.len());
    let rows: [fn(&Views) -> &Image; 3] = [|v| &v.shaded, |v| &v.nodes, |v| &v.difference];
    for row in rows {
        for y in 0..height {
            for column in columns {
                pixels.extend_from_slice(&row(column).pixels()[y * width..(y + 1) * width]);
            }
        }
    }
    Ok(Image::new((width * columns.len()) as u32, 3 * height as u32, pixels)?)
}
