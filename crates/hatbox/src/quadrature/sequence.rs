//! Scrambled low-discrepancy points in four dimensions, for integrands with jumps (shadows).
//!
//! Sobol' points with the direction numbers of S. Joe and F. Y. Kuo (SIAM J. Sci. Comput. 30, 2008) and nested uniform
//! scrambling by hashing (S. Laine, T. Karras, Computer Graphics Forum 30, 2011; B. Burley, JCGT 9, 2020). A point
//! depends on nothing but (seed, index): results are the same on any number of threads, and sets with different seeds
//! are independent estimates whose spread is the error.

/// Point `index` of the set scrambled with `seed`, in the unit hypercube \[0, 1)⁴.
pub fn point(seed: u64, index: u32) -> [f64; 4] {
    // A nested scramble of the index shuffles the order; any prefix of 2^k points stays well distributed.
    let index = scramble(index, hash(seed, 0) as u32);
    std::array::from_fn(|dimension| {
        let bits = scramble(sobol(index, dimension), hash(seed, dimension as u64 + 1) as u32);
        f64::from(bits) * 2f64.powi(-32)
    })
}

/// A well-mixed 64-bit number from a seed and a counter (the finalizer of SplitMix64).
pub fn hash(seed: u64, counter: u64) -> u64 {
    let mut z = seed.wrapping_add(counter.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A number from 0 to 1, without 1, from the upper bits of a hash.
pub fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 * 2_f64.powi(-53)
}

/// A net of nets: block b of 2^m points is a net by itself, and so is any aligned run of 2^k blocks together. The first two
/// dimensions, which fill every elementary interval, differ from block to block; the last two are those of block 0 in all
/// of them.
///
/// Unlike [`point`], the order within a block is not shuffled, so that the two halves of the dimensions stay in step.
#[derive(Debug)]
pub struct Blocks {
    /// The unscrambled first two dimensions of block 0.
    start: Vec<[u32; 2]>,
    seeds: [u32; 4],
}

impl Blocks {
    /// Blocks of so many points, a power of two.
    pub fn new(seed: u64, size: u32) -> Self {
        let start = (0..size).map(|k| [sobol(k, 0), sobol(k, 1)]).collect();
        Self { start, seeds: [1, 2, 3, 4].map(|k| hash(seed, k) as u32) }
    }

    /// The last two dimensions of point `index` of every block.
    pub fn last(&self, index: u32) -> [f64; 2] {
        [2, 3].map(|k| fraction(scramble(sobol(index, k), self.seeds[k])))
    }

    /// The first two dimensions of the points of a block.
    pub fn first(&self, block: u32) -> impl Iterator<Item = [f64; 2]> + '_ {
        let index = block.wrapping_mul(self.start.len() as u32);
        let shift = [sobol(index, 0), sobol(index, 1)];
        self.start.iter().map(move |d| [0, 1].map(|k| fraction(scramble(d[k] ^ shift[k], self.seeds[k]))))
    }
}

/// The middle of the interval that a fixed-point fraction stands for.
fn fraction(bits: u32) -> f64 {
    (f64::from(bits) + 0.5) * 2f64.powi(-32)
}

/// The Sobol' number as a 32-bit fixed-point fraction: the exclusive or of the direction numbers of the index's bits, a
/// byte at a time.
fn sobol(index: u32, dimension: usize) -> u32 {
    let table = &BYTES[dimension];
    index.to_le_bytes().iter().zip(table).fold(0, |x, (&byte, row)| x ^ row[usize::from(byte)])
}

/// Owen's nested uniform scrambling: each bit is flipped by a hash of the bits above it.
fn scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// The 32 direction numbers of each dimension; the first is van der Corput's sequence.
const DIRECTIONS: [[u32; 32]; 4] =
    [directions(0, 0, &[]), directions(1, 0, &[1]), directions(2, 1, &[1, 3]), directions(3, 1, &[1, 3, 1])];

