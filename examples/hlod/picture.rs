//! Pictures of a level: shaded, its triangles, and what differs from the original.

use farsight_geometry::glam::Vec3;
use farsight_geometry::scene::{Light, Scene};
use farsight_geometry::{Camera, TriangleMesh};
use farsight_raster::{Image, Rasteriser, RenderOptions, SceneIds, render_scene};
use std::error::Error;

/// Pictures of one surface.
pub struct Views {
    pub shaded: Image,
    pub triangles: Image,
    /// Difference to the original, four times enlarged.
    pub difference: Image,
    /// Root of the mean squared difference.
    pub rmse: f64,
}

/// Draws a surface; `original` is what it is compared with.
pub fn views(
    mesh: &TriangleMesh,
    camera: &Camera,
    original: Option<&Views>,
) -> Result<Views, Box<dyn Error>> {
    let mut scene = Scene::of_mesh(mesh.clone());
    let direction = (-camera.up() + camera.forward() * 0.6 + camera.right()).normalize();
    scene.add_light(Light::Directional { direction, irradiance: Vec3::splat(2.0), angular_radius: 0.0 })?;
    let mut options = RenderOptions::default();
    (options.ids, options.up, options.supersampling) = (SceneIds::Triangles, camera.up(), 2);
    options.sky = None;
    let (target, _) = render_scene(&mut Rasteriser::new(), &scene, camera, &options)?;
    let shaded = Image::from_colour(&target);
    options.supersampling = 1;
    let (target, _) = render_scene(&mut Rasteriser::new(), &scene, camera, &options)?;
    let grey = |id: u32| match id {
        0 => [255; 3],
        id => [(70 + (id.wrapping_mul(2_654_435_761) >> 24) * 160 / 255) as u8; 3],
    };
    let triangles = Image::new(camera.width(), camera.height(), target.ids().map(grey).collect())?;
    let difference = shaded.compare(original.map_or(&shaded, |o| &o.shaded))?;
    Ok(Views {
        difference: difference.to_image(camera.width(), camera.height(), 4)?,
        rmse: difference.rmse,
        shaded,
        triangles,
    })
}

/// All views in one picture: a column a surface.
pub fn comparison(columns: &[&Views]) -> Result<Image, Box<dyn Error>> {
    let (width, height) = (columns[0].shaded.width() as usize, columns[0].shaded.height() as usize);
    let mut pixels = Vec::with_capacity(3 * width * height * columns.len());
    let rows: [fn(&Views) -> &Image; 3] = [|v| &v.shaded, |v| &v.triangles, |v| &v.difference];
    for row in rows {
        for y in 0..height {
            for column in columns {
                pixels.extend_from_slice(&row(column).pixels()[y * width..(y + 1) * width]);
            }
        }
    }
    Ok(Image::new((width * columns.len()) as u32, 3 * height as u32, pixels)?)
}
