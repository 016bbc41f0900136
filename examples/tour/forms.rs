//! Coarser forms of the meshes: cuts through vertex hierarchies, each with a proven error.

use farsight_geometry::glam::DVec3;
use farsight_geometry::{Scene, TriangleMesh};
use farsight_lod::{Cut, LodError, Observer, Tolerance, VertexHierarchy};
use farsight_plan::{Detail, Form, Kind};
use rayon::prelude::*;

/// Meshes with fewer triangles are not worth coarser forms.
pub const LEAST_TRIANGLES: usize = 200;
/// Error of the finest form, as a share of the mesh's radius; by what it is multiplied from form to form; and how many forms are tried.
const FINEST: f64 = 1.0 / 1024.0;
const STEP: f64 = 2.0;
const FORMS: i32 = 8;

/// Forms of all meshes of a scene.
pub struct Forms {
    meshes: Vec<MeshForms>,
}

/// Forms of a mesh: triangles over its own vertices.
#[derive(Default)]
struct MeshForms {
    details: Vec<Detail>,
    triangles: Vec<Vec<[u32; 3]>>,
}

impl Forms {
    /// Makes the forms of every mesh of so many triangles or more; the others are always drawn as they are.
    pub fn build(scene: &Scene, least_triangles: usize) -> Result<Self, LodError> {
        let large = |mesh: &TriangleMesh| mesh.triangles().len() >= least_triangles;
        let forms = |mesh| if large(mesh) { MeshForms::build(mesh) } else { Ok(MeshForms::default()) };
        let meshes = scene.meshes().par_iter().map(forms).collect::<Result<_, _>>()?;
        Ok(Self { meshes })
    }

    /// The forms of one more mesh.
    pub fn add(&mut self, mesh: &TriangleMesh) -> Result<(), LodError> {
        self.meshes.push(MeshForms::build(mesh)?);
        Ok(())
    }

    /// The coarsest form of a mesh that is off by `error` at most, in the mesh's own units, and by how much it is; `None` for all of it.
    pub fn within(&self, mesh: u32, error: f64) -> Option<(&[[u32; 3]], f64)> {
        let forms = &self.meshes[mesh as usize];
        let last = forms.details.iter().rposition(|d| d.error <= error)?;
        Some((&forms.triangles[last], forms.details[last].error))
    }

    /// What the planner is told of a mesh's forms; errors in the mesh's own units.
    pub fn details(&self, mesh: u32) -> &[Detail] {
        &self.meshes[mesh as usize].details
    }

    /// The triangles of a form.
    pub fn triangles(&self, mesh: u32, detail: u32) -> &[[u32; 3]] {
        &self.meshes[mesh as usize].triangles[detail as usize]
    }

    /// Number of forms, and of their triangles.
    pub fn count(&self) -> (usize, usize) {
        let forms = self.meshes.iter().flat_map(|m| &m.triangles);
        forms.fold((0, 0), |(n, t), form| (n + 1, t + form.len()))
    }
}

impl MeshForms {
    fn build(mesh: &TriangleMesh) -> Result<Self, LodError> {
        let hierarchy = match VertexHierarchy::build(mesh) {
            Err(LodError::NoTriangle) => return Ok(Self::default()),
            other => other?,
        };
        // From far enough away all of the mesh is at the same distance, and an angle is a length.
        let far = hierarchy.radius() * 1e6;
        let observer = Observer::in_object(mesh.bounds().center().as_dvec3() + DVec3::X * far);
        let mut cut = Cut::new(&hierarchy);
        let mut forms = Self::default();
        let mut least = mesh.triangles().len();
        for i in 0..FORMS {
            let error = hierarchy.radius() * FINEST * STEP.powi(i);
            cut.update(&hierarchy, &observer, &Tolerance::uniform(error / far))?;
            let triangles = cut.triangles();
            // A form that saves less than a fifth is not worth a switch.
            if triangles.is_empty() || triangles.len() * 5 > least * 4 {
                continue;
            }
            least = triangles.len();
            // Distances to the eye vary by a millionth.
            let (error, elements) = (error * (1.0 + 1e-5), least as f64);
            forms.details.push(Detail { form: Form::Cut, error, kind: Kind::Proven, elements });
            forms.triangles.push(triangles.to_vec());
        }
        Ok(forms)
    }
}
