//! What is built before the walk, so that frames have something to choose from.

use crate::casters::{self, CasterStore};
use crate::cells::Cells;
use crate::forms::{Forms, LEAST_TRIANGLES};
use crate::input::Input;
use crate::surfaces::{self, Surface};
use farsight_geometry::ray::SceneCaster;
use farsight_geometry::scene::Light;
use farsight_hlod::Store;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Everything that was built.
pub struct Built {
    pub forms: Forms,
    pub cells: Cells,
    /// Hierarchies of large surfaces, sorted by instance.
    pub surfaces: Vec<Surface>,
    /// One of the whole scene, for shadows, where there are none of large surfaces.
    pub casters: Option<Arc<Store>>,
    /// What was done, in words, and how long it took.
    pub steps: Vec<(String, Duration)>,
}

impl Built {
    /// Nothing: frames draw everything in full.
    pub fn nothing(input: &Input) -> Result<Self, Box<dyn Error>> {
        let forms = Forms::build(&input.scene, usize::MAX)?;
        Ok(Self { forms, cells: Cells::default(), surfaces: Vec::new(), casters: None, steps: Vec::new() })
    }

    /// Coarser forms of the meshes, sets of what can be seen from around the walk's viewpoints, and hierarchies in `folder` of what is large, or of all shadow casters. `tell`
    /// hears what is being done.
    pub fn build(
        input: &Input,
        frames: usize,
        folder: &Path,
        tell: impl Fn(&'static str),
    ) -> Result<Self, Box<dyn Error>> {
        tell("coarser forms");
        let start = Instant::now();
        let forms = Forms::build(&input.scene, LEAST_TRIANGLES)?;
        let (count, triangles) = forms.count();
        let text = format!(
            "{count} coarser forms of the meshes with {triangles} triangles, each with a proven error"
        );
        let mut steps = vec![(text, start.elapsed())];

        tell("visible sets");
        let start = Instant::now();
        let caster = SceneCaster::new(&input.scene)?;
        let cells = Cells::bake(&input.scene, &caster, &input.walk, frames)?;
        steps.extend(cells.iter().map(|cell| {
            let bound = 1e3 * cell.missed.bound.value;
            let (seen, all) = (cell.set.len(), input.scene.instances().len());
            let text = format!(
                "{seen} of {all} objects can be seen from around a viewpoint; share of pixels missed at most {bound:.2} ‰, {} rays",
                cell.rays
            );
            (text, Duration::ZERO)
        }));
        if cells.iter().next().is_some() {
            steps.push(("all these sets".into(), start.elapsed()));
        }
        tell("hierarchies of what is large");
        let start = Instant::now();
        let (surfaces, why) = surfaces::build_all(&input.scene, folder)?;
        if !surfaces.is_empty() {
            steps.push((surfaces::text(&surfaces), start.elapsed()));
        }
        steps.extend(why.map(|why| (why, Duration::ZERO)));

        let sun = matches!(input.scene.lights().first(), Some(Light::Directional { .. }));
        let casters = if sun && surfaces.is_empty() {
            tell("shadow casters");
            let start = Instant::now();
            let built = casters::build_whole(&input.scene, &folder.join("casters.hlod"))?;
            let text = built.as_ref().map_or_else(String::clone, |store| casters::text(store));
            steps.push((text, if built.is_ok() { start.elapsed() } else { Duration::ZERO }));
            built.ok()
        } else {
            None
        };
        Ok(Self { forms, cells, surfaces, casters, steps })
    }

    /// What may throw shadows in place of the objects.
    pub fn caster_stores(&self) -> Vec<CasterStore> {
        let whole = self.casters.iter().map(|store| CasterStore::new(store.clone(), None));
        let own = self.surfaces.iter().map(|s| CasterStore::new(s.store.clone(), Some(s.instance)));
        whole.chain(own).collect()
    }
}
