//! How many vertices a graphics card transforms: a first-in-first-out cache over the index list.

use crate::TimingError;

/// Counts the vertices that miss a first-in-first-out cache of `size` entries: those that are really transformed.
///
/// # Cost
/// Linear in the indices, 4 bytes a vertex while it runs.
///
/// # Errors
/// [`TimingError::Index`] when an index is not below `vertices`.
pub fn transformed_vertices(indices: &[u32], vertices: usize, size: u32) -> Result<u64, TimingError> {
    // A vertex is in the cache exactly while fewer than `size` others have entered since it did.
    let mut entered = vec![0u32; vertices];
    let mut now = size + 1;
    let mut misses = 0u64;
    for (position, &index) in indices.iter().enumerate() {
        let at = entered.get_mut(index as usize).ok_or(TimingError::Index { position, index, vertices })?;
        if now - *at > size {
            *at = now;
            now += 1;
            misses += 1;
            if now == u32::MAX {
                forget(&mut entered, &mut now, size);
            }
        }
    }
    Ok(misses)
}

/// Moves all times back so that counting can go on; what left the cache long ago stays out.
fn forget(entered: &mut [u32], now: &mut u32, size: u32) {
    let back = *now - (size + 1) - size;
    entered.iter_mut().for_each(|t| *t = t.saturating_sub(back));
    *now -= back;
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    /// The cache itself.
    fn by_queue(indices: &[u32], size: usize) -> u64 {
        let mut queue = VecDeque::new();
        let mut misses = 0;
        for i in indices {
            if !queue.contains(i) {
                misses += 1;
                queue.push_back(*i);
                if queue.len() > size {
                    queue.pop_front();
                }
            }
        }
        misses
    }

    #[test]
    fn counts_equal_a_queue_at_every_size() {
        let mut seed = 9u64;
        let indices: Vec<u32> = (0..30_000)
            .map(|i| {
                seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (i / 60 + (seed >> 33) as u32 % 40) % 500
            })
            .collect();
        for size in [0, 1, 2, 3, 16, 24, 32, 499, 1000] {
            assert_eq!(
                transformed_vertices(&indices, 500, size).unwrap(),
                by_queue(&indices, size as usize),
                "{size}"
            );
        }
    }

    #[test]
    fn a_strip_transforms_every_vertex_once() {
        let indices: Vec<u32> = (0..100).flat_map(|i| [i, i + 1, i + 2]).collect();
        assert_eq!(transformed_vertices(&indices, 102, 16).unwrap(), 102);
    }

    #[test]
    fn forgetting_keeps_what_is_in_the_cache() {
        let size = 4;
        let (mut entered, mut now) = (vec![0, 90, 97, 99], 100);
        let inside = |entered: &[u32], now: u32| entered.iter().map(|&t| now - t <= size).collect::<Vec<_>>();
        let before = inside(&entered, now);
        forget(&mut entered, &mut now, size);
        assert!(now < 20 && inside(&entered, now) == before);
    }

    #[test]
    fn an_index_out_of_range_is_named() {
        let error = transformed_vertices(&[0, 1, 7], 3, 16).unwrap_err();
        assert_eq!(error.to_string(), "index 2 names vertex 7, but there are 3 vertices");
    }
}
