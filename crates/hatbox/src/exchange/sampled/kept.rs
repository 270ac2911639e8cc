//! What one chunk of cells yields when it is traced, and its bytes for whoever keeps them.
//!
//! Rays that were lost bring nothing and are most of them where the sky is wide, so that a bit says of each ray whether it
//! ended somewhere, and only those that did take 5 bytes more.

use super::fit::Take;
use super::lamps::Entry;
use super::rays::Hit;
use std::borrow::Cow;
use std::ops::Range;

/// Rays of one word.
pub(super) const WORD: usize = u64::BITS as usize;
/// Bytes of a hit.
const HIT: usize = size_of::<u32>() + size_of::<u8>();

/// Where the rays of some cells ended, as many rays of each.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Hits {
    /// Words of each cell.
    words: usize,
    /// A bit for each ray: whether it ended somewhere.
    arrived: Vec<u64>,
    /// Where the hits of each cell begin, but for the first, and where they end.
    ends: Vec<u32>,
    /// Cells and parts of them, as [`Hit::to_parts`] has them.
    cells: Vec<u32>,
    spots: Vec<u8>,
}

/// The rays of one cell.
#[derive(Clone, Copy)]
pub(super) struct Ended<'a> {
    arrived: &'a [u64],
    hits: Run<'a>,
}

/// Hits that follow each other.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    cells: &'a [u32],
    spots: &'a [u8],
    /// The cells and those that follow them in memory.
    coming: &'a [u32],
}

impl<'a> Run<'a> {
    pub(super) fn iter(self) -> impl Iterator<Item = Hit> + use<'a> {
        self.cells.iter().zip(self.spots).map(|(&cell, &spot)| Hit::from_parts(cell, spot))
    }

    /// The hit so many places after the first, if there is one in memory.
    #[inline]
    pub(super) fn coming(self, place: usize) -> Option<Hit> {
        self.coming.get(place).map(|&cell| Hit::from_parts(cell, 0))
    }

    fn part(self, range: Range<usize>) -> Self {
        let coming = &self.coming[range.start..];
        Self { cells: &self.cells[range.clone()], spots: &self.spots[range], coming }
    }
}

impl Hits {
    /// Of no cell yet.
    pub(super) fn new(rays: u32) -> Self {
        Self { words: (rays as usize).div_ceil(WORD), ..Self::default() }
    }

    /// Bytes that a cell takes at the most.
    pub(super) fn most_bytes(rays: u32) -> usize {
        let words = (rays as usize).div_ceil(WORD);
        words * size_of::<u64>() + size_of::<u32>() + rays as usize * HIT
    }

    /// Adds a cell.
    pub(super) fn push(&mut self, hits: &[Hit]) {
        for some in hits.chunks(WORD) {
            let bits = some.iter().enumerate().map(|(bit, hit)| u64::from(!hit.is_lost()) << bit);
            self.arrived.push(bits.fold(0, |word, bit| word | bit));
            let arrived = || some.iter().filter(|hit| !hit.is_lost()).map(|hit| hit.to_parts());
            self.cells.extend(arrived().map(|(cell, _)| cell));
            self.spots.extend(arrived().map(|(_, spot)| spot));
        }
        self.arrived.resize(self.words * (self.ends.len() + 1), 0);
        self.ends.push(self.cells.len() as u32);
    }

    pub(super) fn clear(&mut self) {
        self.arrived.clear();
        self.ends.clear();
        self.cells.clear();
        self.spots.clear();
    }

    pub(super) fn shrink(&mut self) {
        self.arrived.shrink_to_fit();
        self.ends.shrink_to_fit();
        self.cells.shrink_to_fit();
        self.spots.shrink_to_fit();
    }

