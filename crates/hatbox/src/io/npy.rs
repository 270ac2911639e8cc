//! The `.npy` format: one array of plain numbers, as `numpy.load` reads it.
//!
//! The whole format is a header of one line and the raw values. Doing it here keeps C libraries (the compression codecs
//! of the usual crates for it) out of the build, and lets the reader check the length of the data against the header
//! before it allocates anything.

use std::fmt::Write as _;
use std::io::{self, Write};

/// Values are written in portions of this many bytes.
const CHUNK: usize = 1 << 16;

/// A number type of arrays in files.
pub trait Scalar: Copy {
    /// NumPy's name of the type, little-endian.
    const DESCR: &'static str;
    /// Appends the little-endian bytes.
    fn put(self, bytes: &mut Vec<u8>);
}

macro_rules! scalar {
    ($($t:ty => $descr:literal),*) => {$(
        impl Scalar for $t {
            const DESCR: &'static str = $descr;
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}

scalar!(f64 => "<f8", f32 => "<f4", u64 => "<u8", i32 => "<i4", i64 => "<i8", u32 => "<u4", u8 => "|u1");

impl Scalar for bool {
    const DESCR: &'static str = "|b1";
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(self));
    }
}

/// The bytes of a `.npy` file: `values` in C order (last index fastest).
pub fn encode<T: Scalar>(shape: &[usize], values: impl IntoIterator<Item = T>) -> Vec<u8> {
    let mut bytes = header(T::DESCR, shape);
    for value in values {
        value.put(&mut bytes);
    }
    bytes
}

/// Writes a `.npy` file, without holding it in memory; there must be as many values as the shape says.
///
/// # Errors
/// What the writer says.
pub fn write<T: Scalar>(
    writer: &mut impl Write,
    shape: &[usize],
    values: impl IntoIterator<Item = T>,
) -> io::Result<()> {
    writer.write_all(&header(T::DESCR, shape))?;
    let mut bytes = Vec::with_capacity(CHUNK + size_of::<T>());
    for value in values {
        value.put(&mut bytes);
        if bytes.len() >= CHUNK {
            writer.write_all(&bytes)?;
            bytes.clear();
        }
    }
    writer.write_all(&bytes)
}

/// The bytes of a `.npy` file of one byte string (ASCII), which is no array.
pub fn encode_bytes(text: &str) -> Vec<u8> {
    let mut bytes = header(&format!("|S{}", text.len()), &[]);
    bytes.extend_from_slice(text.as_bytes());
    bytes
}

/// The bytes of a `.npy` file of fixed-width Unicode strings, which NumPy loads without pickling.
pub fn encode_strings<S: AsRef<str>>(shape: &[usize], strings: &[S]) -> Vec<u8> {
    let width = strings.iter().map(|s| s.as_ref().chars().count()).max().unwrap_or(0).max(1);
    let mut bytes = header(&format!("<U{width}"), shape);
    for string in strings {
        let padded = string.as_ref().chars().map(u32::from).chain(std::iter::repeat(0));
        padded.take(width).for_each(|c| c.put(&mut bytes));
    }
    bytes
}

fn header(descr: &str, shape: &[usize]) -> Vec<u8> {
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (");
    for n in shape {
        // Writing to a string cannot fail.
        let _ = write!(text, "{n}, ");
    }
    text.push_str("), }");
    // The data begin at a multiple of 64, and the header ends with a line break.
    let length = (10 + text.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend_from_slice(&(length as u16).to_le_bytes());
    bytes.extend_from_slice(text.as_bytes());
    bytes.resize(10 + length - 1, b' ');
    bytes.push(b'\n');
    bytes
}

/// Why bytes are not an array that Hatbox reads.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NpyError {
    /// Not the format at all.
    #[error("this is no .npy array")]
    NotNpy,
    /// The header does not say what it must.
    #[error("the header of the .npy array cannot be understood")]
    Header,
    /// The number of data bytes is not what the shape says.
    #[error("the array is cut off: its header promises {expected} values of type {descr}, {found} bytes follow")]
    Length {
        /// How many values the header promises.
        expected: usize,
        /// Their type.
        descr: String,
        /// How many bytes there are.
        found: usize,
    },
    /// The values have another type than is needed.
    #[error("the values have type {descr}, {needed} are needed")]
    Type {
        /// NumPy's name of the type found.
        descr: String,
        /// What is needed, in words.
        needed: &'static str,
    },
    /// A value does not fit what it is for.
    #[error("the value {0} is negative, too large or not whole")]
    Value(String),
}

/// An array as it is in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Array {
    shape: Vec<usize>,
    descr: String,
    fortran: bool,
    data: Vec<u8>,
}

impl Array {
    /// Takes a `.npy` file apart.
    ///
    /// # Errors
    /// [`NpyError`] if the header is wrong or the data have not the length that it says.
    pub fn parse(bytes: &[u8]) -> Result<Self, NpyError> {
        let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or(NpyError::NotNpy)?;
        let (length, start) = match *rest {
            [1, _, a, b, ..] => (usize::from(u16::from_le_bytes([a, b])), 4),
            [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([a, b, c, d]) as usize, 6),
            _ => return Err(NpyError::Header),
        };
        let text = rest.get(start..start + length).ok_or(NpyError::Header)?;
        let text = std::str::from_utf8(text).map_err(|_| NpyError::Header)?;
        let (descr, fortran, shape) = parse_header(text).ok_or(NpyError::Header)?;
        let data = rest[start + length..].to_vec();
        let array = Self { shape, descr, fortran, data };
        let promised = array.len().zip(array.item_size()).and_then(|(n, size)| n.checked_mul(size));
        match promised {
            Some(promised) if promised == array.data.len() => Ok(array),
            _ => Err(NpyError::Length {
                expected: array.len().unwrap_or(usize::MAX),
                found: array.data.len(),
                descr: array.descr,
            }),
        }
    }

    /// The extents.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn len(&self) -> Option<usize> {
        self.shape.iter().try_fold(1_usize, |n, &extent| n.checked_mul(extent))
    }

    /// Bytes per value; `None` if the type is none that Hatbox knows.
    fn item_size(&self) -> Option<usize> {
        match self.descr.as_str() {
            "|b1" | "|u1" | "|i1" => Some(1),
            "<f4" | "<i4" | "<u4" => Some(4),
            "<f8" | "<i8" | "<u8" => Some(8),
            other => other.strip_prefix("<U")?.parse::<usize>().ok()?.checked_mul(4).filter(|&size| size > 0),
        }
    }

    /// The values as `f64` in C order, whatever number type they are stored as.
    ///
    /// # Errors
    /// [`NpyError::Type`] if they are not numbers.
    pub fn f64s(&self) -> Result<Vec<f64>, NpyError> {
        let values = match self.descr.as_str() {
            "<f8" => self.items(f64::from_le_bytes),
            "<f4" => self.items(|b| f64::from(f32::from_le_bytes(b))),
            "<i4" => self.items(|b| f64::from(i32::from_le_bytes(b))),
            "<u4" => self.items(|b| f64::from(u32::from_le_bytes(b))),
            "<i8" => self.items(|b| i64::from_le_bytes(b) as f64),
            "<u8" => self.items(|b| u64::from_le_bytes(b) as f64),
            "|u1" | "|b1" => self.items(|[b]| f64::from(b)),
            _ => return Err(NpyError::Type { descr: self.descr.clone(), needed: "numbers" }),
        };
        Ok(self.in_c_order(values))
    }

    /// The values as whole numbers from `least` to 2³²−1 in C order, whatever number type they are stored as.
    ///
    /// # Errors
    /// [`NpyError::Type`] if they are not numbers, [`NpyError::Value`] if one is out of range.
    pub fn integers(&self, least: i64) -> Result<Vec<i64>, NpyError> {
        let whole = |value: f64| {
            let fits = value.fract() == 0.0 && (least as f64..=f64::from(u32::MAX)).contains(&value);
            if fits { Ok(value as i64) } else { Err(NpyError::Value(value.to_string())) }
        };
        self.f64s()?.into_iter().map(whole).collect()
    }

    /// The values as `f32` in C order.
    ///
    /// # Errors
    /// [`NpyError::Type`] if they are not of that type.
    pub fn f32s(&self) -> Result<Vec<f32>, NpyError> {
        match self.descr.as_str() {
            "<f4" => Ok(self.in_c_order(self.items(f32::from_le_bytes))),
            _ => Err(NpyError::Type { descr: self.descr.clone(), needed: "single-precision numbers" }),
        }
    }

    /// The values as strings.
    ///
    /// # Errors
    /// [`NpyError::Type`] if they are not, [`NpyError::Value`] if one is not Unicode.
    pub fn strings(&self) -> Result<Vec<String>, NpyError> {
        let width = self.item_size().filter(|_| self.descr.starts_with("<U"));
        let width = width.ok_or_else(|| NpyError::Type { descr: self.descr.clone(), needed: "strings" })?;
        let string = |item: &[u8]| {
            let codes = item.as_chunks::<4>().0.iter().map(|&c| u32::from_le_bytes(c)).take_while(|&c| c != 0);
            codes.map(|c| char::from_u32(c).ok_or_else(|| NpyError::Value(format!("U+{c:X}")))).collect()
        };
        self.data.chunks_exact(width).map(string).collect()
    }

    fn items<const N: usize, T>(&self, value: impl Fn([u8; N]) -> T) -> Vec<T> {
        self.data.as_chunks::<N>().0.iter().map(|&bytes| value(bytes)).collect()
    }

    /// Undoes Fortran order (first index fastest), which NumPy saves transposed arrays in.
    fn in_c_order<T: Copy>(&self, values: Vec<T>) -> Vec<T> {
        if !self.fortran || self.shape.len() < 2 {
            return values;
        }
        let source = |mut i: usize| {
            // The digits of i in C order are the indices; weigh them as Fortran does.
            let (mut place, mut stride) = (0, values.len());
            for &extent in self.shape.iter().rev() {
                stride /= extent;
                place += (i % extent) * stride;
                i /= extent;
            }
            values[place]
        };
        (0..values.len()).map(source).collect()
    }
}

