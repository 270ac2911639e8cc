use super::FORMAT;
use crate::io::atomic::{self, AtomicError};
use crate::io::npy::{self, Scalar};
use crate::linalg::MultiVector;
use crate::mesh::Mesh;
use crate::radiosity::Solution;
use crate::scene::{Material, Physics, Quantity, Scene, Texture, Wrap};
use std::io::{self, Seek, Write};
use std::path::Path;
use std::sync::Arc;
use zip::write::{SimpleFileOptions, ZipWriter};

/// Writes a solution; the table in the [module's documentation](super) says what is in the file.
///
/// # Errors
/// [`AtomicError`] if the file cannot be written; there is none then.
pub fn save(solution: &Solution, path: &Path) -> Result<(), AtomicError> {
    atomic::write(path, |file| {
        let mut archive = Archive(ZipWriter::new(file));
        scene(&mut archive, &solution.scene)?;
        materials(&mut archive, &solution.scene.materials, solution.bands())?;
        functions(&mut archive, solution)?;
        archive.0.finish()?.flush()
    })
}

struct Archive<W: Write + Seek>(ZipWriter<W>);

impl<W: Write + Seek> Archive<W> {
    fn entry(&mut self, key: &str, bytes: &[u8]) -> io::Result<()> {
        // Stored, as `numpy.savez` does: coefficients hardly compress. Without a time stamp, equal solutions are equal
        // files.
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored)
            .large_file(u32::try_from(bytes.len()).is_err());
        self.0.start_file(format!("{key}.npy"), options)?;
        self.0.write_all(bytes)
    }

    fn array<T: Scalar>(&mut self, key: &str, shape: &[usize], values: impl IntoIterator<Item = T>) -> io::Result<()> {
        self.entry(key, &npy::encode(shape, values))
    }

    fn text(&mut self, key: &str, value: &str) -> io::Result<()> {
        self.entry(key, &npy::encode_strings(&[], &[value]))
    }

    fn texts(&mut self, key: &str, values: &[&str]) -> io::Result<()> {
        self.entry(key, &npy::encode_strings(&[values.len()], values))
    }
}

fn scene<W: Write + Seek>(archive: &mut Archive<W>, scene: &Scene) -> io::Result<()> {
    archive.array("hatbox_format", &[], [FORMAT])?;
    let physics = match scene.physics {
        Physics::Light => "light",
        Physics::Heat => "heat",
    };
    archive.text("physics", physics)?;
    mesh(archive, &scene.mesh)?;
    for (name, surfaces) in [("surfaces", &scene.surfaces), ("hidden", &scene.hidden)] {
        let corners = surfaces.iter().flat_map(|surface| surface.corners).flat_map(|p| p.to_array());
        archive.array(name, &[surfaces.len(), 4, 3], corners)?;
    }
    let camera = scene.camera.map(|c| [c.eye.to_array(), c.target.to_array(), c.up.to_array()].concat());
    let fov = scene.camera.map(|c| c.fov_y);
    let camera: Vec<f64> = camera.into_iter().flatten().chain(fov).collect();
    archive.array("camera", &[camera.len()], camera)
}

fn mesh<W: Write + Seek>(archive: &mut Archive<W>, mesh: &Mesh) -> io::Result<()> {
    let cells = mesh.cells.len();
    archive.array("vertices", &[mesh.vertices.len(), 3], mesh.vertices.iter().flat_map(glam::DVec3::to_array))?;
    archive.array("cells", &[cells, 4], mesh.cells.iter().flat_map(|cell| cell.vertices))?;
    archive.array("corners", &[cells], mesh.cells.iter().map(|cell| cell.shape.corners() as u8))?;
    archive.array("material", &[cells], mesh.cells.iter().map(|cell| cell.material))?;
    archive.array("group", &[cells], mesh.cells.iter().map(|cell| cell.group))?;
    archive.array("surface", &[cells], mesh.cells.iter().map(|cell| cell.surface))?;
    let uvs = mesh.uvs.iter().flatten().flat_map(glam::DVec2::to_array);
    archive.array("uvs", &[mesh.uvs.len(), 4, 2], uvs)?;
    let normals = mesh.normals.iter().flatten().flat_map(glam::DVec3::to_array);
    archive.array("normals", &[mesh.normals.len(), 4, 3], normals)?;
    let names: Vec<&str> = mesh.groups.iter().map(String::as_str).collect();
    archive.texts("group_names", &names)
}

