//! Materials and their pictures.

use super::{Reader, container, item};
use crate::io::{ImportError, picture, short_name};
use crate::scene::{AlphaMode, Material, MaterialId, Texture, TextureId};
use ::gltf::json;
use ::gltf::json::validation::Checked;
use std::collections::HashMap;

impl Reader<'_> {
    /// Adds all materials of the file.
    pub(super) fn materials(&mut self) -> Result<Vec<MaterialId>, ImportError> {
        let root = self.root;
        let mut known = HashMap::new();
        let mut ids = Vec::new();
        for (number, source) in root.materials.iter().enumerate() {
            let name = source.name.as_deref().map_or_else(|| format!("material {number}"), short_name);
            let texture = source.pbr_metallic_roughness.base_color_texture.as_ref();
            let cutoff = source.alpha_cutoff.map_or(0.5, |c| c.0);
            let material = Material {
                name,
                base_colour: source.pbr_metallic_roughness.base_color_factor.0,
                texture: match texture {
                    Some(info) => self.texture(info.index.value(), &mut known),
                    None => None,
                },
                alpha: match source.alpha_mode {
                    Checked::Valid(json::material::AlphaMode::Mask) => AlphaMode::Mask { cutoff },
                    Checked::Valid(json::material::AlphaMode::Blend) => AlphaMode::Blend,
                    _ => AlphaMode::Opaque,
                },
                two_sided: source.double_sided,
            };
            ids.push(self.scene.add_material(material)?);
        }
        Ok(ids)
    }

    /// The texture, or a warning.
    fn texture(&mut self, index: usize, known: &mut HashMap<usize, Option<TextureId>>) -> Option<TextureId> {
        let image = match item(&self.root.textures, index, "texture") {
            Ok(texture) => texture.source.value(),
            Err(error) => {
                self.warnings.push(error.to_string());
                return None;
            }
        };
        if let Some(&id) = known.get(&image) {
            return id;
        }
        let id = match self.picture(image) {
            Ok(texture) => Some(self.scene.add_texture(texture)),
            Err(error) => {
                self.warnings.push(format!("picture {image}: {error}"));
                None
            }
        };
        known.insert(image, id);
        id
    }

    fn picture(&mut self, index: usize) -> Result<Texture, ImportError> {
        let image = item(&self.root.images, index, "image")?;
        if let Some(view) = image.buffer_view {
            let (bytes, _) = self.buffers.view(self.root, view.value())?;
            return picture::decode(bytes, &mut self.pictures);
        }
        match image.uri.as_deref() {
            Some(uri) => picture::decode(&container::fetch(uri, self.siblings)?, &mut self.pictures),
            None => Err(ImportError::syntax(format!("image {index}"), "neither a buffer view nor a uri")),
        }
    }
}
