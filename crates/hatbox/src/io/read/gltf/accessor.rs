//! Arrays of numbers in buffers: any component type, normalized, strided, sparse.

use super::Document;
use crate::io::read::ReadError;
use gltf_json::accessor::{ComponentType, sparse::Sparse};
use gltf_json::validation::Checked;
use gltf_json::{Accessor, Index};

/// More elements than this are taken for a broken file.
const MOST: u64 = 1 << 28;

const REMEDY: &str = "export the file again";

impl Document<'_> {
    /// Reads an accessor of N-vectors.
    pub(super) fn read<const N: usize>(&self, index: Index<Accessor>, place: &str) -> Result<Vec<[f64; N]>, ReadError> {
        let accessor = self.get(index, place)?;
        let broken = |reason: &str| self.error(place, format!("accessor {}: {reason}", index.value()), REMEDY);
        let (Checked::Valid(component), Checked::Valid(kind)) = (accessor.component_type, accessor.type_) else {
            return Err(broken("its type is unknown"));
        };
        if kind.multiplicity() != N {
            return Err(broken(&format!("it holds {} numbers per element instead of {N}", kind.multiplicity())));
        }
        if accessor.count.0 > MOST {
            return Err(broken("it claims more elements than can be"));
        }
        let decoder = Decoder { component: component.0, normalized: accessor.normalized };
        let count = accessor.count.0 as usize;
        let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let (bytes, stride) = self.view(view, place)?;
                decoder.all(bytes, offset, stride, count).ok_or_else(|| broken("it reaches beyond its buffer"))?
            }
            None if accessor.sparse.is_some() => vec![[0.0; N]; count],
            None => return Err(broken("it has no data")),
        };
        if let Some(sparse) = &accessor.sparse {
            self.substitute(sparse, &decoder, &mut values, place)?;
        }
        Ok(values)
    }

    /// Puts a sparse accessor's deviating values in their places.
    fn substitute<const N: usize>(
        &self,
        sparse: &Sparse,
        decoder: &Decoder,
        values: &mut [[f64; N]],
        place: &str,
    ) -> Result<(), ReadError> {
        let broken = || self.error(place, "its sparse values are out of range", REMEDY);
        let Checked::Valid(component) = sparse.indices.component_type else { return Err(broken()) };
        if sparse.count.0 > values.len() as u64 {
            return Err(broken());
        }
        let count = sparse.count.0 as usize;
        let (bytes, stride) = self.view(sparse.indices.buffer_view, place)?;
        let index = Decoder { component: component.0, normalized: false };
        let indices = index.all::<1>(bytes, sparse.indices.byte_offset.0, stride, count).ok_or_else(broken)?;
        let (bytes, stride) = self.view(sparse.values.buffer_view, place)?;
        let deviating = decoder.all::<N>(bytes, sparse.values.byte_offset.0, stride, count).ok_or_else(broken)?;
        for ([index], value) in indices.into_iter().zip(deviating) {
            *values.get_mut(index as usize).ok_or_else(broken)? = value;
        }
        Ok(())
    }
}

/// How numbers are stored.
struct Decoder {
    component: ComponentType,
    normalized: bool,
}

impl Decoder {
    /// `count` vectors from a view; `None` if they do not fit in it.
    fn all<const N: usize>(
        &self,
        view: &[u8],
        offset: u64,
        stride: Option<usize>,
        count: usize,
    ) -> Option<Vec<[f64; N]>> {
        let width = self.component.size();
        let stride = stride.unwrap_or(N * width);
        if count == 0 {
            return Some(Vec::new());
        }
        let length = (count - 1).checked_mul(stride)?.checked_add(N * width)?;
        let start = usize::try_from(offset).ok()?;
        let bytes = view.get(start..start.checked_add(length)?)?;
        let element = |k: usize| std::array::from_fn(|i| self.number(&bytes[k * stride + i * width..][..width]));
        Some((0..count).map(element).collect())
    }

    /// One number; `bytes` has the component's size.
    fn number(&self, bytes: &[u8]) -> f64 {
        let mut word = [0; 4];
        word[..bytes.len()].copy_from_slice(bytes);
        let half = [word[0], word[1]];
        let (value, greatest) = match self.component {
            ComponentType::F32 => return f64::from(f32::from_le_bytes(word)),
            ComponentType::U32 => return f64::from(u32::from_le_bytes(word)),
            ComponentType::I8 => (f64::from(i8::from_le_bytes([word[0]])), 127.0),
            ComponentType::U8 => (f64::from(word[0]), 255.0),
            ComponentType::I16 => (f64::from(i16::from_le_bytes(half)), 32767.0),
            ComponentType::U16 => (f64::from(u16::from_le_bytes(half)), 65535.0),
        };
        if self.normalized { (value / greatest).max(-1.0) } else { value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_normalized_only_where_the_file_says_so() {
        let plain = Decoder { component: ComponentType::I16, normalized: false };
        let normalized = Decoder { component: ComponentType::I16, normalized: true };
        let bytes = [0x01, 0x80, 0xff, 0x7f];
        assert_eq!(plain.all(&bytes, 0, None, 2), Some(vec![[-32767.0], [32767.0]]));
        assert_eq!(normalized.all(&bytes, 0, None, 1), Some(vec![[-1.0, 1.0]]));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let bytes = Decoder { component: ComponentType::U8, normalized: false };
        assert_eq!(bytes.all(&[1, 2, 3, 4, 5], 1, Some(3), 2), Some(vec![[2.0], [5.0]]));
        assert_eq!(bytes.all::<1>(&[1, 2, 3, 4], 1, Some(3), 2), None);
        assert_eq!(bytes.all::<1>(&[1], u64::MAX, None, 1), None);
        assert_eq!(bytes.all::<1>(&[1], 0, Some(usize::MAX), 4), None);
    }
}
