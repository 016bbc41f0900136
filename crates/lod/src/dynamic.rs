//! Geometry that changes: versions that a script switches between, and meshes that are edited while they are drawn.

use crate::{LodError, VertexHierarchy};
use farsight_geometry::TriangleMesh;
use std::sync::Arc;
use std::thread::JoinHandle;

/// A mesh and the hierarchy over it.
#[derive(Clone, Debug)]
pub struct Version {
    /// The mesh, with [seam vertices](VertexHierarchy::with_seam_vertices) if it has texture coordinates: what the indices of a cut lead into.
    pub mesh: Arc<TriangleMesh>,
    /// Its hierarchy.
    pub hierarchy: Arc<VertexHierarchy>,
}

impl Version {
    /// Builds the hierarchy, a textured one for a mesh with texture coordinates.
    ///
    /// # Errors
    /// As [`VertexHierarchy::build`].
    pub fn build(mesh: &TriangleMesh) -> Result<Self, LodError> {
        let hierarchy = match mesh.uvs() {
            Some(_) => VertexHierarchy::build_textured(mesh)?,
            None => VertexHierarchy::build(mesh)?,
        };
        let mesh = hierarchy.with_seam_vertices(mesh).map_err(|_| LodError::Attributes)?;
        Ok(Self { mesh: Arc::new(mesh), hierarchy: Arc::new(hierarchy) })
    }
}

/// An object whose shape a script changes: several versions, of which one is shown at a time.
///
/// The number of the version goes into the [`Key`](crate::Key) of its approximations, so those of the others stay in the cache until it needs
/// their room. Each version has cuts of its own.
///
/// ```
/// use farsight_lod::{Switch, Version};
/// use farsight_lod::{farsight_geometry::TriangleMesh, glam::Vec3};
///
/// let wing = |up: f32| {
///     TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1.0, up)], vec![[0, 1, 2]]).unwrap()
/// };
/// let versions = [0.0, 0.4, 0.8].map(|up| Version::build(&wing(up)));
/// let mut bird = Switch::new(versions.into_iter().collect::<Result<_, _>>()?)?;
/// let beat = |seconds: f64| (4.0 * seconds) as usize;
/// assert!(bird.select(beat(0.3)) && bird.selected() == 1);
/// assert!(!bird.select(beat(0.4)), "no change");
/// # Ok::<(), farsight_lod::LodError>(())
/// ```
///
/// # References
/// [Hilbert & Brunnett 2004, section 6], the selection node.
#[derive(Clone, Debug)]
pub struct Switch {
    versions: Vec<Version>,
    selected: usize,
}

impl Switch {
    /// A switch over some versions; shows the first.
    ///
    /// # Errors
    /// [`LodError::NoTriangle`] without a version.
    pub fn new(versions: Vec<Version>) -> Result<Self, LodError> {
        if versions.is_empty() {
            return Err(LodError::NoTriangle);
        }
        Ok(Self { versions, selected: 0 })
    }

    /// Shows a version, counted around: the one after the last is the first. Whether that changes anything.
    pub fn select(&mut self, version: usize) -> bool {
        let before = std::mem::replace(&mut self.selected, version % self.versions.len());
        before != self.selected
    }

    /// Which version is shown.
    pub fn selected(&self) -> usize {
        self.selected
    }

    /// The version that is shown.
    pub fn version(&self) -> &Version {
        &self.versions[self.selected]
    }

    /// All of them.
    pub fn versions(&self) -> &[Version] {
        &self.versions
    }
}

/// An object that is edited at run time: it is drawn from the old hierarchy until a thread has built the new one.
///
/// Edits that come in while one is built replace each other: only the latest is built next.
///
/// ```
/// use farsight_lod::{Editable, farsight_geometry::TriangleMesh, glam::Vec3};
///
/// let mesh = |x: f32| TriangleMesh::new(vec![Vec3::ZERO, Vec3::X * x, Vec3::Y], vec![[0, 1, 2]]).unwrap();
/// let mut clay = Editable::new(&mesh(1.0))?;
/// clay.edit(mesh(2.0));
/// // Every frame: is it ready? Then cuts are made anew, and cached approximations of older versions dropped.
/// while clay.poll()?.is_none() { std::thread::yield_now(); }
/// assert_eq!(clay.number(), 1);
/// # Ok::<(), farsight_lod::LodError>(())
/// ```
///
/// # References
/// [Hilbert & Brunnett 2004, section 6], where it is left to further studies.
#[derive(Debug)]
pub struct Editable {
    version: Version,
    number: u32,
    building: Option<JoinHandle<Result<Version, LodError>>>,
    /// The latest edit that waits for the one being built.
    waiting: Option<TriangleMesh>,
}

impl Editable {
    /// Builds the first version, here and now.
    ///
    /// # Errors
    /// As [`VertexHierarchy::build`].
    pub fn new(mesh: &TriangleMesh) -> Result<Self, LodError> {
        Ok(Self { version: Version::build(mesh)?, number: 0, building: None, waiting: None })
    }

