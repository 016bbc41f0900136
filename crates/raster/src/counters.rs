//! What a draw call did.

use std::ops::AddAssign;

/// Work done. Equal for equal input, so tests may compare it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Counters {
    /// Draw calls.
    pub draws: u64,
    /// Vertices transformed: every vertex of a draw once.
    pub vertices: u64,
    /// Triangles given.
    pub triangles: u64,
    /// Triangles beyond one side of the view volume.
    pub outside: u64,
    /// Triangles turned away, or without area after snapping.
    pub culled: u64,
    /// Triangles that had to be clipped.
    pub clipped: u64,
    /// Triangles that covered at least one row of samples (pieces of a clipped one count once).
    pub drawn: u64,
    /// Pixels covered, before the depth test.
    pub pixels_tested: u64,
    /// Pixels that passed all tests.
    pub pixels_written: u64,
    /// Points drawn.
    pub points: u64,
    /// Lines drawn.
    pub lines: u64,
    /// Instances of a scene given.
    pub instances: u64,
    /// Instances of a scene drawn.
    pub instances_drawn: u64,
}

impl AddAssign for Counters {
    fn add_assign(&mut self, o: Self) {
        self.draws += o.draws;
        self.vertices += o.vertices;
        self.triangles += o.triangles;
        self.outside += o.outside;
        self.culled += o.culled;
        self.clipped += o.clipped;
        self.drawn += o.drawn;
        self.pixels_tested += o.pixels_tested;
        self.pixels_written += o.pixels_written;
        self.points += o.points;
        self.lines += o.lines;
        self.instances += o.instances;
        self.instances_drawn += o.instances_drawn;
    }
}