    /// Whether there are as many cells as there should be, and a hit for each bit, cell by cell.
    fn is(&self, expected: &Expected) -> bool {
        let counts =
            |cell: usize| self.arrived[cell * self.words..(cell + 1) * self.words].iter().map(|w| w.count_ones());
        let ends = self.ends.iter().scan(0, |end, &next| Some(next.checked_sub(std::mem::replace(end, next))));
        self.words == (expected.rays as usize).div_ceil(WORD)
            && [expected.kept, expected.cells].contains(&self.ends.len())
            && self.arrived.len() == self.words * self.ends.len()
            && self.ends.last().copied().unwrap_or(0) as usize == self.cells.len()
            && self.cells.len() == self.spots.len()
            && self.cells.iter().all(|&cell| Hit::from_parts(cell, 0).cell() < expected.all_cells)
            && ends.enumerate().all(|(cell, count)| count == Some(counts(cell).sum()))
    }

    /// The rays of one cell.
    pub(super) fn of(&self, index: usize) -> Ended<'_> {
        let start = index.checked_sub(1).map_or(0, |before| self.ends[before]);
        Ended {
            arrived: &self.arrived[index * self.words..(index + 1) * self.words],
            hits: Run { cells: &self.cells, spots: &self.spots, coming: &self.cells }
                .part(start as usize..self.ends[index] as usize),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.arrived) + size_of_val(&*self.ends) + HIT * self.cells.len()
    }
}

impl<'a> Ended<'a> {
    /// The hits of some rays, 64 rays and fewer at a time: which rays they are (the first one's number, and a bit for each
    /// that has a hit), and their hits.
    pub(super) fn words(self, taken: Range<usize>) -> impl Iterator<Item = (usize, u64, Run<'a>)> {
        let mut rest = self.hits;
        self.arrived[..taken.end.div_ceil(WORD)].iter().enumerate().filter_map(move |(word, &bits)| {
            let first = word * WORD;
            let (from, to) = (taken.start.saturating_sub(first).min(WORD), (taken.end - first).min(WORD));
            let below = |end: usize| if end == WORD { bits } else { bits & ((1 << end) - 1) };
            let skipped = below(from).count_ones() as usize;
            let chosen = below(to) & !below(from);
            let hits = rest.part(skipped..skipped + chosen.count_ones() as usize);
            rest = rest.part(bits.count_ones() as usize..rest.cells.len());
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

/// What some cells get from lamps of exitance 1: coefficients of their irradiance.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Received {
    /// Most coefficients of a cell.
    width: usize,
    /// Where the entries of each cell end.
    ends: Vec<u32>,
    /// The lamp of each entry, and its coefficients.
    lamps: Vec<u32>,
    values: Vec<f32>,
    /// Which entries are in doubt, and their [`doubts`](Entry::doubts).
    in_doubt: Vec<u32>,
    doubts: Vec<f32>,
}

impl Received {
    /// By no cell yet.
    pub(super) fn new(width: usize) -> Self {
        Self { width, ..Self::default() }
    }

    /// Adds a cell.
    pub(super) fn push(&mut self, entries: &[Entry]) {
        for entry in entries {
            if entry.doubts.iter().any(|&doubt| doubt != 0.0) {
                self.in_doubt.push(self.lamps.len() as u32);
                self.doubts.extend(&entry.doubts[..self.width]);
            }
            self.lamps.push(entry.lamp);
            self.values.extend(&entry.values[..self.width]);
        }
        self.ends.push(self.lamps.len() as u32);
    }

    /// What one cell gets.
    pub(super) fn of(&self, index: usize) -> Lit<'_> {
        let start = index.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
        let range = start..self.ends[index] as usize;
        let values = &self.values[range.start * self.width..range.end * self.width];
        Lit { width: self.width, lamps: &self.lamps[range], values }
    }

    /// The coefficients of one cell's entries as the points have them that `take` takes of those that rays start from.
    pub(super) fn values_of(&self, index: usize, take: Take) -> Cow<'_, [f32]> {
        let all = self.of(index).values;
        let sign = match take {
            Take::All => return Cow::Borrowed(all),
            Take::FirstHalf => 1.0,
            Take::SecondHalf => -1.0,
        };
        let mut values = all.to_vec();
        for (entry, doubts) in self.doubts_of(index) {
            let values = &mut values[entry * self.width..];
            values.iter_mut().zip(doubts).for_each(|(value, doubt)| *value += sign * doubt);
        }
        Cow::Owned(values)
    }

    /// Which of one cell's entries are in doubt, and their doubts.
    pub(super) fn doubts_of(&self, index: usize) -> impl Iterator<Item = (usize, &[f32])> {
        let start = index.checked_sub(1).map_or(0, |before| self.ends[before]);
        let first = self.in_doubt.partition_point(|&entry| entry < start);
        let doubts = self.in_doubt[first..].iter().zip(self.doubts[first * self.width..].chunks_exact(self.width));
        let here = doubts.take_while(move |(entry, _)| **entry < self.ends[index]);
        here.map(move |(&entry, doubts)| ((entry - start) as usize, doubts))
    }

    /// Whether any entry is.
    pub(super) fn is_in_doubt(&self) -> bool {
        !self.in_doubt.is_empty()
    }

    pub(super) fn shrink(&mut self) {
        self.lamps.shrink_to_fit();
        self.values.shrink_to_fit();
        self.in_doubt.shrink_to_fit();
        self.doubts.shrink_to_fit();
    }

    pub(super) fn bytes(&self) -> usize {
        let of_doubts = size_of_val(&*self.in_doubt) + size_of_val(&*self.doubts);
        size_of_val(&*self.ends) + size_of_val(&*self.lamps) + size_of_val(&*self.values) + of_doubts
    }

    fn is(&self, expected: &Expected) -> bool {
        (self.width, self.ends.len()) == (expected.width, expected.cells)
            && self.ends.is_sorted()
            && self.ends.last().copied().unwrap_or(0) as usize == self.lamps.len()
            && self.values.len() == self.width * self.lamps.len()
            && self.lamps.iter().all(|&lamp| (lamp as usize) < expected.lamps)
            && self.in_doubt.is_sorted_by(|a, b| a < b)
            && self.in_doubt.last().is_none_or(|&entry| (entry as usize) < self.lamps.len())
            && self.doubts.len() == self.width * self.in_doubt.len()
    }
}

/// What one cell gets from lamps.
#[derive(Clone, Copy)]
pub(super) struct Lit<'a> {
    width: usize,
    lamps: &'a [u32],
    values: &'a [f32],
}

