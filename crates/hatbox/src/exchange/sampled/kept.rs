//! What one chunk of cells yields when it is traced, and its bytes for whoever keeps them.
//!
//! Rays that were lost bring nothing and are most of them where the sky is wide, so that a bit says of each ray whether it
//! ended somewhere, and only those that did take 8 bytes: a terrain of 100 000 facets with 128 rays each, which would be
//! 103 MB, makes an operator of 21 MB (bench `scale`).

use super::lamps::Entry;
use super::rays::Hit;
use crate::element::MAX_DOFS;
use std::ops::Range;

/// Rays of one word.
const WORD: usize = u64::BITS as usize;

/// Where the rays of some cells ended, as many rays of each.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Hits {
    /// Words of each cell.
    words: usize,
    /// A bit for each ray: whether it ended somewhere.
    arrived: Vec<u64>,
    /// Where the hits of each cell begin, but for the first, and where they end.
    ends: Vec<u32>,
    all: Vec<Hit>,
}

/// The rays of one cell.
#[derive(Clone, Copy)]
pub(super) struct Ended<'a> {
    arrived: &'a [u64],
    hits: &'a [Hit],
}

impl Hits {
    /// Of no cell yet.
    pub(super) fn new(rays: u32) -> Self {
        Self { words: (rays as usize).div_ceil(WORD), ..Self::default() }
    }

    /// Bytes that a cell takes at the most.
    pub(super) fn most_bytes(rays: u32) -> usize {
        let words = (rays as usize).div_ceil(WORD);
        words * size_of::<u64>() + size_of::<u32>() + rays as usize * size_of::<Hit>()
    }

    /// Adds a cell.
    pub(super) fn push(&mut self, hits: &[Hit]) {
        for some in hits.chunks(WORD) {
            let bits = some.iter().enumerate().map(|(bit, hit)| u64::from(!hit.is_lost()) << bit);
            self.arrived.push(bits.fold(0, |word, bit| word | bit));
            self.all.extend(some.iter().filter(|hit| !hit.is_lost()));
        }
        self.arrived.resize(self.words * (self.ends.len() + 1), 0);
        self.ends.push(self.all.len() as u32);
    }

    pub(super) fn clear(&mut self) {
        self.arrived.clear();
        self.ends.clear();
        self.all.clear();
    }

    pub(super) fn shrink(&mut self) {
        self.arrived.shrink_to_fit();
        self.ends.shrink_to_fit();
        self.all.shrink_to_fit();
    }

    /// Whether there is a hit for each bit, cell by cell.
    fn is_consistent(&self) -> bool {
        let counts =
            |cell: usize| self.arrived[cell * self.words..(cell + 1) * self.words].iter().map(|w| w.count_ones());
        let ends = self.ends.iter().scan(0, |end, &next| Some(next.checked_sub(std::mem::replace(end, next))));
        self.arrived.len() == self.words * self.ends.len()
            && self.ends.last().copied().unwrap_or(0) as usize == self.all.len()
            && ends.enumerate().all(|(cell, count)| count == Some(counts(cell).sum()))
    }

    /// The rays of one cell.
    pub(super) fn of(&self, index: usize) -> Ended<'_> {
        let start = index.checked_sub(1).map_or(0, |before| self.ends[before]);
        Ended {
            arrived: &self.arrived[index * self.words..(index + 1) * self.words],
            hits: &self.all[start as usize..self.ends[index] as usize],
        }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.arrived) + size_of_val(&*self.ends) + size_of_val(&*self.all)
    }
}

impl<'a> Ended<'a> {
    /// The hits of some rays, 64 rays and fewer at a time: which rays they are (the first one's number, and a bit for each
    /// that has a hit), and their hits.
    pub(super) fn words(self, taken: Range<usize>) -> impl Iterator<Item = (usize, u64, &'a [Hit])> {
        let mut rest = self.hits;
        self.arrived[..taken.end.div_ceil(WORD)].iter().enumerate().filter_map(move |(word, &bits)| {
            let first = word * WORD;
            let (from, to) = (taken.start.saturating_sub(first).min(WORD), (taken.end - first).min(WORD));
            let below = |end: usize| if end == WORD { bits } else { bits & ((1 << end) - 1) };
            let skipped = below(from).count_ones() as usize;
            let chosen = below(to) & !below(from);
            let hits = &rest[skipped..skipped + chosen.count_ones() as usize];
            rest = &rest[bits.count_ones() as usize..];
            (chosen != 0).then_some((first, chosen, hits))
        })
    }
}

/// The numbers of the bits that are set, from the lowest on.
pub(super) fn set_bits(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lowest = (bits != 0).then(|| bits.trailing_zeros() as usize)?;
        bits &= bits - 1;
        Some(lowest)
    })
}

/// The rays of one chunk.
#[derive(Debug, PartialEq)]
pub(super) struct Traced {
    pub(super) hits: Hits,
    /// Where the entries of each cell begin, and the entries.
    pub(super) direct: (Vec<u32>, Vec<Entry>),
    pub(super) rays: u64,
    pub(super) area: f64,
    pub(super) lost: f64,
}

