//! Software reference renderer and seeded scene generators.

mod clip;
mod counters;
mod draw;
mod error;
mod image;
mod random;
mod render;
pub mod scenes;
mod shade;
mod shadow_map;
mod target;
mod texture;
mod triangle;

pub use clip::native_from;
pub use counters::Counters;
pub use draw::{Blend, DepthTest, Draw, Fragment, Ids, PixelShader, Rasteriser, State};
pub use error::RasterError;
pub use image::{Difference, Image, linear_of, srgb_byte};
pub use random::Random;
pub use render::{RenderOptions, SceneIds, mip_maps, relative_from_mesh, render_scene};
pub use shade::Lighting;
pub use shadow_map::{ShadowMap, ShadowOptions};
pub use target::{MAX_SIDE, Outputs, Target};
pub use texture::MipMap;
pub use triangle::{Cull, SUBPIXELS};