/// The type, whether the order is Fortran's, and the shape, from a header such as
/// `{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }`.
fn parse_header(text: &str) -> Option<(String, bool, Vec<usize>)> {
    let value = |key: &str| text.split_once(key)?.1.trim_start().strip_prefix(':').map(str::trim_start);
    let descr = value("'descr'")?.strip_prefix('\'')?.split_once('\'')?.0.to_owned();
    let fortran = match value("'fortran_order'")? {
        order if order.starts_with("True") => true,
        order if order.starts_with("False") => false,
        _ => return None,
    };
    let shape = value("'shape'")?.strip_prefix('(')?.split_once(')')?.0;
    let extents = shape.split(',').map(str::trim).filter(|extent| !extent.is_empty());
    Some((descr, fortran, extents.map(|extent| extent.parse().ok()).collect::<Option<_>>()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_strings_come_back() {
        let array = Array::parse(&encode(&[2, 3], [1.5, -2.0, f64::MIN_POSITIVE, 0.1, 1e300, 5.0])).expect("valid");
        assert_eq!(array.shape(), [2, 3]);
        assert_eq!(array.f64s().expect("numbers"), [1.5, -2.0, f64::MIN_POSITIVE, 0.1, 1e300, 5.0]);
        let names = ["", "Wände", "a\u{1F4A1}b"];
        let array = Array::parse(&encode_strings(&[3], &names)).expect("valid");
        assert_eq!(array.strings().expect("strings"), names);
        assert_eq!(Array::parse(&encode_strings::<&str>(&[0], &[])).expect("valid").strings(), Ok(vec![]));
        assert_eq!(Array::parse(&encode(&[], [7])).expect("a scalar").integers(0), Ok(vec![7]));
    }

    #[test]
    fn the_data_are_aligned_to_64_bytes() {
        for shape in [&[1][..], &[1, 1, 1, 1], &[1; 12]] {
            assert_eq!(encode(shape, [0_u8]).len() % 64, 1);
        }
    }

    #[test]
    fn fortran_order_is_undone() {
        let mut bytes = encode(&[2, 3], [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
        let order = bytes.windows(5).position(|word| word == b"False").expect("it is in the header");
        bytes[order..order + 5].copy_from_slice(b"True ");
        assert_eq!(Array::parse(&bytes).expect("valid").f64s(), Ok(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    }

    #[test]
    fn what_is_cut_off_or_foreign_is_an_error() {
        let bytes = encode(&[4], [1.0, 2.0, 3.0, 4.0]);
        for end in 0..bytes.len() {
            assert!(Array::parse(&bytes[..end]).is_err(), "{end} bytes");
        }
        let huge = encode::<f64>(&[usize::MAX, 8], []);
        assert!(matches!(Array::parse(&huge), Err(NpyError::Length { .. })));
        let array = Array::parse(&encode(&[2], [1.5, 1.0])).expect("valid");
        assert_eq!(array.integers(0), Err(NpyError::Value("1.5".to_owned())));
        assert!(matches!(array.strings(), Err(NpyError::Type { .. })));
    }
}
