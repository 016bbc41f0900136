//! What hangs together.

/// Numbers in sets that are joined: parts of a mesh, charts of a texture.
///
/// ```
/// use farsight_geometry::mesh::DisjointSets;
///
/// let mut sets = DisjointSets::new(5);
/// sets.join(4, 1);
/// sets.join(3, 4);
/// assert_eq!([0, 1, 2, 3, 4].map(|n| sets.lowest(n)), [0, 1, 2, 1, 1]);
/// ```
#[derive(Clone, Debug)]
pub struct DisjointSets {
    /// A lower number of the same set; the lowest has itself.
    lower: Vec<u32>,
}

impl DisjointSets {
    /// The numbers below `count`, each in a set of its own.
    pub fn new(count: usize) -> Self {
        Self { lower: (0..count as u32).collect() }
    }

    /// The lowest number of a number's set.
    ///
    /// # Cost
    /// Nearly constant: ways are halved as they are gone.
    ///
    /// # Panics
    /// When there is no such number.
    pub fn lowest(&mut self, mut number: u32) -> u32 {
        while self.lower[number as usize] != number {
            self.lower[number as usize] = self.lower[self.lower[number as usize] as usize];
            number = self.lower[number as usize];
        }
        number
    }

    /// Joins the sets of two numbers.
    ///
    /// # Panics
    /// When there is no such number.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.lowest(a), self.lowest(b));
        self.lower[a.max(b) as usize] = a.min(b);
    }
}
