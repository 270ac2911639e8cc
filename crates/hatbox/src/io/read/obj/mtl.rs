use super::line::{self, Line};
use crate::io::read::picture::{self, Coding, quantity};
use crate::io::read::{DEFAULT_REFLECTANCE, ReadError, files};
use crate::scene::{Material, Texture, Wrap};
use std::collections::HashMap;
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

/// The materials of the `.mtl` files, by name.
#[derive(Debug, Default)]
pub(super) struct Library {
    materials: HashMap<String, Material>,
}

/// A material while its statements are read.
#[derive(Default)]
struct Draft {
    name: String,
    diffuse: Option<[f64; 3]>,
    emission: Option<[f64; 3]>,
    diffuse_map: Option<Arc<Texture>>,
    emission_map: Option<Arc<Texture>>,
}

impl Library {
    pub(super) fn get(&self, name: &str) -> Option<&Material> {
        self.materials.get(name)
    }

    /// Reads what an `mtllib` statement names; a file that is missing is a warning, since its faces are still there.
    pub(super) fn load(&mut self, statement: &Line<'_>, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let folder = statement.file.parent().unwrap_or(Path::new(""));
        let whole = folder.join(statement.rest);
        // A name may contain blanks, or the statement may list several names.
        let one_by_one = || statement.words().map(|word| folder.join(word)).collect();
        let names = if whole.is_file() { vec![whole] } else { one_by_one() };
        for path in names {
            match std::fs::read(&path) {
                Ok(bytes) => self.read(&path, &files::text(&bytes), warnings)?,
                Err(error) => warnings.push(format!(
                    "{}: {}: the material file `{}` cannot be read ({error}); put it beside the .obj",
                    statement.file.display(),
                    statement.place(),
                    path.display(),
                )),
            }
        }
        Ok(())
    }

    fn read(&mut self, file: &Path, text: &str, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let text = line::joined(text);
        let mut draft = None;
        for line in line::lines(file, &text) {
            if line.keyword == "newmtl" {
                let next = Draft { name: line.rest.to_owned(), ..Draft::default() };
                self.add(file, draft.replace(next), warnings);
            } else if let Some(draft) = &mut draft {
                draft.statement(&line, warnings)?;
            }
        }
        self.add(file, draft, warnings);
        Ok(())
    }

    fn add(&mut self, file: &Path, draft: Option<Draft>, warnings: &mut Vec<String>) {
        let Some(Draft { name, diffuse, emission, diffuse_map, emission_map }) = draft else { return };
        if diffuse.is_none() && diffuse_map.is_none() {
            let file = file.display();
            warnings.push(format!("{file}: material `{name}` has no Kd: {DEFAULT_REFLECTANCE} is assumed"));
        }
        let reflectance = diffuse.unwrap_or([if diffuse_map.is_some() { 1.0 } else { DEFAULT_REFLECTANCE }; 3]);
        let emission = emission.unwrap_or([if emission_map.is_some() { 1.0 } else { 0.0 }; 3]);
        let material = Material {
            name: name.clone(),
            reflectance: quantity(reflectance, diffuse_map),
            exitance: quantity(emission.map(|radiance| PI * radiance), emission_map),
            two_sided: false,
            blocks_only: false,
        };
        self.materials.insert(name, material);
    }
}

impl Draft {
    fn statement(&mut self, line: &Line<'_>, warnings: &mut Vec<String>) -> Result<(), ReadError> {
        let place = format!("{} (material `{}`)", line.place(), self.name);
        let checked = |fault: Option<String>, remedy: &str| match fault {
            Some(reason) => Err(ReadError::new(line.file, &place, reason, remedy)),
            None => Ok(()),
        };
        match line.keyword {
            "Kd" => {
                let values = color(line, &place)?;
                checked(files::reflectance_fault(&values), "set Kd to values from 0 to 1")?;
                self.diffuse = Some(values);
            }
            "Ke" => {
                let values = color(line, &place)?;
                checked(files::exitance_fault(&values), "correct Ke")?;
                self.emission = Some(values);
            }
            "map_Kd" => self.diffuse_map = Some(texture(line, &place, warnings)?),
            "map_Ke" => self.emission_map = Some(texture(line, &place, warnings)?),
            "d" if line.number(0).is_ok_and(|d| d < 1.0) => warnings.push(opaque(line, &place)),
            "Tr" if line.number(0).is_ok_and(|tr| tr > 0.0) => warnings.push(opaque(line, &place)),
            _ => {}
        }
        Ok(())
    }
}

fn opaque(line: &Line<'_>, place: &str) -> String {
    format!("{}: {place}: it is transparent in the file, and taken as opaque", line.file.display())
}

/// Three numbers, or one for all three.
fn color(line: &Line<'_>, place: &str) -> Result<[f64; 3], ReadError> {
    if matches!(line.words().next(), Some("spectral" | "xyz")) {
        let reason = format!("{} is given as a spectrum or in CIE XYZ", line.keyword);
        return Err(ReadError::new(line.file, place, reason, "give it as red, green and blue"));
    }
    if line.words().count() == 1 { Ok([line.number(0)?; 3]) } else { line.numbers() }
}

/// The picture that a `map_` statement names; its options are not supported.
fn texture(line: &Line<'_>, place: &str, warnings: &mut Vec<String>) -> Result<Arc<Texture>, ReadError> {
    let mut name = line.rest;
    if name.starts_with('-') {
        let file = line.file.display();
        warnings.push(format!("{file}: {place}: the options of {} are ignored", line.keyword));
        name = line.words().last().unwrap_or_default();
    }
    let folder = line.file.parent().unwrap_or(Path::new(""));
    let bytes = files::read_named(&folder.join(name.replace('\\', "/")), line.file, place)?;
    let texture = picture::decode(&bytes, Coding::Srgb, [Wrap::Repeat; 2]);
    let remedy = "store the picture as PNG or JPEG";
    texture.map(Arc::new).map_err(|reason| ReadError::new(line.file, place, format!("`{name}`: {reason}"), remedy))
}
