//! Which faces cover which original triangle, both ways.

use crate::original::NONE;

/// One pair of the relation.
#[derive(Clone, Copy, Debug)]
struct Claim {
    triangle: u32,
    face: u32,
    next_of_face: u32,
    next_of_triangle: u32,
}

/// The relation between original triangles and the faces that cover them: 16 bytes a pair.
#[derive(Clone, Debug)]
pub(crate) struct Claims {
    claims: Vec<Claim>,
    free: u32,
    of_face: Vec<u32>,
    of_triangle: Vec<u32>,
}

impl Claims {
    pub(crate) fn new(triangles: usize) -> Self {
        Self {
            claims: Vec::with_capacity(triangles + triangles / 4),
            free: NONE,
            of_face: vec![NONE; triangles],
            of_triangle: vec![NONE; triangles],
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of::<Claim>() * self.claims.capacity()
            + 4 * (self.of_face.capacity() + self.of_triangle.capacity())
    }

    pub(crate) fn add(&mut self, triangle: u32, face: u32) {
        let claim = Claim {
            triangle,
            face,
            next_of_face: self.of_face[face as usize],
            next_of_triangle: self.of_triangle[triangle as usize],
        };
        let at = if self.free == NONE {
            self.claims.push(claim);
            self.claims.len() as u32 - 1
        } else {
            let at = self.free;
            self.free = self.claims[at as usize].next_of_face;
            self.claims[at as usize] = claim;
            at
        };
        self.of_face[face as usize] = at;
        self.of_triangle[triangle as usize] = at;
    }

    pub(crate) fn faces_of(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        let mut at = self.of_triangle[triangle as usize];
        std::iter::from_fn(move || {
            let claim = self.claims.get(at as usize)?;
            at = claim.next_of_triangle;
            Some(claim.face)
        })
    }

    /// Triangles that a face helps to cover.
    pub(crate) fn triangles_of(&self, face: u32) -> impl Iterator<Item = u32> + '_ {
        let mut at = self.of_face[face as usize];
        std::iter::from_fn(move || {
            while let Some(claim) = self.claims.get(at as usize) {
                at = claim.next_of_face;
                if claim.triangle != NONE {
                    return Some(claim.triangle);
                }
            }
            None
        })
    }

    /// [`triangles_of`](Self::triangles_of), freeing what was released on the way.
    pub(crate) fn sweep(&mut self, face: u32, mut triangle: impl FnMut(u32)) {
        let mut before = NONE;
        let mut at = self.of_face[face as usize];
        while at != NONE {
            let claim = self.claims[at as usize];
            if claim.triangle == NONE {
                match before {
                    NONE => self.of_face[face as usize] = claim.next_of_face,
                    before => self.claims[before as usize].next_of_face = claim.next_of_face,
                }
                self.claims[at as usize].next_of_face = self.free;
                self.free = at;
            } else {
                triangle(claim.triangle);
                before = at;
            }
            at = claim.next_of_face;
        }
    }

    /// Forgets which faces cover `triangle`.
    pub(crate) fn release(&mut self, triangle: u32) {
        let mut at = std::mem::replace(&mut self.of_triangle[triangle as usize], NONE);
        while at != NONE {
            let claim = &mut self.claims[at as usize];
            at = claim.next_of_triangle;
            // Still in its face's list; freed when that is.
            claim.triangle = NONE;
        }
    }

    /// Frees the list of a face whose triangles were all released.
    pub(crate) fn clear_face(&mut self, face: u32) {
        let mut at = std::mem::replace(&mut self.of_face[face as usize], NONE);
        while at != NONE {
            let claim = &mut self.claims[at as usize];
            debug_assert_eq!(claim.triangle, NONE);
            let next = std::mem::replace(&mut claim.next_of_face, self.free);
            self.free = at;
            at = next;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_directions_agree_through_changes() {
        let mut c = Claims::new(4);
        for (t, f) in [(0, 1), (0, 2), (1, 2), (3, 2)] {
            c.add(t, f);
        }
        let sorted = |i: &mut dyn Iterator<Item = u32>| {
            let mut v: Vec<u32> = i.collect();
            v.sort_unstable();
            v
        };
        assert_eq!(sorted(&mut c.faces_of(0)), [1, 2]);
        assert_eq!(sorted(&mut c.triangles_of(2)), [0, 1, 3]);
        for t in [0, 1, 3] {
            c.release(t);
        }
        c.add(3, 2);
        let mut found = Vec::new();
        c.sweep(2, |t| found.push(t));
        assert_eq!((found, c.claims.len()), (vec![3], 5));
        c.release(3);
        c.clear_face(2);
        assert_eq!((c.triangles_of(2).count(), c.triangles_of(1).count()), (0, 0));
        c.add(0, 3);
        c.add(1, 3);
        assert_eq!(c.claims.len(), 5);
        assert_eq!((sorted(&mut c.triangles_of(3)), sorted(&mut c.faces_of(1))), (vec![0, 1], vec![3]));
    }
}
