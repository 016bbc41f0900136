//! Pictures from the cell with what was missed in red, and of what was kept from above.

use super::input::Input;
use super::{Arguments, Sampled};
use farsight_geometry::glam::DVec3;
use farsight_geometry::scene::{Instance, Scene};
use farsight_geometry::{Camera, TriangleMesh};
use farsight_raster::{Image, Rasteriser, RenderOptions, SceneIds, render_scene};
use farsight_visibility::Pvs;
use std::error::Error;
use std::path::PathBuf;

/// Writes the pictures; returns their paths.
pub fn write(
    input: &Input,
    mesh: &TriangleMesh,
    all: &[Sampled],
    arguments: &Arguments,
) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let [width, height] = if arguments.quick { [480, 270] } else { [1600, 900] };
    let mut options = RenderOptions::default();
    (options.ids, options.up) = (SceneIds::Triangles, input.up);
    let mut rasteriser = Rasteriser::new();
    let mut paths = Vec::new();
    let eye = input.cell.center() - input.ahead * input.cell.extent().dot(input.ahead.abs()) * 0.45;
    let camera = Camera::look_at(eye, eye + input.ahead, input.up)?.with_image(width, height)?;
    let camera = camera.with_range(1e-3 * input.cell.extent().max_element().max(1e-3), f64::INFINITY)?;
    let (target, _) = render_scene(&mut rasteriser, &input.scene, &camera, &options)?;
    let (plain, ids) = (Image::from_colour(&target), target.ids().collect::<Vec<_>>());
    for sampled in all {
        let missed = |id: u32| id != 0 && !sampled.set.contains(id - 1);
        let red = ids.iter().filter(|&&id| missed(id)).count();
        println!("{:<8} {red} of {} pixels of this view are missed", sampled.name, ids.len());
        let pixels = plain.pixels().iter().zip(&ids).map(|(&pixel, &id)| {
            // What is seen is paled, so that the misses stand out.
            let pale = pixel.map(|c| 96 + (u16::from(c) * 5 / 8) as u8);
            if missed(id) { [255, 0, 0] } else { pale }
        });
        let path = arguments.out.join(format!("missed-{}.png", sampled.name));
        Image::new(width, height, pixels.collect())?.write_png(&path)?;
        paths.push(path);
    }
    let path = arguments.out.join("kept.png");
    kept(input, mesh, &all[0].set, [width, height])?.write_png(&path)?;
    paths.push(path);
    Ok(paths)
}

/// The set alone, from above the cell.
fn kept(
    input: &Input,
    mesh: &TriangleMesh,
    set: &Pvs,
    [width, height]: [u32; 2],
) -> Result<Image, Box<dyn Error>> {
    let size = set.iter().flat_map(|t| mesh.corners(t as usize)).fold(0.0f64, |size, p| {
        let from_cell = mesh.origin() + p.as_dvec3() - input.cell.center();
        size.max(from_cell.length())
    });
    let size = size.max(1e-6);
    let middle = input.cell.center();
    let eye =
        middle + input.up * size * 0.4 - input.ahead * size * 0.5 + input.ahead.cross(input.up) * size * 0.25;
    let scene = only(&input.scene, set, eye)?;
    let camera =
        Camera::look_at(eye, middle + input.ahead * size * 0.12, input.up)?.with_image(width, height)?;
    let mut options = RenderOptions::default();
    (options.up, options.sky) = (input.up, Some([farsight_geometry::glam::Vec3::splat(0.03); 2]));
    let (target, _) = render_scene(&mut Rasteriser::new(), &scene, &camera, &options)?;
    let mut image = Image::from_colour(&target);
    // The cell's corners, as yellow dots.
    let mut pixels = image.pixels().to_vec();
    for at in dots(input).into_iter().filter_map(|p| camera.project(p)) {
        let (x, y) = (at.0.x as i64, at.0.y as i64);
        for (dx, dy) in (-2..=2).flat_map(|dx| (-2..=2).map(move |dy| (dx, dy))) {
            let (x, y) = (x + dx, y + dy);
            if (0..i64::from(width)).contains(&x) && (0..i64::from(height)).contains(&y) {
                pixels[(y * i64::from(width) + x) as usize] = [255, 230, 0];
            }
        }
    }
    image = Image::new(width, height, pixels)?;
    Ok(image)
}

/// A scene without the triangles that are not in the set, and without those that turn their backs to the eye: so one looks
/// into rooms.
fn only(scene: &Scene, set: &Pvs, eye: DVec3) -> Result<Scene, Box<dyn Error>> {
    let mut kept = Scene::new();
    scene.textures().iter().for_each(|texture| _ = kept.add_texture(texture.clone()));
    for material in scene.materials() {
        kept.add_material(material.clone())?;
    }
    for &light in scene.lights() {
        kept.add_light(light)?;
    }
    let mut first = 0;
    for instance in scene.instances() {
        let whole = scene.mesh_of(instance);
        let last = first + whole.triangles().len() as u32;
        let seen = set.intersection(&Pvs::from_sorted(first..last));
        let (place, side) = (instance.world_from_mesh, instance.world_from_mesh.matrix3.determinant());
        let faces_eye = |t: &u32| {
            let corners = whole.corners((t - first) as usize).map(|p| whole.origin() + p.as_dvec3());
            let [a, b, c] = corners.map(|p| place.transform_point3(p));
            (b - a).cross(c - a).dot(eye - a) * side > 0.0
        };
        let triangles =
            seen.iter().filter(faces_eye).map(|t| whole.triangles()[(t - first) as usize]).collect();
        first = last;
        if seen.is_empty() {
            continue;
        }
        let mut mesh =
            TriangleMesh::new(whole.positions().to_vec(), triangles)?.with_origin(whole.origin())?;
        if let Some(normals) = whole.normals() {
            mesh = mesh.with_normals(normals.to_vec())?;
        }
        if let Some(uvs) = whole.uvs() {
            mesh = mesh.with_uvs(uvs.to_vec())?;
        }
        if let Some(colours) = whole.colours() {
            mesh = mesh.with_colours(colours.to_vec())?;
        }
        let mesh = kept.add_mesh(mesh);
        kept.add_instance(Instance { mesh, ..instance.clone() })?;
    }
    Ok(kept)
}

/// Points along the cell's edges.
fn dots(input: &Input) -> Vec<DVec3> {
    let corners = input.cell.corners();
    let edges = (0..8).flat_map(|i| [1, 2, 4].map(|bit| (i, i | bit))).filter(|(i, j)| i != j);
    edges
        .flat_map(|(i, j): (usize, usize)| {
            (0..=20).map(move |t| corners[i].lerp(corners[j], f64::from(t) / 20.0))
        })
        .collect()
}
