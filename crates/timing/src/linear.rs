//! Least squares with few unknowns that cannot be negative.
//!
//! Everything works on the Gram matrix AᵀA and the vector Aᵀb, which stay as small as the number of unknowns however many
//! observations there are. Columns are scaled to the same size first, so that triangles and bytes do not drown each other.

/// AᵀA and Aᵀb.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Normal<const N: usize> {
    pub(crate) gram: [[f64; N]; N],
    pub(crate) right: [f64; N],
}

impl<const N: usize> Normal<N> {
    pub(crate) const ZERO: Self = Self { gram: [[0.0; N]; N], right: [0.0; N] };

    /// Adds an observation with a weight.
    pub(crate) fn add(&mut self, row: &[f64; N], value: f64, weight: f64) {
        for i in 0..N {
            for j in 0..N {
                self.gram[i][j] += weight * row[i] * row[j];
            }
            self.right[i] += weight * row[i] * value;
        }
    }

    /// Lets all observations count less.
    pub(crate) fn fade(&mut self, factor: f64) {
        self.gram.iter_mut().flatten().for_each(|g| *g *= factor);
        self.right.iter_mut().for_each(|r| *r *= factor);
    }

    /// The non-negative minimiser, by active sets (Lawson & Hanson 1974).
    ///
    /// Unknowns whose column is (almost) a combination of others stay zero.
    pub(crate) fn solve(&self) -> [f64; N] {
        let scale = self.scale();
        let mut free = [false; N];
        let mut x = [0.0; N];
        // Each round frees one unknown or ends; an unknown is bound again at most N times a round.
        for _ in 0..3 * N {
            let Some(next) = self.steepest(&x, &free, &scale) else { break };
            free[next] = true;
            for _ in 0..=N {
                let Some(candidate) = self.solve_free(&free, &scale) else {
                    free[next] = false;
                    break;
                };
                let negative = (0..N).filter(|&i| free[i] && candidate[i] <= 0.0);
                // Go towards the candidate until the first unknown becomes zero.
                let first = negative
                    .map(|i| (x[i] / (x[i] - candidate[i]), i))
                    .fold(None, |best: Option<(f64, usize)>, v| {
                        Some(best.map_or(v, |b| if v.0 < b.0 { v } else { b }))
                    });
                let Some((step, bound)) = first else {
                    x = candidate;
                    break;
                };
                for i in 0..N {
                    x[i] += step.clamp(0.0, 1.0) * (candidate[i] - x[i]);
                }
                (x[bound], free[bound]) = (0.0, false);
            }
        }
        x
    }

    fn scale(&self) -> [f64; N] {
        std::array::from_fn(|i| if self.gram[i][i] > 0.0 { self.gram[i][i].sqrt() } else { 0.0 })
    }

    /// The bound unknown along which the error falls most, if it falls at all.
    fn steepest(&self, x: &[f64; N], free: &[bool; N], scale: &[f64; N]) -> Option<usize> {
        let slope = |i: usize| {
            let predicted: f64 = (0..N).map(|j| self.gram[i][j] * x[j]).sum();
            (self.right[i] - predicted) / scale[i]
        };
        // A fall below rounding of the right-hand side is none.
        let least = |i: usize| 1e-12 * (self.right[i].abs() / scale[i]).max(f64::MIN_POSITIVE);
        (0..N)
            .filter(|&i| !free[i] && scale[i] > 0.0 && slope(i) > least(i))
            .max_by(|&i, &j| slope(i).total_cmp(&slope(j)))
    }

    /// Least squares over the free unknowns by Cholesky; `None` when their columns are dependent.
    fn solve_free(&self, free: &[bool; N], scale: &[f64; N]) -> Option<[f64; N]> {
        let mut l = [[0.0; N]; N];
        let mut y = [0.0; N];
        for i in (0..N).filter(|&i| free[i]) {
            for j in (0..=i).filter(|&j| free[j]) {
                let mut sum = self.gram[i][j] / (scale[i] * scale[j]);
                for k in (0..j).filter(|&k| free[k]) {
                    sum -= l[i][k] * l[j][k];
                }
                if i == j {
                    if sum <= DEPENDENT {
                        return None;
                    }
                    l[i][i] = sum.sqrt();
                } else {
                    l[i][j] = sum / l[j][j];
                }
            }
            let below: f64 = (0..i).filter(|&k| free[k]).map(|k| l[i][k] * y[k]).sum();
            y[i] = (self.right[i] / scale[i] - below) / l[i][i];
        }
        let mut x = [0.0; N];
        for i in (0..N).rev().filter(|&i| free[i]) {
            let above: f64 = (i + 1..N).filter(|&k| free[k]).map(|k| l[k][i] * x[k]).sum();
            x[i] = (y[i] - above) / l[i][i];
        }
        Some(std::array::from_fn(|i| if free[i] { x[i] / scale[i] } else { 0.0 }))
    }