impl Traced {
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let ((first, entries), Hits { words, arrived, ends, all }) = (&self.direct, &self.hits);
        let lengths = [*words, arrived.len(), ends.len(), all.len(), first.len(), entries.len()];
        let numbers = [self.rays, self.area.to_bits(), self.lost.to_bits()];
        let mut bytes = Vec::with_capacity(72 + self.hits.bytes() + 4 * first.len() + size_of_val(&**entries));
        for number in lengths.into_iter().map(|length| length as u64).chain(numbers).chain(arrived.iter().copied()) {
            bytes.extend(number.to_le_bytes());
        }
        for number in ends.iter().chain(first) {
            bytes.extend(number.to_le_bytes());
        }
        for hit in all {
            bytes.extend(hit.to_bytes());
        }
        for entry in entries {
            bytes.extend(entry.lamp.to_le_bytes());
            for value in &entry.values {
                bytes.extend(value.to_le_bytes());
            }
        }
        bytes
    }

    /// What [`to_bytes`](Self::to_bytes) has made; `None` of anything else.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let mut reader = Reader(bytes);
        let mut lengths = [0; 6];
        for length in &mut lengths {
            *length = usize::try_from(reader.u64()?).ok()?;
        }
        let [words, arrived, ends, hits, first, entries] = lengths;
        let [rays, area, lost] = [reader.u64()?, reader.u64()?, reader.u64()?];
        let arrived = (0..arrived).map(|_| reader.u64()).collect::<Option<_>>()?;
        let ends = (0..ends).map(|_| reader.take().map(u32::from_le_bytes)).collect::<Option<_>>()?;
        let first = (0..first).map(|_| reader.take().map(u32::from_le_bytes)).collect::<Option<_>>()?;
        let all = (0..hits).map(|_| reader.take().map(Hit::from_bytes)).collect::<Option<_>>()?;
        let entry = |_| {
            let lamp = u32::from_le_bytes(reader.take()?);
            let mut values = [0.0; MAX_DOFS];
            for value in &mut values {
                *value = f32::from_le_bytes(reader.take()?);
            }
            Some(Entry { lamp, values })
        };
        let direct = (first, (0..entries).map(entry).collect::<Option<_>>()?);
        let (hits, area, lost) = (Hits { words, arrived, ends, all }, f64::from_bits(area), f64::from_bits(lost));
        (reader.0.is_empty() && hits.is_consistent()).then_some(Self { hits, direct, rays, area, lost })
    }
}

/// Bytes that are still to be read.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*first)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of 130 rays each, of which every third and every hundredth is lost, and all of one cell.
    fn some(cell: u32) -> Vec<Hit> {
        let ray =
            |ray: u32| if cell == 1 || ray.is_multiple_of(3) || ray % 100 == 7 { Hit::LOST } else { hit(cell, ray) };
        (0..130).map(ray).collect()
    }

    fn hit(cell: u32, ray: u32) -> Hit {
        Hit::from_bytes((u64::from(ray) << 32 | u64::from(cell)).to_le_bytes())
    }

    fn hits() -> Hits {
        let mut hits = Hits::new(130);
        (0..4).for_each(|cell| hits.push(&some(cell)));
        hits
    }

    #[test]
    fn any_run_of_rays_gives_the_hits_among_them() {
        let hits = hits();
        for (cell, taken) in [(0, 0..130), (0, 0..65), (1, 0..130), (2, 65..130), (2, 3..60), (3, 64..128), (3, 9..10)]
        {
            let all = some(cell);
            let expected = taken.clone().map(|ray| (ray, all[ray])).filter(|(_, hit)| !hit.is_lost());
            let found = hits.of(cell as usize).words(taken).flat_map(|(first, bits, hits)| {
                set_bits(bits).map(move |bit| first + bit).zip(hits.iter().copied()).collect::<Vec<_>>()
            });
            assert_eq!(found.collect::<Vec<_>>(), expected.collect::<Vec<_>>(), "cell {cell}");
        }
    }

    #[test]
    fn bytes_give_back_what_was_traced() {
        let traced = Traced {
            hits: hits(),
            direct: (vec![0, 1], vec![Entry { lamp: 3, values: [0.5; MAX_DOFS] }]),
            rays: 77,
            area: 0.1,
            lost: 0.3,
        };
        let bytes = traced.to_bytes();
        assert_eq!(Traced::from_bytes(&bytes), Some(traced));
        assert_eq!(Traced::from_bytes(&bytes[1..]), None);
        assert_eq!(Traced::from_bytes(&[]), None);
        let mut broken = hits();
        broken.arrived[0] ^= 1 << 5;
        let direct = (Vec::new(), Vec::new());
        let broken = Traced { hits: broken, direct, rays: 0, area: 0.0, lost: 0.0 };
        assert_eq!(Traced::from_bytes(&broken.to_bytes()), None, "a hit for each bit");
    }

    #[test]
    fn few_rays_and_whole_words_take_what_they_may() {
        for rays in [8, 32, 64, 128] {
            let mut hits = Hits::new(rays);
            hits.push(&vec![hit(3, 4); rays as usize]);
            assert_eq!(hits.bytes(), Hits::most_bytes(rays));
            // Fewer rays than a cell has, as when some are cast again.
            hits.clear();
            hits.push(&[hit(1, 0), Hit::LOST, hit(1, 2)]);
            let [(0, 0b101, found)] = hits.of(0).words(0..3).collect::<Vec<_>>()[..] else { panic!("one word") };
            assert_eq!(found, [hit(1, 0), hit(1, 2)]);
        }
    }
}