fn materials<W: Write + Seek>(archive: &mut Archive<W>, materials: &[Material], bands: usize) -> io::Result<()> {
    let names: Vec<&str> = materials.iter().map(|material| material.name.as_str()).collect();
    archive.texts("material_names", &names)?;
    archive.array("two_sided", &[materials.len()], materials.iter().map(|material| material.two_sided))?;
    let mut textures = Vec::new();
    let reflectances: Vec<_> = materials.iter().map(|material| &material.reflectance).collect();
    quantities(archive, "reflectance", &reflectances, bands, &mut textures)?;
    let exitances: Vec<_> = materials.iter().map(|material| &material.exitance).collect();
    quantities(archive, "exitance", &exitances, bands, &mut textures)?;
    let wraps = textures.iter().flat_map(|texture| texture.wrap()).map(|wrap| match wrap {
        Wrap::Repeat => 0_u8,
        Wrap::Mirror => 1,
        Wrap::Clamp => 2,
    });
    archive.array("texture_wrap", &[textures.len(), 2], wraps)?;
    for (k, texture) in textures.iter().enumerate() {
        let shape = [texture.height(), texture.width(), texture.channels()];
        archive.array(&format!("texture_{k}"), &shape, texture.texels().iter().copied())?;
    }
    Ok(())
}

/// Three arrays of one quantity of all materials; textures not met before are added to `textures`.
fn quantities<W: Write + Seek>(
    archive: &mut Archive<W>,
    key: &str,
    quantities: &[&Quantity],
    bands: usize,
    textures: &mut Vec<Arc<Texture>>,
) -> io::Result<()> {
    let shape = [quantities.len(), bands];
    let uniform = |q: &Quantity, band| if let Quantity::Uniform(_) = q { q.uniform(band) } else { None };
    let factor = |q: &Quantity, band: usize| match q {
        Quantity::Textured { factor, .. } => factor.get(band).or(factor.last()).copied(),
        _ => None,
    };
    let rows = |value: &dyn Fn(&Quantity, usize) -> Option<f64>| -> Vec<f64> {
        let row = |q| (0..bands).map(move |band| value(q, band).unwrap_or(f64::NAN));
        quantities.iter().copied().flat_map(row).collect()
    };
    archive.array(key, &shape, rows(&uniform))?;
    archive.array(&format!("{key}_factor"), &shape, rows(&factor))?;
    let indices: Vec<i32> = quantities.iter().map(|q| texture_index(q, textures)).collect();
    archive.array(&format!("{key}_texture"), &[indices.len()], indices)
}

fn texture_index(quantity: &Quantity, textures: &mut Vec<Arc<Texture>>) -> i32 {
    let Quantity::Textured { texture, .. } = quantity else { return -1 };
    let known = textures.iter().position(|other| Arc::ptr_eq(other, texture));
    let index = known.unwrap_or_else(|| {
        textures.push(Arc::clone(texture));
        textures.len() - 1
    });
    i32::try_from(index).unwrap_or(-1)
}

fn functions<W: Write + Seek>(archive: &mut Archive<W>, solution: &Solution) -> io::Result<()> {
    let space = &solution.space;
    archive.text("basis", space.basis().name)?;
    archive.array("continuous", &[], [space.continuity().is_some()])?;
    archive.array("offsets", &[space.offsets().len()], space.offsets().iter().map(|&offset| offset as u64))?;
    let nodes = (0..space.cells()).flat_map(|cell| {
        let patch = solution.scene.mesh.patch(cell);
        space.element(cell).nodes.iter().flat_map(move |node| patch.point(node.at).to_array())
    });
    archive.array("nodes", &[space.broken_dofs(), 3], nodes)?;
    let field = |field: &MultiVector| ([field.bands(), field.rows()], field.as_slice().to_vec());
    for (key, (shape, values)) in
        [("radiosity", field(&solution.radiosity)), ("irradiance", field(&solution.irradiance))]
    {
        archive.array(key, &shape, values)?;
    }
    Ok(())
}
