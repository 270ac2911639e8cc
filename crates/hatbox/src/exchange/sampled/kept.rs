//! What one chunk of cells yields when it is traced, and its bytes for whoever keeps them.

use super::lamps::Entry;
use super::rays::Hit;
use crate::element::MAX_DOFS;

/// The rays of one chunk.
#[derive(Debug, PartialEq)]
pub(super) struct Traced {
    pub(super) hits: Vec<Hit>,
    /// Where the entries of each cell begin, and the entries.
    pub(super) direct: (Vec<u32>, Vec<Entry>),
    pub(super) rays: u64,
    pub(super) area: f64,
    pub(super) lost: f64,
}

impl Traced {
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let (first, entries) = &self.direct;
        let lengths = [self.hits.len(), first.len(), entries.len()].map(|length| length as u64);
        let mut bytes = Vec::with_capacity(48 + 8 * self.hits.len() + 4 * first.len() + 32 * entries.len());
        for number in lengths.into_iter().chain([self.rays, self.area.to_bits(), self.lost.to_bits()]) {
            bytes.extend(number.to_le_bytes());
        }
        for hit in &self.hits {
            bytes.extend(hit.to_bytes());
        }
        for number in first {
            bytes.extend(number.to_le_bytes());
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
        let [hits, first, entries] = [reader.u64()?, reader.u64()?, reader.u64()?];
        let (rays, area, lost) = (reader.u64()?, f64::from_bits(reader.u64()?), f64::from_bits(reader.u64()?));
        let hits = (0..hits).map(|_| reader.take().map(Hit::from_bytes)).collect::<Option<_>>()?;
        let first = (0..first).map(|_| reader.take().map(u32::from_le_bytes)).collect::<Option<_>>()?;
        let entry = |_| {
            let lamp = u32::from_le_bytes(reader.take()?);
            let mut values = [0.0; MAX_DOFS];
            for value in &mut values {
                *value = f32::from_le_bytes(reader.take()?);
            }
            Some(Entry { lamp, values })
        };
        let entries = (0..entries).map(entry).collect::<Option<_>>()?;
        reader.0.is_empty().then_some(Self { hits, direct: (first, entries), rays, area, lost })
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

    #[test]
    fn bytes_give_back_what_was_traced() {
        let traced = Traced {
            hits: vec![Hit::LOST, Hit::from_bytes([1, 2, 3, 4, 5, 6, 7, 8])],
            direct: (vec![0, 1], vec![Entry { lamp: 3, values: [0.5; MAX_DOFS] }]),
            rays: 77,
            area: 0.1,
            lost: 0.3,
        };
        let bytes = traced.to_bytes();
        assert_eq!(Traced::from_bytes(&bytes), Some(traced));
        assert_eq!(Traced::from_bytes(&bytes[1..]), None);
        assert_eq!(Traced::from_bytes(&[]), None);
    }
}