/// For each dimension and byte of an index, what the byte contributes.
static BYTES: [[[u32; 256]; 4]; 4] = {
    let mut tables = [[[0; 256]; 4]; 4];
    let mut k = 0;
    while k < 4 * 4 * 256 * 8 {
        let (dimension, byte, value, bit) = (k >> 13, k >> 11 & 3, k >> 3 & 255, k & 7);
        if value >> bit & 1 == 1 {
            tables[dimension][byte][value] ^= DIRECTIONS[dimension][8 * byte + bit];
        }
        k += 1;
    }
    tables
};

/// Direction numbers from a primitive polynomial of degree s with inner coefficients a, and s initial numbers.
const fn directions(s: usize, a: u32, initial: &[u32]) -> [u32; 32] {
    let mut v = [0; 32];
    let mut i = 0;
    while i < 32 {
        v[i] = if s == 0 {
            1 << (31 - i)
        } else if i < s {
            initial[i] << (31 - i)
        } else {
            let mut next = v[i - s] ^ (v[i - s] >> s);
            let mut k = 1;
            while k < s {
                next ^= (a >> (s - 1 - k) & 1) * v[i - k];
                k += 1;
            }
            next
        };
        i += 1;
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A (t, m, s)-net property that scrambling keeps: 2^m points fall one into each of 2^m equal slices of any axis,
    /// and the first two dimensions fill every elementary interval.
    #[test]
    fn scrambled_points_are_stratified() {
        for seed in [0, 1, 99] {
            let points: Vec<_> = (0..64).map(|i| point(seed, i)).collect();
            for dimension in 0..4 {
                let mut slices: Vec<_> = points.iter().map(|p| (p[dimension] * 64.0) as usize).collect();
                slices.sort_unstable();
                assert_eq!(slices, (0..64).collect::<Vec<_>>(), "dimension {dimension}");
            }
            for split in 0..=6 {
                let (nx, ny) = (1usize << split, 64 >> split);
                let cell = |p: &[f64; 4]| (p[0] * nx as f64) as usize * ny + (p[1] * ny as f64) as usize;
                let mut cells: Vec<_> = points.iter().map(cell).collect();
                cells.sort_unstable();
                assert_eq!(cells, (0..64).collect::<Vec<_>>(), "split {split}");
            }
        }
    }

    /// Blocks by themselves and together fill every elementary interval of the first two dimensions.
    #[test]
    fn blocks_are_nets_alone_and_together() {
        let blocks = Blocks::new(3, 16);
        for run in [0..1, 5..6, 4..8, 8..16] {
            let points: Vec<_> = run.flat_map(|block| blocks.first(block).collect::<Vec<_>>()).collect();
            let bits = points.len().ilog2();
            for split in 0..=bits {
                let (nx, ny) = (1usize << split, 1usize << (bits - split));
                let cell = |p: &[f64; 2]| (p[0] * nx as f64) as usize * ny + (p[1] * ny as f64) as usize;
                let mut cells: Vec<_> = points.iter().map(cell).collect();
                cells.sort_unstable();
                assert_eq!(cells, (0..points.len()).collect::<Vec<_>>(), "{} points, split {split}", points.len());
            }
        }
    }

    #[test]
    fn seeds_give_different_sets_and_the_same_seed_the_same() {
        assert_eq!(point(7, 3), point(7, 3));
        assert_ne!(point(7, 3), point(8, 3));
    }

    #[test]
    fn a_smooth_integral_converges_faster_than_random() {
        let f = |p: [f64; 4]| p.iter().map(|x| 1.0 + (x - 0.5)).product::<f64>();
        let n = 1024;
        let mean: f64 = (0..n).map(|i| f(point(5, i))).sum::<f64>() / f64::from(n);
        // A random set would be off by about 0.6/√1024 = 0.02.
        assert!((mean - 1.0).abs() < 1e-3, "{mean}");
    }
}
