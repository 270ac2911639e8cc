//! The outside of a glTF: the binary container, the JSON in it, and the bytes that it refers to.

use super::Document;
use crate::io::read::{ReadError, files};
use base64::Engine as _;
use gltf_json::Root;
use std::path::Path;

/// The extensions that are understood; a file may require no others. Draco and meshopt compression are not among them.
pub(super) const EXTENSIONS: [&str; 3] =
    ["KHR_materials_emissive_strength", "KHR_texture_transform", "KHR_mesh_quantization"];

/// The JSON text and the binary chunk of a file; a plain `.gltf` is JSON as a whole.
pub(super) fn split<'a>(file: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), ReadError> {
    let broken = |reason: String| ReadError::new(file, "GLB header", reason, "export or copy the file again");
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let (Some(version), Some(length)) = (word(bytes, 4), word(bytes, 8)) else {
        return Err(broken("the file ends within its header".to_owned()));
    };
    if version != 2 {
        return Err(broken(format!("the file has glTF version {version}, not 2")));
    }
    let Some(mut rest) = bytes.get(12..length) else {
        return Err(broken(format!("the file is cut off: {} of {length} bytes are there", bytes.len())));
    };
    let (mut json, mut binary) = (None, None);
    while !rest.is_empty() {
        let chunk = word(rest, 0).and_then(|length| rest.get(8..length.checked_add(8)?));
        let chunk = chunk.ok_or_else(|| broken("a chunk is longer than the file".to_owned()))?;
        match &rest[4..8] {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            _ => {} // Chunks of other types are to be ignored.
        }
        rest = &rest[8 + chunk.len()..];
    }
    json.map(|json| (json, binary)).ok_or_else(|| broken("the file has no JSON chunk".to_owned()))
}

fn word(bytes: &[u8], at: usize) -> Option<usize> {
    let bytes = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?) as usize)
}

/// Parses the JSON and refuses extensions without which the file cannot be understood.
pub(super) fn parse(file: &Path, json: &[u8]) -> Result<Root, ReadError> {
    let root: Root = gltf_json::deserialize::from_slice(json).map_err(|error| {
        let place = format!("JSON, line {} column {}", error.line(), error.column());
        ReadError::new(file, place, format!("it is no glTF 2.0 ({error})"), "export the file again")
    })?;
    let required = &root.extensions_required;
    if let Some(extension) = required.iter().find(|name| !EXTENSIONS.contains(&name.as_str())) {
        let reason = format!("the file requires the extension {extension}, which is not supported");
        let remedy = "export without it (for compressed meshes: without compression)";
        return Err(ReadError::new(file, "extensionsRequired", reason, remedy));
    }
    Ok(root)
}

/// The bytes of every buffer.
pub(super) fn buffers(file: &Path, root: &Root, binary: Option<&[u8]>) -> Result<Vec<Vec<u8>>, ReadError> {
    let load = |(index, buffer): (usize, &gltf_json::Buffer)| {
        let place = format!("buffer {index}");
        let bytes = match (&buffer.uri, binary) {
            (Some(uri), _) => resolve(file, &place, uri)?,
            (None, Some(binary)) if index == 0 => binary.to_owned(),
            _ => {
                let reason = "the buffer has no uri, and there is no binary chunk for it";
                return Err(ReadError::new(file, place, reason, "export the file again"));
            }
        };
        if (bytes.len() as u64) < buffer.byte_length.0 {
            let reason = format!("{} of the buffer's {} bytes are there", bytes.len(), buffer.byte_length.0);
            return Err(ReadError::new(file, place, reason, "export or copy the files again"));
        }
        Ok(bytes)
    };
    root.buffers.iter().enumerate().map(load).collect()
}

/// The bytes behind a URI: embedded, or a file beside the glTF.
pub(super) fn resolve(file: &Path, place: &str, uri: &str) -> Result<Vec<u8>, ReadError> {
    if let Some(data) = uri.strip_prefix("data:") {
        let payload = data.split_once(";base64,").map(|(_, payload)| payload);
        let bytes = payload.and_then(|p| base64::engine::general_purpose::STANDARD.decode(p).ok());
        return bytes
            .ok_or_else(|| ReadError::new(file, place, "its data URI is not valid base64", "export the file again"));
    }
    if uri.contains("://") {
        let reason = format!("`{uri}` is not a file");
        return Err(ReadError::new(file, place, reason, "download it and refer to the copy"));
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    files::read_named(&folder.join(unescape(uri)), file, place)
}

/// Percent-decoding; what is no escape stays as it is.
fn unescape(uri: &str) -> String {
    let (mut bytes, mut rest) = (Vec::with_capacity(uri.len()), uri.as_bytes());
    while let [first, tail @ ..] = rest {
        let escaped = tail.get(..2).and_then(|hex| u8::from_str_radix(str::from_utf8(hex).ok()?, 16).ok());
        let (byte, length) = escaped.filter(|_| *first == b'%').map_or((*first, 0), |byte| (byte, 2));
        bytes.push(byte);
        rest = &tail[length..];
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

impl Document<'_> {
    /// The bytes of a buffer view.
    pub(super) fn view(
        &self,
        index: gltf_json::Index<gltf_json::buffer::View>,
        place: &str,
    ) -> Result<(&[u8], Option<usize>), ReadError> {
        let view = self.get(index, place)?;
        let buffer = self.buffers.get(view.buffer.value());
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let range = start.checked_add(view.byte_length.0).map(|end| start as usize..end as usize);
        let bytes = buffer.zip(range).and_then(|(buffer, range)| buffer.get(range));
        let bytes = bytes.ok_or_else(|| {
            let reason = format!("buffer view {} reaches beyond its buffer", index.value());
            self.error(place, reason, "export the file again")
        })?;
        Ok((bytes, view.byte_stride.map(|stride| stride.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_in_uris_are_undone() {
        assert_eq!(unescape("a%20b%2Fc.png"), "a b/c.png");
        assert_eq!(unescape("100%.png"), "100%.png");
        assert_eq!(unescape("%C3%A9%"), "é%");
    }

    #[test]
    fn a_container_cut_anywhere_is_an_error_and_no_panic() {
        let mut glb = b"glTF\x02\0\0\0\x20\0\0\0\x04\0\0\0JSON{}  \x00\0\0\0BIN\0".to_vec();
        glb[8] = glb.len() as u8;
        let file = Path::new("a.glb");
        assert_eq!(split(file, &glb), Ok((&b"{}  "[..], Some(&b""[..]))));
        for length in 4..glb.len() {
            assert!(split(file, &glb[..length]).is_err(), "{length} bytes");
        }
    }
}
