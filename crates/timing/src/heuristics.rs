//! The four heuristics of Wimmer 2007, chapter 2, and an extended one: what a drawing takes, from its features.

use crate::{Features, Millis};

/// Which features count, and how they combine (Wimmer 2007, 2.4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Heuristic {
    /// H1: triangles.
    Triangles,
    /// H2: vertices really transformed.
    Vertices,
    /// H3 (Funkhouser & Séquin 1993): the slower of geometry and pixels.
    Max,
    /// H4: vertices and pixels added up.
    Sum,
    /// H4 with draw calls and triangles as well.
    Extended,
}

/// Most terms of a heuristic.
pub const TERMS: usize = 4;

impl Heuristic {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Triangles, Self::Vertices, Self::Max, Self::Sum, Self::Extended];

    /// The features that count; unused terms are zero.
    pub fn terms(self, f: &Features) -> [f64; TERMS] {
        match self {
            Heuristic::Triangles => [f.triangles, 0.0, 0.0, 0.0],
            Heuristic::Vertices => [f.vertices, 0.0, 0.0, 0.0],
            Heuristic::Max | Heuristic::Sum => [f.vertices, f.pixels, 0.0, 0.0],
            Heuristic::Extended => [f.vertices, f.pixels, f.draws, f.triangles],
        }
    }

    /// Names of the terms.
    pub fn term_names(self) -> &'static [&'static str] {
        match self {
            Heuristic::Triangles => &["triangles"],
            Heuristic::Vertices => &["vertices"],
            Heuristic::Max | Heuristic::Sum => &["vertices", "pixels"],
            Heuristic::Extended => &["vertices", "pixels", "draws", "triangles"],
        }
    }
}

impl std::fmt::Display for Heuristic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Heuristic::Triangles => "H1",
            Heuristic::Vertices => "H2",
            Heuristic::Max => "H3",
            Heuristic::Sum => "H4",
            Heuristic::Extended => "H4+",
        })
    }
}

/// A heuristic with the cost of each of its terms, in milliseconds a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    /// Which terms there are.
    pub heuristic: Heuristic,
    /// Cost of each; never negative.
    pub costs: [f64; TERMS],
}

impl Model {
    /// What an object takes, besides what the frame takes anyway.
    ///
    /// # Cost
    /// Some nanoseconds, no allocation.
    #[inline]
    pub fn predict(&self, features: &Features) -> Millis {
        let terms = self.heuristic.terms(features);
        let parts: [f64; TERMS] = std::array::from_fn(|i| terms[i] * self.costs[i]);
        Millis(match self.heuristic {
            Heuristic::Max => parts[0].max(parts[1]),
            _ => parts.iter().sum(),
        })
    }

    /// What a frame of objects takes: the sum over them.
    pub fn predict_frame(&self, objects: &[Features]) -> Millis {
        objects.iter().map(|f| self.predict(f)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heuristics_combine_as_they_say() {
        let f = Features { triangles: 10.0, vertices: 7.0, pixels: 100.0, draws: 1.0, ..Features::default() };
        let model = |heuristic, costs| Model { heuristic, costs }.predict(&f).0;
        assert_eq!(model(Heuristic::Triangles, [2.0, 9.0, 9.0, 9.0]), 20.0);
        assert_eq!(model(Heuristic::Vertices, [2.0, 9.0, 9.0, 9.0]), 14.0);
        assert_eq!(model(Heuristic::Max, [2.0, 0.1, 9.0, 9.0]), 14.0);
        assert_eq!(model(Heuristic::Max, [1.0, 0.1, 9.0, 9.0]), 10.0);
        assert_eq!(model(Heuristic::Sum, [2.0, 0.1, 9.0, 9.0]), 24.0);
        assert_eq!(model(Heuristic::Extended, [2.0, 0.1, 3.0, 1.0]), 37.0);
    }
}