    /// Share of column `i` that no combination of the other columns explains: 1 when independent, 0 when dependent.
    pub(crate) fn independence(&self, i: usize) -> f64 {
        let scale = self.scale();
        if scale[i] == 0.0 {
            return 0.0;
        }
        // The last pivot of a Cholesky factorisation with this column last is what is left of it.
        let mut order: Vec<usize> = (0..N).filter(|&j| j != i && scale[j] > 0.0).collect();
        order.push(i);
        let mut l = [[0.0; N]; N];
        let mut left = 0.0;
        for (a, &i) in order.iter().enumerate() {
            for (b, &j) in order[..=a].iter().enumerate() {
                let known: f64 = (0..b).map(|k| l[a][k] * l[b][k]).sum();
                let sum = self.gram[i][j] / (scale[i] * scale[j]) - known;
                if a == b {
                    left = sum.max(0.0);
                    l[a][a] = left.max(DEPENDENT).sqrt();
                } else {
                    l[a][b] = sum / l[b][b];
                }
            }
        }
        left
    }
}

/// Relative squared length below which what is left of a column is rounding.
const DEPENDENT: f64 = 1e-10;

#[cfg(test)]
mod tests {
    use super::*;

    fn normal_of<const N: usize>(rows: &[([f64; N], f64)]) -> Normal<N> {
        let mut normal = Normal::ZERO;
        rows.iter().for_each(|(row, value)| normal.add(row, *value, 1.0));
        normal
    }

    /// Least error over a grid of non-negative coefficients, the obvious slow way.
    fn error(rows: &[([f64; 2], f64)], x: [f64; 2]) -> f64 {
        rows.iter().map(|(r, v)| (r[0] * x[0] + r[1] * x[1] - v).powi(2)).sum()
    }

    #[test]
    fn exact_data_gives_exact_coefficients_at_any_scale() {
        let rows: Vec<_> = (0..40)
            .map(|i| {
                let t = f64::from(i);
                let row = [1.0, 1e6 * (1.0 + (t * 0.7).sin()), 1e-3 * (t * 1.3).cos().abs()];
                (row, 0.5 * row[0] + 3e-6 * row[1] + 200.0 * row[2])
            })
            .collect();
        let x = normal_of(&rows).solve();
        for (got, expected) in x.iter().zip([0.5, 3e-6, 200.0]) {
            assert!((got / expected - 1.0).abs() < 1e-6, "{x:?}");
        }
    }

    #[test]
    fn negative_solutions_are_cut_off_at_the_best_non_negative_one() {
        for case in 0..50 {
            let rows: Vec<_> = (0..12)
                .map(|i| {
                    let t = f64::from(i + 100 * case);
                    ([(t * 1.1).sin(), (t * 2.3).cos()], (t * 0.37).sin() - 0.2)
                })
                .collect();
            let x = normal_of(&rows).solve();
            assert!(x.iter().all(|&v| v >= 0.0));
            let best = error(&rows, x);
            for i in 0..60 {
                for j in 0..60 {
                    let grid = error(&rows, [f64::from(i) * 0.05, f64::from(j) * 0.05]);
                    assert!(best <= grid + 1e-9, "case {case}: {x:?} {best} {grid}");
                }
            }
        }
    }

    #[test]
    fn dependent_columns_are_seen_and_do_not_break_the_solution() {
        let rows: Vec<_> =
            (1..20).map(|i| ([f64::from(i), 2.0 * f64::from(i), 1.0], 6.0 * f64::from(i) + 1.0)).collect();
        let normal = normal_of(&rows);
        assert!(
            normal.independence(0) < 1e-9 && normal.independence(1) < 1e-9 && normal.independence(2) > 0.1
        );
        let x = normal.solve();
        assert!((x[0] + 2.0 * x[1] - 6.0).abs() < 1e-6 && (x[2] - 1.0).abs() < 1e-5, "{x:?}");
        assert_eq!(Normal::<3>::ZERO.solve(), [0.0; 3]);
    }
}
