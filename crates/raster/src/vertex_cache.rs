//! How often a post-transform vertex cache misses. An oracle of its own, so that the estimate of the `timing` crate can be checked.

/// Counts the vertices that a first-in-first-out cache of `size` entries transforms for `triangles`, in order.
///
/// A hit does not renew an entry. With `size` 0 every corner counts.
///
/// # Cost
/// One pass; 8 bytes per vertex up to the largest index.
pub fn fifo_cache_misses(triangles: &[[u32; 3]], size: usize) -> u64 {
    let vertices = triangles.iter().flatten().max().map_or(0, |&v| v as usize + 1);
    // A vertex stays until `size` others have been loaded after it, so the number of its own load decides.
    const NEVER: u64 = u64::MAX;
    let mut loaded = vec![NEVER; vertices];
    let mut misses = 0;
    for &v in triangles.iter().flatten() {
        let at = &mut loaded[v as usize];
        if *at == NEVER || misses - *at > size as u64 {
            *at = misses;
            misses += 1;
        }
    }
    misses
}

#[cfg(test)]
mod tests {
    use super::fifo_cache_misses;
    use crate::Random;
    use std::collections::VecDeque;

    fn brute_force(triangles: &[[u32; 3]], size: usize) -> u64 {
        let mut cache = VecDeque::new();
        let mut misses = 0;
        for v in triangles.iter().flatten() {
            if !cache.contains(v) {
                misses += 1;
                cache.push_back(*v);
                if cache.len() > size {
                    cache.pop_front();
                }
            }
        }
        misses
    }

    #[test]
    fn agrees_with_a_queue_at_every_size() {
        let mut random = Random::new(5);
        for size in [0, 1, 2, 3, 16, 24, 32, 1000] {
            for spread in [3, 20, 60, 400] {
                // A wandering window of vertices has both hits and misses at every size.
                let triangles: Vec<[u32; 3]> = (0..500)
                    .map(|t| std::array::from_fn(|_| (t / 4 + random.below(spread)) as u32))
                    .collect();
                assert_eq!(
                    fifo_cache_misses(&triangles, size),
                    brute_force(&triangles, size),
                    "{size} {spread}"
                );
            }
        }
        assert_eq!(fifo_cache_misses(&[], 16), 0);
        // A strip reuses two of three corners.
        let strip: Vec<[u32; 3]> = (0..100).map(|i| [i, i + 1, i + 2]).collect();
        assert_eq!(fifo_cache_misses(&strip, 16), 102);
    }
}
