//! Large surfaces as hierarchies on disk: each of one instance, in world coordinates, for what is seen and for what throws shadows.

use farsight_geometry::glam::{DMat3, Vec3};
use farsight_geometry::scene::{AlphaMode, Instance};
use farsight_geometry::{MeshError, Scene, TriangleMesh};
use farsight_hlod::{BuildOptions, HlodError, Mesh, Progress, Store, Tier, build};
use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Fewer triangles are sooner drawn than chosen among.
const LEAST_TRIANGLES: usize = 20_000;
/// Most triangles that hierarchies are built of, without attributes and with: more would keep a tour waiting.
const MOST_BARE: usize = 1_000_000;
const MOST_WITH_LOOKS: usize = 60_000;
/// And longest that it may take, whatever they are.
const LONGEST: Duration = Duration::from_secs(20);

/// A hierarchy of an instance.
pub struct Surface {
    pub instance: u32,
    pub store: Arc<Store>,
    /// Whether it has an inside, so that nobody outside sees the back of a triangle.
    pub closed: bool,
}

/// Builds hierarchies of the largest instances of a scene into `folder`, as many as a tour can wait for; and tells why others have none, if there are any.
pub fn build_all(scene: &Scene, folder: &Path) -> Result<(Vec<Surface>, Option<String>), Box<dyn Error>> {
    let size = |i: u32| scene.mesh_of(&scene.instances()[i as usize]).triangles().len();
    let mut large: Vec<u32> =
        (0..scene.instances().len() as u32).filter(|&i| size(i) >= LEAST_TRIANGLES).collect();
    large.sort_by_key(|&i| std::cmp::Reverse(size(i)));
    let (mut surfaces, mut holes, mut many) = (Vec::new(), 0, 0);
    let (mut left, start) = ([MOST_BARE, MOST_WITH_LOOKS], Instant::now());
    for i in large {
        let instance = &scene.instances()[i as usize];
        if instance.material.is_some_and(|m| scene.materials()[m.0 as usize].alpha != AlphaMode::Opaque) {
            holes += 1;
            continue;
        }
        let mesh = placed(scene, instance)?;
        let looks = mesh.normals().is_some() || mesh.uvs().is_some() || mesh.colours().is_some();
        let left = &mut left[usize::from(looks)];
        if mesh.triangles().len() > *left {
            many += 1;
            continue;
        }
        *left -= mesh.triangles().len();
        match Surface::build(i, &mesh, looks, &folder.join(format!("surface_{i}.hlod")), start)? {
            Some(surface) => surfaces.push(surface),
            None => many += 1,
        }
    }
    surfaces.sort_by_key(|s| s.instance);
    let why = (holes + many > 0).then(|| {
        let most = format!("{MOST_BARE} triangles, {MOST_WITH_LOOKS} with looks, {} s", LONGEST.as_secs());
        let large = holes + many;
        format!("no hierarchy of {large} large surfaces: {holes} have holes, {many} would keep the tour waiting (at most {most})")
    });
    Ok((surfaces, why))
}

impl Surface {
    /// Builds the hierarchy of a mesh; `None` when there is no time left of what began at `start`.
    fn build(
        instance: u32,
        mesh: &TriangleMesh,
        looks: bool,
        path: &Path,
        start: Instant,
    ) -> Result<Option<Self>, Box<dyn Error>> {
        let options = BuildOptions::default().with_appearance(looks).with_tier(Tier::Verified);
        let in_time = |_: Progress| {
            if start.elapsed() > LONGEST { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        match build([Ok::<_, HlodError>(mesh)], path, &options, &in_time) {
            Err(HlodError::Cancelled) => return Ok(None),
            other => other?,
        };
        let store = Arc::new(Store::open(path)?);
        Ok(Some(Self { instance, store, closed: mesh.report().is_closed() && volume(mesh) > 0.0 }))
    }
}

/// What hierarchies there are, in words.
pub fn text(surfaces: &[Surface]) -> String {
    let sum = |of: fn(&Store) -> u64| surfaces.iter().map(|s| of(&s.store)).sum::<u64>();
    let in_root = |s: &Store| s.tree().root().map_or(0, |r| s.tree().triangles(r, Mesh::Full).into());
    format!(
        "{} hierarchies of what is large, for what is seen and for its shadows: {} triangles in {} nodes, {} in the roots, errors proven",
        surfaces.len(),
        sum(|s| s.tree().input_triangles()),
        sum(|s| s.tree().ids().len() as u64),
        sum(in_root)
    )
}

/// An instance's mesh where it is placed, with the attributes that show.
fn placed(scene: &Scene, instance: &Instance) -> Result<TriangleMesh, MeshError> {
    let mesh = scene.mesh_of(instance);
    let place = &instance.world_from_mesh;
    let positions: Vec<_> =
        mesh.positions().iter().map(|p| place.transform_point3(mesh.origin() + p.as_dvec3())).collect();
    let mirrored = place.matrix3.determinant() < 0.0;
    let turned = |t: &[u32; 3]| if mirrored { [t[0], t[2], t[1]] } else { *t };
    let mut out = TriangleMesh::from_world(&positions, mesh.triangles().iter().map(turned).collect())?;
    if let Some(normals) = mesh.normals() {
        let matrix: DMat3 = place.matrix3.inverse().transpose();
        let turn = |n: &Vec3| (matrix * n.as_dvec3()).normalize_or_zero().as_vec3();
        out = out.with_normals(normals.iter().map(turn).collect())?;
    }
    let textured = instance.material.is_some_and(|m| scene.materials()[m.0 as usize].texture.is_some());
    if let Some(uvs) = mesh.uvs().filter(|_| textured) {
        out = out.with_uvs(uvs.to_vec())?;
    }
    if let Some(colours) = mesh.colours() {
        out = out.with_colours(colours.to_vec())?;
    }
    Ok(out)
}

/// Volume of what a closed surface encloses; negative where its backs show.
fn volume(mesh: &TriangleMesh) -> f64 {
    let middle = mesh.bounds().center().as_dvec3();
    let corners = mesh.corner_iter().map(|t| t.map(|p| p.as_dvec3() - middle));
    corners.map(|[a, b, c]| a.dot(b.cross(c))).sum::<f64>() / 6.0
}
