//! Material libraries, through `tobj`.

use super::{Parser, Words};
use crate::io::{Budget, ImportError, Siblings, picture};
use crate::scene::{AlphaMode, Material, MaterialId, Scene, Texture, TextureId};
use std::collections::HashMap;

/// Adds every material that faces may use, in order of first use, with what the libraries say about it.
pub(super) fn add_all(
    scene: &mut Scene,
    parser: &Parser,
    siblings: Siblings<'_>,
    warnings: &mut Vec<String>,
) -> Result<Vec<MaterialId>, ImportError> {
    if parser.material_names.is_empty() {
        return Ok(vec![]);
    }
    let library = read_libraries(&parser.libraries, siblings, warnings);
    let mut textures = HashMap::new();
    let mut ids = Vec::new();
    for name in &parser.material_names {
        let mut material = Material { name: name.clone(), ..Material::default() };
        if let Some(found) = library.get(name) {
            apply(&mut material, found, |file| load_texture(scene, &mut textures, file, siblings, warnings));
        }
        ids.push(scene.add_material(material)?);
    }
    Ok(ids)
}

fn apply(
    material: &mut Material,
    found: &tobj::Material,
    mut texture: impl FnMut(&str) -> Option<TextureId>,
) {
    if let Some([r, g, b]) = found.diffuse {
        material.base_colour = [r, g, b, 1.0];
    }
    if let Some(alpha) = found.dissolve.filter(|a| *a < 1.0) {
        material.base_colour[3] = alpha;
        material.alpha = AlphaMode::Blend;
    }
    if let Some(file) = found.diffuse_texture.as_deref() {
        material.texture = texture(file);
        // A picture says the colour; Kd beside it is often left black.
        if material.texture.is_some() && found.diffuse.is_none_or(|kd| kd == [0.0; 3]) {
            material.base_colour[..3].fill(1.0);
        }
    }
}

fn read_libraries(
    names: &[String],
    siblings: Siblings<'_>,
    warnings: &mut Vec<String>,
) -> HashMap<String, tobj::Material> {
    let mut all = HashMap::new();
    for name in names {
        let bytes = match siblings(name) {
            Ok(bytes) => bytes,
            Err(error) => {
                warnings.push(format!("material library '{name}': {error}"));
                continue;
            }
        };
        match tobj::load_mtl_buf(&mut harmless_lines(&bytes).as_bytes()) {
            Ok((materials, _)) => all.extend(materials.into_iter().map(|m| (m.name.clone(), m))),
            Err(error) => warnings.push(format!("material library '{name}': {error}")),
        }
    }
    all
}

/// The lines of a library that are used and well formed: `tobj` panics on colours of fewer than three numbers and gives
/// up a whole library for one bad line.
fn harmless_lines(bytes: &[u8]) -> String {
    let mut text = String::new();
    for line in bytes.split(|&b| b == b'\n') {
        let mut words = Words(line);
        let key = words.next().unwrap_or_default();
        let rest = String::from_utf8_lossy(words.0.trim_ascii()).into_owned();
        let numbers: Vec<f32> = words.map_while(finite).collect();
        let keep = match key {
            b"newmtl" | b"map_Kd" => !rest.is_empty(),
            b"Kd" => numbers.len() >= 3,
            b"d" => !numbers.is_empty(),
            _ => false,
        };
        if !keep {
            continue;
        }
        let key = String::from_utf8_lossy(key);
        match &*key {
            "Kd" => text += &format!("Kd {} {} {}\n", numbers[0], numbers[1], numbers[2]),
            "d" => text += &format!("d {}\n", numbers[0].clamp(0.0, 1.0)),
            _ => text += &format!("{key} {rest}\n"),
        }
    }
    text
}

fn finite(word: &[u8]) -> Option<f32> {
    std::str::from_utf8(word).ok()?.parse().ok().filter(|x: &f32| x.is_finite())
}

fn decode(bytes: &[u8]) -> Result<Texture, ImportError> {
    let mut budget = Budget::new("bytes of texels", bytes.len() as u64, picture::PICTURES_FLOOR);
    picture::decode(bytes, &mut budget)
}

fn load_texture(
    scene: &mut Scene,
    known: &mut HashMap<String, Option<TextureId>>,
    file: &str,
    siblings: Siblings<'_>,
    warnings: &mut Vec<String>,
) -> Option<TextureId> {
    // Options come before the name: "-s 2 2 1 wall.png".
    let name = if file.starts_with('-') { file.split_whitespace().last().unwrap_or(file) } else { file };
    *known.entry(name.to_owned()).or_insert_with(|| match siblings(name).and_then(|bytes| decode(&bytes)) {
        Ok(texture) => Some(scene.add_texture(texture)),
        Err(error) => {
            warnings.push(format!("picture '{name}': {error}"));
            None
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_break_the_parser_are_kept_from_it() {
        let library = b"Kd 0.5\nnewmtl\nnewmtl red\nKd 1 0\nKd 1 0 nan\nKd 1 0 0\nNi x\nd\nd 2\nnewmtl blue\nKd 0 0 1 9\r\n";
        let (materials, _) = tobj::load_mtl_buf(&mut harmless_lines(library).as_bytes()).unwrap();
        assert_eq!(materials.len(), 2);
        assert_eq!((materials[0].diffuse, materials[0].dissolve), (Some([1.0, 0.0, 0.0]), Some(1.0)));
        assert_eq!(materials[1].diffuse, Some([0.0, 0.0, 1.0]));
    }
}
