//! Software reference renderer and seeded scene generators: what the other crates are tested, shown and timed with.
//!
//! It is an oracle first. Vertices are transformed in `f64` and snapped to 1/256 px; coverage is exact (integer edge
//! functions, top-left rule, each pixel of a shared edge once); depth is that of the unsnapped surface at the pixel's
//! centre; attributes are perspective-correct. Images are the same bytes on every instruction set. One thread.
//!
//! Depth is reversed throughout: 1 at the near plane, 0 far away. [`native_from`] takes any other convention there.
//!
//! | question | answer |
//! |---|---|
//! | draw a mesh | [`Rasteriser::draw`], [`Rasteriser::draw_shaded`] into a [`Target`] |
//! | draw points, lines, impostors | [`Rasteriser::draw_points`], [`Rasteriser::draw_lines`], [`Rasteriser::draw_quad`] |
//! | draw a scene | [`render_scene`], with shadows from [`ShadowMap`] |
//! | is it visible? | [`OcclusionQueries`], [`Rasteriser::count_samples`] |
//! | what light really arrives? | [`irradiance_from`] |
//! | what did it cost? | [`Counters`], [`thread_cpu_time`], [`fifo_cache_misses`] |
//! | how do images differ? | [`Image::compare`] |
//! | something to draw | [`scenes`] |
//!
//! ```
//! use farsight_raster::scenes::{City, Path};
//! use farsight_raster::{Image, Rasteriser, RenderOptions, render_scene};
//!
//! let city = City::small();
//! let scene = city.build()?;
//! let camera = Path::street_walk(&city).camera(0, 100)?.with_image(160, 90)?;
//! let (target, counters) = render_scene(&mut Rasteriser::new(), &scene, &camera, &RenderOptions::default())?;
//! assert!(counters.drawn > 0 && target.ids().any(|id| id != 0));
//! let png = Image::from_colour(&target).to_png()?;
//! assert!(png.starts_with(b"\x89PNG"));
//! # Ok::<(), farsight_raster::RasterError>(())
//! ```

mod area_light;
mod clip;
mod counters;
mod cpu_time;
mod draw;
mod error;
mod image;
mod line;
mod point;
mod quad;
mod query;
mod random;
mod render;
pub mod scenes;
mod shade;
mod shadow_map;
mod surface;
mod target;
mod texture;
mod triangle;
mod vertex_cache;

pub use area_light::{Arriving, irradiance_from};
pub use clip::native_from;
pub use counters::Counters;
pub use cpu_time::thread_cpu_time;
pub use draw::{Blend, DepthTest, Draw, Fragment, Ids, PixelShader, Rasteriser, State};
pub use error::RasterError;
pub use glam;
#[cfg(feature = "exr")]
pub use image::write_exr;
pub use image::{Difference, Image, linear_of, srgb_byte};
pub use line::LineDraw;
pub use point::{MAX_SPLAT_PX, PointDraw, Splat};
pub use quad::{QuadDraw, QuadImage};
pub use query::{Answer, OcclusionQueries, QueryId};
pub use random::Random;
pub use render::{Part, RenderOptions, SceneIds, mip_maps, relative_from_mesh, render_picture, render_scene};
pub use shade::Lighting;
pub use shadow_map::{Penumbra, ShadowMap, ShadowOptions};
pub use surface::Side;
pub use target::{MAX_SIDE, Outputs, Target};
pub use texture::MipMap;
pub use triangle::{Cull, SUBPIXELS};
pub use vertex_cache::fifo_cache_misses;
