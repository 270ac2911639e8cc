use super::FORMAT;
use crate::element::{Basis, Shape};
use crate::io::npy::{Array, NpyError};
use crate::linalg::{LinearOperator, MultiVector};
use crate::mesh::{Cell, Mesh};
use crate::radiosity::Solution;
use crate::scene::{Camera, Material, Physics, Quantity, Scene, Surface, Texture, Wrap};
use crate::space::{CREASE_ANGLE, Continuity, FunctionSpace, NoElement};
use glam::{DVec2, DVec3};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zip::ZipArchive;
use zip::result::ZipError;

/// A file is not a solution that this version can read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read the solution `{}`: {problem}", path.display())]
pub struct LoadError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: Problem,
}

/// What is wrong with a solution's file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The system could not read it.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// It is no archive, or a damaged one.
    #[error("it is not a whole .npz archive ({0})")]
    Archive(ZipError),
    /// An array is missing.
    #[error("it has no array `{0}`; is it a solution written by `hatbox solve -o FILE.npz`?")]
    Missing(String),
    /// An array cannot be read.
    #[error("array `{0}`: {1}")]
    Array(String, NpyError),
    /// An array contradicts the others or the table of the format.
    #[error("array `{0}`: {1}")]
    Invalid(String, String),
    /// A later version of Hatbox wrote it.
    #[error("it has format {0}, this version of Hatbox reads format {FORMAT}")]
    Format(i64),
    /// The basis has no element for a cell.
    #[error(transparent)]
    NoElement(#[from] NoElement),
}

type Result<T, E = Problem> = std::result::Result<T, E>;

fn invalid<T>(key: &str, what: impl Into<String>) -> Result<T> {
    Err(Problem::Invalid(key.to_owned(), what.into()))
}

/// Reads a solution that [`save`](super::save) wrote (or NumPy, with the same keys).
///
/// The space is joined where it was when it was solved, if that was at the usual [`CREASE_ANGLE`]; otherwise it is broken,
/// with equal coefficients where they were joined, which is all that evaluation needs.
///
/// # Errors
/// [`LoadError`] if the file cannot be read, is damaged, or its arrays contradict each other.
pub fn load(path: &Path) -> Result<Solution, LoadError> {
    let try_load = || {
        let mut archive = Archive::open(path)?;
        match archive.integers("hatbox_format", &[], i64::from(i32::MIN))?[..] {
            [format] if format == i64::from(FORMAT) => archive.solution(),
            ref other => Err(Problem::Format(other.first().copied().unwrap_or_default())),
        }
    };
    try_load().map_err(|problem| LoadError { path: path.to_owned(), problem })
}

struct Archive(ZipArchive<BufReader<File>>);

/// An extent of an array that the file may choose.
const ANY: usize = usize::MAX;

impl Archive {
    fn open(path: &Path) -> Result<Self> {
        match ZipArchive::new(BufReader::new(File::open(path)?)) {
            Ok(archive) => Ok(Self(archive)),
            Err(ZipError::Io(error)) => Err(Problem::Io(error)),
            Err(error) => Err(Problem::Archive(error)),
        }
    }