    /// What is drawn now.
    pub fn version(&self) -> &Version {
        &self.version
    }

    /// How many edits have arrived: the number of the version for [`Key`](crate::Key).
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Whether an edit has not arrived yet.
    pub fn is_pending(&self) -> bool {
        self.building.is_some() || self.waiting.is_some()
    }

    /// Takes an edited mesh; a thread builds its hierarchy.
    pub fn edit(&mut self, mesh: TriangleMesh) {
        self.waiting = Some(mesh);
        self.start();
    }

    /// Looks whether a new version is ready, and if so draws it from now on; its number. Never waits.
    ///
    /// When that happens, make new cuts of the hierarchy and call [`Approximations::keep_version`](crate::Approximations::keep_version).
    ///
    /// # Errors
    /// That of the build, once; the old version stays.
    pub fn poll(&mut self) -> Result<Option<u32>, LodError> {
        if !self.building.as_ref().is_some_and(JoinHandle::is_finished) {
            return Ok(None);
        }
        let Some(thread) = self.building.take() else { return Ok(None) };
        let built = thread.join().unwrap_or(Err(LodError::Thread));
        self.start();
        self.version = built?;
        self.number += 1;
        Ok(Some(self.number))
    }

    fn start(&mut self) {
        if self.building.is_some() {
            return;
        }
        if let Some(mesh) = self.waiting.take() {
            self.building = Some(std::thread::spawn(move || Version::build(&mesh)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Cut, Observer, Tolerance};
    use farsight_geometry::hard_cases;
    use glam::{DVec3, Vec2, Vec3};

    fn wait(editable: &mut Editable) -> Result<u32, LodError> {
        loop {
            if let Some(number) = editable.poll()? {
                return Ok(number);
            }
            std::thread::yield_now();
        }
    }

    #[test]
    fn the_old_version_is_drawn_until_the_new_one_is_there() {
        let mut object = Editable::new(&hard_cases::bumpy_ball(3)).unwrap();
        let before = Arc::clone(&object.version().hierarchy);
        object.edit(hard_cases::bumpy_ball(60));
        assert!(object.is_pending());
        let mut frames = 0;
        loop {
            let mut cut = Cut::new(&object.version().hierarchy);
            cut.update(
                &object.version().hierarchy,
                &Observer::in_object(DVec3::X * 3.0),
                &Tolerance::uniform(0.01),
            )
            .unwrap();
            let vertices = object.version().mesh.positions().len() as u32;
            assert!(cut.indices().iter().all(|&v| v < vertices), "indices and vertices belong together");
            assert_eq!(object.number() == 0, Arc::ptr_eq(&before, &object.version().hierarchy));
            frames += 1;
            if object.poll().unwrap().is_some() {
                break;
            }
        }
        println!("{frames} frames were drawn from the old hierarchy");
        assert_eq!((object.number(), object.is_pending()), (1, false));
        assert_eq!(object.version().hierarchy.triangle_count(), 12 * 60 * 60);
    }

    #[test]
    fn of_edits_that_wait_the_latest_counts_and_bad_ones_change_nothing() {
        let mut object = Editable::new(&hard_cases::bumpy_ball(3)).unwrap();
        object.edit(hard_cases::bumpy_ball(40));
        (4..9).for_each(|n| object.edit(hard_cases::bumpy_ball(n)));
        assert_eq!((wait(&mut object), wait(&mut object)), (Ok(1), Ok(2)));
        assert_eq!(object.version().hierarchy.triangle_count(), 12 * 64);
        assert!(!object.is_pending() && object.poll() == Ok(None));

        object.edit(TriangleMesh::default());
        assert_eq!(wait(&mut object), Err(LodError::NoTriangle));
        assert_eq!((object.number(), object.is_pending()), (2, false));
        object.edit(hard_cases::bumpy_ball(5));
        assert_eq!(wait(&mut object), Ok(3), "a bad edit does not stop later ones");
    }

    #[test]
    fn textured_versions_bring_their_seam_vertices() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
        let mesh = TriangleMesh::new(corners.repeat(2), vec![[0, 1, 2], [5, 7, 6]]).unwrap();
        let mesh = mesh.with_uvs((0..8).map(|i| Vec2::splat(i as f32)).collect()).unwrap();
        let version = Version::build(&mesh).unwrap();
        let seams = version.hierarchy.seam_vertices().len();
        assert_eq!(version.mesh.positions().len(), mesh.positions().len() + seams);
        assert_eq!(Switch::new(vec![]).unwrap_err(), LodError::NoTriangle);
        let mut switch = Switch::new(vec![version.clone(), version]).unwrap();
        assert!(switch.select(5) && switch.selected() == 1 && !switch.select(7));
    }
}
