//! The passes of a frame, and which of them anybody needs.

use crate::summary::Outputs;

/// A pass over the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Pass {
    /// Finds out what is hidden.
    Cull,
    /// Draws the shadow map of a light.
    ShadowMap {
        /// Its place in the scene's list.
        light: u32,
    },
    /// Draws impostors anew where they are off by too much.
    Impostors,
    /// Draws the objects.
    Objects,
    /// Draws the point clouds.
    Clouds,
}

/// What passes hand on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Resource {
    /// Which objects are not hidden.
    Visible,
    /// The shadow map of a light.
    Map(u32),
    /// Pictures of objects.
    Pictures,
    /// The image's colours.
    Colour,
    /// The image's depths.
    Depth,
}

impl Pass {
    /// Whether the pass makes `resource`.
    pub fn makes(self, resource: Resource) -> bool {
        match (self, resource) {
            (Pass::Cull, Resource::Visible) | (Pass::Impostors, Resource::Pictures) => true,
            (Pass::ShadowMap { light }, Resource::Map(map)) => light == map,
            (Pass::Objects | Pass::Clouds, Resource::Colour | Resource::Depth) => true,
            _ => false,
        }
    }

    /// Whether the pass needs `resource` where it was made before, for an image with these outputs.
    pub fn reads(self, resource: Resource, outputs: Outputs) -> bool {
        match (self, resource) {
            (Pass::Objects, Resource::Visible | Resource::Pictures) => true,
            // Depths take no shadows.
            (Pass::Objects | Pass::Clouds, Resource::Map(_)) => outputs.colour,
            _ => false,
        }
    }
}

/// Whether somebody outside reads it.
pub fn is_output(resource: Resource, outputs: Outputs) -> bool {
    match resource {
        Resource::Colour => outputs.colour,
        Resource::Depth => outputs.depth,
        _ => false,
    }
}