    /// An array whose extents are those of `shape`, [`ANY`] meaning any.
    fn array(&mut self, key: &str, shape: &[usize]) -> Result<Array> {
        let mut entry = match self.0.by_name(&format!("{key}.npy")) {
            Ok(entry) => entry,
            Err(ZipError::FileNotFound) => return Err(Problem::Missing(key.to_owned())),
            Err(error) => return Err(Problem::Archive(error)),
        };
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|error| Problem::Archive(ZipError::Io(error)))?;
        let array = Array::parse(&bytes).map_err(|error| Problem::Array(key.to_owned(), error))?;
        let found = array.shape();
        let fits = found.len() == shape.len() && found.iter().zip(shape).all(|(f, s)| f == s || *s == ANY);
        if fits { Ok(array) } else { invalid(key, format!("its shape is {found:?}, not {}", describe(shape))) }
    }

    fn f64s(&mut self, key: &str, shape: &[usize]) -> Result<Vec<f64>> {
        self.array(key, shape)?.f64s().map_err(|error| Problem::Array(key.to_owned(), error))
    }

    fn finite(&mut self, key: &str, shape: &[usize]) -> Result<Vec<f64>> {
        let values = self.f64s(key, shape)?;
        if values.iter().all(|v| v.is_finite()) { Ok(values) } else { invalid(key, "a value is not finite") }
    }

    fn integers(&mut self, key: &str, shape: &[usize], least: i64) -> Result<Vec<i64>> {
        self.array(key, shape)?.integers(least).map_err(|error| Problem::Array(key.to_owned(), error))
    }

    /// Indices below `end`.
    fn indices(&mut self, key: &str, shape: &[usize], end: usize) -> Result<Vec<u32>> {
        let values = self.integers(key, shape, 0)?;
        match values.iter().find(|&&v| v as usize >= end) {
            Some(v) => invalid(key, format!("index {v} is out of range, there are {end}")),
            None => Ok(values.into_iter().map(|v| v as u32).collect()),
        }
    }

    fn strings(&mut self, key: &str, shape: &[usize]) -> Result<Vec<String>> {
        self.array(key, shape)?.strings().map_err(|error| Problem::Array(key.to_owned(), error))
    }

    fn string(&mut self, key: &str) -> Result<String> {
        Ok(self.strings(key, &[])?.pop().unwrap_or_default())
    }

    /// An N × 4 × `width` array of a value per corner, or nothing.
    fn corners(&mut self, key: &str, cells: usize, width: usize) -> Result<Vec<f64>> {
        let values = self.finite(key, &[ANY, 4, width])?;
        if values.is_empty() || values.len() == cells * 4 * width {
            Ok(values)
        } else {
            invalid(key, format!("there must be one row per cell ({cells}) or none"))
        }
    }

    fn solution(&mut self) -> Result<Solution> {
        let radiosity = self.field("radiosity")?;
        let irradiance = self.field("irradiance")?;
        let scene = self.scene(radiosity.bands())?;
        let name = self.string("basis")?;
        let Some(basis) = Basis::named(&name) else { return invalid("basis", format!("there is no basis `{name}`")) };
        let space = FunctionSpace::broken(&scene.mesh, basis)?;
        let offsets = self.integers("offsets", &[ANY], 0)?;
        if !offsets.iter().map(|&offset| offset as usize).eq(space.offsets().iter().copied()) {
            return invalid("offsets", format!("they are not those of the basis `{name}` on these cells"));
        }
        for (key, field) in [("radiosity", &radiosity), ("irradiance", &irradiance)] {
            if (field.rows(), field.bands()) != (space.broken_dofs(), radiosity.bands()) {
                let expected = describe(&[radiosity.bands(), space.broken_dofs()]);
                return invalid(key, format!("its shape is {:?}, not {expected}", [field.bands(), field.rows()]));
            }
        }
        let continuous = self.integers("continuous", &[], 0).is_ok_and(|found| found == [1]);
        let space = if continuous { joined(&scene, space, &radiosity)? } else { space };
        Ok(Solution { scene, space, radiosity, irradiance })
    }

    fn field(&mut self, key: &str) -> Result<MultiVector> {
        let array = self.array(key, &[ANY, ANY])?;
        let (bands, rows) = (array.shape()[0], array.shape()[1]);
        if bands == 0 {
            return invalid(key, "it has no bands");
        }
        let values = array.f64s().map_err(|error| Problem::Array(key.to_owned(), error))?;
        debug_assert_eq!(values.len(), bands * rows);
        MultiVector::from_bands(bands, values).map_or_else(|| invalid(key, "its bands have no equal lengths"), Ok)
    }

    fn scene(&mut self, bands: usize) -> Result<Scene> {
        let physics = match self.string("physics")?.as_str() {
            "light" => Physics::Light,
            "heat" => Physics::Heat,
            other => return invalid("physics", format!("`{other}` is neither `light` nor `heat`")),
        };
        let materials = self.materials(bands)?;
        let surfaces = self.surfaces("surfaces")?;
        let hidden = match self.surfaces("hidden") {
            // Files of earlier versions have none.
            Err(Problem::Missing(_)) => Arc::default(),
            found => found?,
        };
        let mesh = self.mesh(materials.len(), surfaces.len())?;
        let camera = self.camera()?;
        let mesh = mesh.into();
        Ok(Scene { mesh, materials, surfaces, hidden, bands, physics, camera, warnings: Vec::new() })
    }

    fn surfaces(&mut self, key: &str) -> Result<Arc<[Surface]>> {
        let corners = vectors(&self.finite(key, &[ANY, 4, 3])?);
        Ok(corners.as_chunks().0.iter().map(|&corners| Surface { corners }).collect())
    }

    fn camera(&mut self) -> Result<Option<Camera>> {
        let values = self.finite("camera", &[ANY])?;
        match (vectors(&values).as_slice(), values.as_slice()) {
            (_, []) => Ok(None),
            (&[eye, target, up], &[.., fov_y]) if values.len() == 10 => Ok(Some(Camera { eye, target, up, fov_y })),
            _ => invalid("camera", "it must have 10 values or none"),
        }
    }

    fn mesh(&mut self, materials: usize, surfaces: usize) -> Result<Mesh> {
        let vertices = vectors(&self.finite("vertices", &[ANY, 3])?);
        let indices = self.indices("cells", &[ANY, 4], vertices.len())?;
        let count = indices.len() / 4;
        let groups = self.strings("group_names", &[ANY])?;
        let corners = self.integers("corners", &[count], 0)?;
        let material = self.indices("material", &[count], materials)?;
        let group = self.indices("group", &[count], groups.len())?;
        let surface = self.indices("surface", &[count], surfaces)?;
        let cell = |(c, &vertices): (usize, &[u32; 4])| {
            let shape = match corners[c] {
                3 if vertices[2] == vertices[3] => Shape::Triangle,
                4 => Shape::Quad,
                n => return invalid("corners", format!("cell {c} has {vertices:?} and claims {n} corners")),
            };
            Ok(Cell { shape, vertices, material: material[c], group: group[c], surface: surface[c] })
        };
        let cells = indices.as_chunks::<4>().0.iter().enumerate().map(cell).collect::<Result<_>>()?;
        let uvs = self.corners("uvs", count, 2)?;
        let uvs: Vec<DVec2> = uvs.as_chunks().0.iter().copied().map(DVec2::from_array).collect();
        let normals = vectors(&self.corners("normals", count, 3)?);
        let (uvs, normals) = (uvs.as_chunks().0.to_vec(), normals.as_chunks().0.to_vec());
        Ok(Mesh { vertices, cells, groups, uvs, normals })
    }

    fn materials(&mut self, bands: usize) -> Result<Vec<Material>> {
        let names = self.strings("material_names", &[ANY])?;
        let two_sided = self.integers("two_sided", &[names.len()], 0)?;
        let textures = self.textures()?;
        let reflectances = self.quantities("reflectance", names.len(), bands, &textures)?;
        let exitances = self.quantities("exitance", names.len(), bands, &textures)?;
        let quantities = reflectances.into_iter().zip(exitances);
        let material = |((name, two_sided), (reflectance, exitance)): ((String, i64), (Quantity, Quantity))| Material {
            name,
            reflectance,
            exitance,
            two_sided: two_sided != 0,
            blocks_only: false,
        };
        Ok(names.into_iter().zip(two_sided).zip(quantities).map(material).collect())
    }

    fn quantities(
        &mut self,
        key: &str,
        count: usize,
        bands: usize,
        textures: &[Arc<Texture>],
    ) -> Result<Vec<Quantity>> {
        let uniform = self.f64s(key, &[count, bands])?;
        let factors = self.f64s(&format!("{key}_factor"), &[count, bands])?;
        let texture_key = format!("{key}_texture");
        let indices = self.integers(&texture_key, &[count], -1)?;
        let rows = uniform.chunks_exact(bands).zip(factors.chunks_exact(bands));
        let quantity = |((uniform, factor), index): ((&[f64], &[f64]), i64)| match usize::try_from(index) {
            Err(_) => Ok(Quantity::Uniform(uniform.to_vec())),
            Ok(k) => match textures.get(k) {
                Some(texture) => Ok(Quantity::Textured { factor: factor.to_vec(), texture: Arc::clone(texture) }),
                None => invalid(&texture_key, format!("there is no texture {k}")),
            },
        };
        rows.zip(indices).map(quantity).collect()
    }

    fn textures(&mut self) -> Result<Vec<Arc<Texture>>> {
        let wraps = self.integers("texture_wrap", &[ANY, 2], 0)?;
        let wrap = |code| match code {
            0 => Ok(Wrap::Repeat),
            1 => Ok(Wrap::Mirror),
            2 => Ok(Wrap::Clamp),
            other => invalid("texture_wrap", format!("{other} is none of 0, 1, 2")),
        };
        let texture = |(k, &[u, v]): (usize, &[i64; 2])| {
            let key = format!("texture_{k}");
            let array = self.array(&key, &[ANY; 3])?;
            let texels = array.f32s().map_err(|error| Problem::Array(key.clone(), error))?;
            let &[height, width, channels] = array.shape() else { return invalid(&key, "it is no image") };
            let texture = Texture::new(width, height, channels, texels, [wrap(u)?, wrap(v)?]);
            texture.map_or_else(|| invalid(&key, "it is empty"), |texture| Ok(Arc::new(texture)))
        };
        wraps.as_chunks::<2>().0.iter().enumerate().map(texture).collect()
    }
}

/// The space joined as usual, if that is how the coefficients are.
fn joined(scene: &Scene, broken: FunctionSpace, coefficients: &MultiVector) -> Result<FunctionSpace> {
    let usual = Continuity::Continuous { crease_angle: CREASE_ANGLE };
    let space = FunctionSpace::new(scene, broken.basis(), usual)?;
    let Some(continuity) = space.continuity() else { return Ok(broken) };
    let is_joined = coefficients.iter_bands().all(|band| {
        let mut values = vec![None; continuity.cols()];
        band.iter().enumerate().all(|(dof, &value)| {
            continuity.row(dof).all(|(unknown, _)| *values[unknown].get_or_insert(value.to_bits()) == value.to_bits())
        })
    });
    Ok(if is_joined { space } else { broken })
}

fn vectors(values: &[f64]) -> Vec<DVec3> {
    values.as_chunks().0.iter().copied().map(DVec3::from_array).collect()
}

/// A shape in words; "any" for a free extent.
fn describe(shape: &[usize]) -> String {
    let extent = |&n: &usize| if n == ANY { "any".to_owned() } else { n.to_string() };
    format!("[{}]", shape.iter().map(extent).collect::<Vec<_>>().join(", "))
}