impl<'a> Lit<'a> {
    /// By no lamp.
    pub(super) const NOT: Self = Self { width: 1, lamps: &[], values: &[] };

    /// One of the lamps.
    pub(super) fn lamp(self, entry: usize) -> usize {
        self.lamps[entry] as usize
    }

    /// The same lamps with other coefficients.
    pub(super) fn with(self, values: &'a [f32]) -> Self {
        Self { values, ..self }
    }

    /// Lamps and coefficients.
    pub(super) fn iter(self) -> impl Iterator<Item = (usize, &'a [f32])> {
        self.lamps.iter().map(|&lamp| lamp as usize).zip(self.values.chunks_exact(self.width))
    }
}

/// The rays of one chunk.
#[derive(Debug, PartialEq)]
pub(super) struct Traced {
    pub(super) hits: Hits,
    pub(super) received: Received,
    pub(super) rays: u64,
    pub(super) area: f64,
    pub(super) lost: f64,
}

impl Traced {
    /// With the digest of what decides where rays go.
    pub(super) fn to_bytes(&self, digest: u64) -> Vec<u8> {
        let (Hits { words, arrived, ends, cells, spots }, received) = (&self.hits, &self.received);
        let lengths = [*words, arrived.len(), ends.len(), cells.len()];
        let of_lamps = [received.width, received.ends.len(), received.lamps.len(), received.in_doubt.len()];
        let numbers = [self.rays, self.area.to_bits(), self.lost.to_bits(), digest];
        let mut bytes = Vec::with_capacity(96 + self.hits.bytes() + received.bytes());
        for number in lengths.into_iter().chain(of_lamps).map(|length| length as u64).chain(numbers) {
            bytes.extend(number.to_le_bytes());
        }
        for word in arrived {
            bytes.extend(word.to_le_bytes());
        }
        let of_lamps = received.ends.iter().chain(&received.lamps).chain(&received.in_doubt);
        for number in ends.iter().chain(cells).chain(of_lamps) {
            bytes.extend(number.to_le_bytes());
        }
        for value in received.values.iter().chain(&received.doubts) {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(spots);
        bytes
    }

    /// What [`to_bytes`](Self::to_bytes) has made of such a chunk; `None` of anything else.
    pub(super) fn from_bytes(bytes: &[u8], expected: &Expected) -> Option<Self> {
        let mut reader = Reader(bytes);
        let mut lengths = [0; 8];
        for length in &mut lengths {
            *length = usize::try_from(reader.take().map(u64::from_le_bytes)?).ok()?;
        }
        let [words, arrived, ends, hits, width, lit, entries, in_doubt] = lengths;
        let [rays, area, lost, digest] = [(); 4].map(|()| reader.take().map(u64::from_le_bytes));
        let arrived = reader.list(arrived, u64::from_le_bytes)?;
        let (ends, cells) = (reader.list(ends, u32::from_le_bytes)?, reader.list(hits, u32::from_le_bytes)?);
        let (lit, lamps) = (reader.list(lit, u32::from_le_bytes)?, reader.list(entries, u32::from_le_bytes)?);
        let in_doubt = reader.list(in_doubt, u32::from_le_bytes)?;
        let values = reader.list(entries.checked_mul(width)?, f32::from_le_bytes)?;
        let doubts = reader.list(in_doubt.len().checked_mul(width)?, f32::from_le_bytes)?;
        let hits = Hits { words, arrived, ends, cells, spots: reader.list(hits, u8::from_le_bytes)? };
        let received = Received { width, ends: lit, lamps, values, in_doubt, doubts };
        let (area, lost) = (f64::from_bits(area?), f64::from_bits(lost?));
        let same = digest == Some(expected.digest) && hits.is(expected) && received.is(expected);
        let whole = reader.0.is_empty() && same;
        // More may have been kept than there is room for now, but not less.
        let hits = if expected.kept == 0 { Hits::new(expected.rays) } else { hits };
        whole.then_some(Self { hits, received, rays: rays?, area, lost })
    }
}

/// What the rays of a chunk are known to be.
pub(super) struct Expected {
    /// Number of its cells, and of those whose rays are to be kept: all or none.
    pub(super) cells: usize,
    pub(super) kept: usize,
    /// Rays of a cell.
    pub(super) rays: u32,
    /// Most coefficients of a cell.
    pub(super) width: usize,
    /// Number of all cells, and of lamps.
    pub(super) all_cells: usize,
    pub(super) lamps: usize,
    /// That of what decides where rays go.
    pub(super) digest: u64,
}

/// Bytes that are still to be read.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*first)
    }

    fn list<T, const N: usize>(&mut self, length: usize, of: fn([u8; N]) -> T) -> Option<Vec<T>> {
        (0..length).map(|_| self.take().map(of)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::MAX_DOFS;

    /// Cells of 130 rays each, of which every third and every hundredth is lost, and all of one cell.
    fn some(cell: u32) -> Vec<Hit> {
        let ray =
            |ray: u32| if cell == 1 || ray.is_multiple_of(3) || ray % 100 == 7 { Hit::LOST } else { hit(cell, ray) };
        (0..130).map(ray).collect()
    }

    fn hit(cell: u32, ray: u32) -> Hit {
        Hit::from_parts(1000 * cell + ray, ray as u8)
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
                set_bits(bits).map(move |bit| first + bit).zip(hits.iter()).collect::<Vec<_>>()
            });
            assert_eq!(found.collect::<Vec<_>>(), expected.collect::<Vec<_>>(), "cell {cell}");
        }
    }

    #[test]
    fn what_a_cell_receives_is_kept() {
        let entry = |lamp: u32| {
            let doubts = if lamp == 4 { [0.0; MAX_DOFS] } else { [0.25; MAX_DOFS] };
            Entry { lamp, values: std::array::from_fn(|k| (k as u32 + lamp) as f32), doubts }
        };
        let mut received = Received::new(3);
        let cells = [vec![], vec![entry(4), entry(1)], vec![], vec![entry(2)]];
        for entries in &cells {
            received.push(entries);
        }
        for (cell, entries) in cells.iter().enumerate() {
            let found: Vec<_> = received.of(cell).iter().collect();
            let expected: Vec<_> = entries.iter().map(|entry| (entry.lamp as usize, &entry.values[..3])).collect();
            assert_eq!(found, expected, "cell {cell}");
            for (take, sign) in [(Take::All, 0.0), (Take::FirstHalf, 1.0), (Take::SecondHalf, -1.0)] {
                let of = |entry: &Entry| (0..3).map(|k| entry.values[k] + sign * entry.doubts[k]).collect::<Vec<_>>();
                let expected: Vec<f32> = entries.iter().flat_map(of).collect();
                assert_eq!(received.values_of(cell, take), expected, "cell {cell}, {take:?}");
            }
        }
    }

    #[test]
    fn bytes_give_back_what_was_traced() {
        let lit = || {
            let mut received = Received::new(2);
            (0..4).for_each(|lamp| {
                received.push(&[Entry { lamp, values: [0.5; MAX_DOFS], doubts: [0.1 * lamp as f32; MAX_DOFS] }]);
            });
            received
        };
        let of = |hits: Hits, received: Received| Traced { hits, received, rays: 77, area: 0.1, lost: 0.3 };
        let expected = || Expected { cells: 4, kept: 4, rays: 130, width: 2, all_cells: 4000, lamps: 4, digest: 99 };
        let bytes = of(hits(), lit()).to_bytes(99);
        assert_eq!(Traced::from_bytes(&bytes, &expected()), Some(of(hits(), lit())));
        for part in [&bytes[1..], &bytes[..bytes.len() - 1], &[]] {
            assert_eq!(Traced::from_bytes(part, &expected()), None);
        }
        let others = [
            Expected { cells: 5, ..expected() },
            Expected { rays: 64, ..expected() },
            Expected { width: 3, ..expected() },
            Expected { all_cells: 3000, ..expected() },
            Expected { lamps: 3, ..expected() },
            Expected { digest: 98, ..expected() },
        ];
        for (k, other) in others.iter().enumerate() {
            assert_eq!(Traced::from_bytes(&bytes, other), None, "{k}");
        }
        let without = Traced::from_bytes(&bytes, &Expected { kept: 0, ..expected() });
        assert_eq!(without, Some(of(Hits::new(130), lit())), "rays that there is no room for are left out");
        let bytes_without = of(Hits::new(130), lit()).to_bytes(99);
        assert_eq!(Traced::from_bytes(&bytes_without, &expected()), None, "and cannot be made up");
        let mut broken = hits();
        broken.arrived[0] ^= 1 << 5;
        assert_eq!(Traced::from_bytes(&of(broken, lit()).to_bytes(99), &expected()), None, "a hit for each bit");
        for in_doubt in [vec![2, 1, 3], vec![1, 1, 3], vec![1, 2, 4], vec![1, 2]] {
            let bytes = of(hits(), Received { in_doubt, ..lit() }).to_bytes(99);
            assert_eq!(Traced::from_bytes(&bytes, &expected()), None, "each entry once, in order, with its doubts");
        }
        let mut narrow = bytes;
        narrow[32..40].fill(0);
        assert_eq!(Traced::from_bytes(&narrow, &expected()), None, "no coefficients");
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
            assert_eq!(found.iter().collect::<Vec<_>>(), [hit(1, 0), hit(1, 2)]);
        }
    }
}
