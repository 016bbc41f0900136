//! What is drawn of every object: all of it, a coarser form, a picture, or nodes of a hierarchy.

use crate::forms::Forms;
use crate::frames::took;
use crate::movers::Movers;
use crate::nodes::Nodes;
use crate::pictures::{Drawn, Pictures};
use farsight_geometry::{Camera, Scene};
use farsight_plan::{Choice, ObjectView, Plan};
use farsight_raster::{Rasteriser, RenderOptions, thread_cpu_time};
use farsight_timing::Millis;
use std::error::Error;

/// Triangles drawn in place of an object's own; `None` for its own.
type Shape<'s> = Option<&'s [[u32; 3]]>;

/// What the objects' triangles are chosen from, and by which plan.
pub struct Shaping<'s> {
    pub scene: &'s Scene,
    pub forms: &'s Forms,
    pub movers: Option<&'s Movers>,
    pub nodes: &'s Nodes,
    pub seen: &'s [ObjectView],
    pub plan: &'s Plan,
    pub allowed_px: f64,
}

impl<'s> Shaping<'s> {
    /// What is drawn of every object; nothing where a picture stands for it.
    pub fn shapes(&self) -> Vec<Shape<'s>> {
        let shape = |(object, choice): (u32, Choice)| match choice {
            Choice::Impostor { .. } => Some(&[][..]),
            Choice::Detail { detail, .. } => {
                let moving = self.movers.and_then(|m| m.triangles(object));
                let form = self.nodes.form(object, detail);
                // Where nodes stand for it, nothing of its own is drawn.
                let own = form.map_or(&[][..], |form| self.forms.triangles(self.mesh(object), form));
                Some(moving.unwrap_or(own))
            }
            _ => None,
        };
        (0..).zip(self.plan.objects().iter().map(|d| d.choice)).map(shape).collect()
    }

    /// Pictures for those of `objects` that are to have one, and what making them took: pictures from before where one serves, new ones until that
    /// has taken `limit`, so that no frame is held up for those to come. An object left without is drawn as its picture would have shown it.
    pub fn stand_ins(
        &self,
        pictures: &mut Pictures,
        rasteriser: &mut Rasteriser,
        camera: &Camera,
        objects: &[u32],
        look: &RenderOptions,
        limit: Millis,
        shapes: &mut [Shape<'s>],
    ) -> Result<(Vec<Drawn>, Millis), Box<dyn Error>> {
        let (mut drawn, mut making) = (Vec::new(), Millis::ZERO);
        for &object in objects {
            let Choice::Impostor { error_px } = self.plan.objects()[object as usize].choice else { continue };
            let triangles = self.picture_of(object);
            let mut picture = pictures.kept(camera, object, error_px)?;
            if picture.is_none() && making < limit {
                let before = thread_cpu_time();
                picture = pictures.make(rasteriser, self.scene, camera, object, triangles, look)?;
                making += took(before);
            }
            match picture {
                Some(picture) => drawn.push(picture),
                None => shapes[object as usize] = Some(triangles),
            }
        }
        Ok((drawn, making))
    }

    /// What a picture of an object shows.
    fn picture_of(&self, object: u32) -> &'s [[u32; 3]] {
        let error = self.allowed_px / self.seen[object as usize].px_per_unit;
        let coarse = || self.forms.within(self.mesh(object), error).map(|f| f.0);
        let whole = || self.scene.meshes()[self.mesh(object) as usize].triangles();
        self.movers.and_then(|m| m.triangles(object)).or_else(coarse).unwrap_or_else(whole)
    }

    fn mesh(&self, object: u32) -> u32 {
        self.scene.instances()[object as usize].mesh.0
    }
}
