//! What is written can be read back, by us and by others; what cannot be written leaves nothing behind.

#![allow(clippy::float_cmp, reason = "what is written comes back exactly")]

use glam::{DVec2, DVec3};
use hatbox::bake::{Exposure, bake};
use hatbox::element::{Basis, Shape};
use hatbox::io::csv::{PointsError, read_points, save_points};
use hatbox::io::npy::{self, Array};
use hatbox::io::{OUTPUTS, WriteError, WriteOptions, atomic, npz, write, writer_for};
use hatbox::linalg::MultiVector;
use hatbox::mesh::{Cell, Mesh};
use hatbox::progress::{Interrupted, Progress, Silent};
use hatbox::radiosity::{Shown, Solution};
use hatbox::render::{RenderOptions, render};
use hatbox::scene::{Camera, Material, Physics, Quantity, Scene, Surface, Texture, Wrap};
use hatbox::space::FunctionSpace;
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;

/// A floor of 2 m × 1 m in the plane z = 0 that faces +z: a quad (or two triangles) of the material `left`, and two
/// triangles to the right of it.
fn floor(quads: bool, bands: usize) -> Scene {
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let vertices = vec![at(0.0, 0.0), at(1.0, 0.0), at(2.0, 0.0), at(0.0, 1.0), at(1.0, 1.0), at(2.0, 1.0)];
    let triangle = |[a, b, c]: [u32; 3], material, surface| Cell {
        shape: Shape::Triangle,
        vertices: [a, b, c, c],
        material,
        group: material,
        surface,
    };
    let quad = Cell { shape: Shape::Quad, vertices: [0, 1, 4, 3], material: 0, group: 0, surface: 0 };
    let left = if quads { vec![quad] } else { vec![triangle([0, 1, 4], 0, 0), triangle([0, 4, 3], 0, 0)] };
    let cells = [left, vec![triangle([1, 2, 5], 1, 1), triangle([1, 5, 4], 1, 2)]].concat();
    let corners = [[0, 1, 4, 3], [1, 2, 5, 5], [1, 5, 4, 4]];
    let surfaces = corners.map(|corners| Surface { corners: corners.map(|v: usize| vertices[v]) });
    let materials = vec![Material::diffuse("left", 0.5), Material::diffuse("right, \"quoted\"", 0.25)];
    let groups = vec!["Böden".to_owned(), "rest".to_owned()];
    let mesh = Mesh { vertices, cells, groups, ..Mesh::default() };
    let fov_y = 2.0 * 0.5_f64.atan();
    let camera = Camera { eye: DVec3::new(1.0, 0.5, 3.0), target: DVec3::new(1.0, 0.5, 0.0), up: DVec3::Y, fov_y };
    Scene {
        mesh: mesh.into(),
        materials,
        hidden: Arc::new([surfaces[1]]),
        surfaces: Arc::new(surfaces),
        bands,
        physics: Physics::Light,
        camera: Some(camera),
        warnings: Vec::new(),
    }
}

/// The given B at every node, and E = B/R, so that B is what is reflected (of textures, E = 2 B).
fn solution(scene: Scene, basis: &str, radiosity: impl Fn(DVec3, usize) -> f64) -> Solution {
    let basis = Basis::named(basis).expect("a basis");
    let space = FunctionSpace::broken(&scene.mesh, basis).expect("an element for every cell");
    let nodes: Vec<DVec3> = (0..space.cells())
        .flat_map(|cell| space.element(cell).nodes.iter().map(move |node| (cell, node.at)))
        .map(|(cell, at)| scene.mesh.patch(cell).point(at))
        .collect();
    let cell_of = |row: usize| space.offsets().partition_point(|&first| first <= row) - 1;
    let reflectance = |row: usize, band: usize| scene.material(cell_of(row)).reflectance.uniform(band).unwrap_or(0.5);
    let field = |of: &dyn Fn(usize, usize) -> f64| {
        MultiVector::from_fn(nodes.len(), scene.bands, |row, band| of(row, band) * radiosity(nodes[row], band))
    };
    let (radiosity, irradiance) = (field(&|_, _| 1.0), field(&|row, band| 1.0 / reflectance(row, band)));
    Solution { scene, space, radiosity, irradiance }
}

/// Something of every basis: smooth, with a negative value and many that no short decimal number is.
fn samples() -> Vec<Solution> {
    let smooth = |p: DVec3, band: usize| (1.0 + band as f64) * (p.x * p.x / 3.0 + p.y) - 0.01;
    let mut samples: Vec<_> =
        hatbox::element::ALL.iter().map(|b| solution(floor(b.quad.is_some(), 3), b.name, smooth)).collect();
    samples.extend([1, 2, 5].map(|bands| solution(floor(true, bands), "bilinear", smooth)));
    samples
}

/// A solution with everything that a scene can have.
fn rich() -> Solution {
    let mut scene = floor(true, 3);
    let texels = (0..2 * 3 * 3).map(|k| k as f32 / 18.0).collect();
    let texture = Arc::new(Texture::new(2, 3, 3, texels, [Wrap::Mirror, Wrap::Clamp]).expect("fits"));
    let textured = |factor: f64| Quantity::Textured { factor: vec![factor], texture: Arc::clone(&texture) };
    scene.materials[0].reflectance = textured(0.7);
    scene.materials[1].exitance = textured(30.0);
    scene.materials[1].two_sided = true;
    set_uvs(Arc::make_mut(&mut scene.mesh));
    Arc::make_mut(&mut scene.mesh).normals = vec![[DVec3::Z; 4]; scene.mesh.cells.len()];
    scene.physics = Physics::Heat;
    solution(scene, "bilinear", |p, band| (p.x + 0.1) / (7.0 + band as f64))
}

fn set_uvs(mesh: &mut Mesh) {
    let uv = |v: u32| DVec2::new(mesh.vertices[v as usize].x, 0.5);
    mesh.uvs = mesh.cells.iter().map(|cell| cell.vertices.map(uv)).collect();
}

fn bits(field: &MultiVector) -> Vec<u64> {
    field.as_slice().iter().map(|v| v.to_bits()).collect()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn entries(folder: &Path) -> usize {
    std::fs::read_dir(folder).expect("the folder").count()
}

#[test]
fn every_output_is_written_by_its_extension_and_leaves_one_file() {
    let view = RenderOptions { width: 32, height: 24, samples: 1, ..RenderOptions::default() };
    let options = WriteOptions { view, ..WriteOptions::default() };
    for output in &OUTPUTS {
        for solution in samples() {
            let folder = folder();
            let path = folder.path().join(format!("out.{}", output.extension.to_uppercase()));
            assert_eq!(writer_for(&path).expect("a writer").extension, output.extension);
            assert_eq!(entries(folder.path()), 0, "asking leaves nothing behind");
            write(&solution, &path, &options).expect("written");
            assert!(path.metadata().expect("a file").len() > 0);
            assert_eq!(entries(folder.path()), 1);
        }
    }
}

#[test]
fn an_unknown_extension_names_the_known_ones() {
    for name in ["out.jpeg", "out", ".glb"] {
        let error = writer_for(Path::new(name)).expect_err("unknown").to_string();
        assert!(error.contains(".glb, .npz, .vtu, .csv, .png, .exr"), "{error}");
    }
    let error = writer_for(Path::new("no/such/folder/out.glb")).expect_err("no folder").to_string();
    assert!(error.contains("`no/such/folder` does not exist"), "{error}");
}

#[test]
fn a_failed_write_leaves_the_folder_as_it_was() {
    let folder = folder();
    let path = folder.path().join("kept.npz");
    std::fs::write(&path, "before").expect("written");
    let error = atomic::write(&path, |file| {
        file.write_all(b"half of it")?;
        Err(std::io::Error::other("the disk is full"))
    });
    let error = error.expect_err("it failed").to_string();
    assert!(error.contains("kept.npz") && error.contains("the disk is full"), "{error}");
    let mut bad = samples().remove(1);
    bad.irradiance.band_mut(2)[3] = f64::NAN;
    for output in &OUTPUTS {
        let path = folder.path().join(format!("bad.{}", output.extension));
        assert!(matches!(write(&bad, &path, &WriteOptions::default()), Err(WriteError::NotFinite { cell: 1 })));
    }
    assert_eq!(std::fs::read(&path).expect("still there"), b"before");
    assert_eq!(entries(folder.path()), 1);
    let as_folder = folder.path().join("f.png");
    std::fs::create_dir(&as_folder).expect("a folder");
    assert!(writer_for(&as_folder).is_err(), "a folder cannot be overwritten");
}

#[cfg(unix)]
#[test]
fn devices_are_written_to_and_links_are_followed() {
    atomic::write(Path::new("/dev/null"), |file| file.write_all(b"x")).expect("written");
    assert!(!Path::new("/dev/null").metadata().expect("still there").is_file());
    let folder = folder();
    let (target, link) = (folder.path().join("target"), folder.path().join("link"));
    std::fs::write(&target, "old").expect("written");
    std::os::unix::fs::symlink(&target, &link).expect("a link");
    atomic::write(&link, |file| file.write_all(b"new")).expect("written");
    assert_eq!(std::fs::read(&target).expect("there"), b"new");
    assert!(link.is_symlink());
}

#[test]
fn a_solution_comes_back_bit_for_bit() {
    let folder = folder();
    for before in samples().into_iter().chain([rich()]) {
        let path = folder.path().join("solution.npz");
        npz::save(&before, &path).expect("written");
        let after = npz::load(&path).expect("read");
        assert_eq!(bits(&before.radiosity), bits(&after.radiosity));
        assert_eq!(bits(&before.irradiance), bits(&after.irradiance));
        assert_eq!(before.scene.mesh, after.scene.mesh);
        assert_eq!(before.scene.surfaces, after.scene.surfaces);
        assert_eq!(before.scene.hidden, after.scene.hidden);
        assert_eq!(before.scene.camera, after.scene.camera);
        assert_eq!((before.scene.physics, before.scene.bands), (after.scene.physics, after.scene.bands));
        assert_eq!(before.space.basis(), after.space.basis());
        assert_eq!(before.space.offsets(), after.space.offsets());
        for (cell, at) in [(0, [0.3, 0.4]), (1, [0.1, 0.2]), (2, [0.5, 0.0])] {
            let (old, new) = (before.scene.material(cell), after.scene.material(cell));
            assert_eq!((&old.name, old.two_sided), (&new.name, new.two_sided));
            let site = before.scene.site(cell, at);
            for band in 0..before.bands() {
                assert_eq!(old.reflectance.at(&site, band).to_bits(), new.reflectance.at(&site, band).to_bits());
                assert_eq!(old.exitance.at(&site, band).to_bits(), new.exitance.at(&site, band).to_bits());
            }
        }
        let again = folder.path().join("again.npz");
        npz::save(&after, &again).expect("written");
        assert!(std::fs::read(&path).expect("there") == std::fs::read(&again).expect("there"), "equal files");
    }
}

type Arrays = BTreeMap<String, Vec<u8>>;

/// The arrays of an archive by name.
fn unzip(path: &Path) -> Arrays {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).expect("there")).expect("an archive");
    let mut arrays = Arrays::new();
    for k in 0..archive.len() {
        let mut entry = archive.by_index(k).expect("an entry");
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).expect("read");
        let name = entry.name().expect("a name").strip_suffix(".npy").expect("an array").to_owned();
        arrays.insert(name, bytes);
    }
    arrays
}

fn rezip(path: &Path, arrays: &Arrays) {
    let mut archive = zip::ZipWriter::new(std::fs::File::create(path).expect("created"));
    for (key, bytes) in arrays {
        archive.start_file(format!("{key}.npy"), zip::write::SimpleFileOptions::default()).expect("started");
        archive.write_all(bytes).expect("written");
    }
    archive.finish().expect("finished");
}

#[test]
fn the_archive_has_the_documented_keys() {
    let folder = folder();
    let path = folder.path().join("solution.npz");
    npz::save(&rich(), &path).expect("written");
    let arrays = unzip(&path);
    let rows = include_str!("../src/io/npz.rs").lines().filter_map(|line| line.strip_prefix("//! | `"));
    let keys = rows.flat_map(|row| row.split('|').next().unwrap_or_default().split(','));
    let mut documented: Vec<&str> = keys.map(|key| key.trim_matches([' ', '`', '…'])).collect();
    documented.sort_unstable();
    assert_eq!(arrays.keys().collect::<Vec<_>>(), documented);
    let shape = |key: &str| Array::parse(&arrays[key]).expect("an array").shape().to_vec();
    assert_eq!(shape("cells"), [3, 4]);
    assert_eq!(shape("radiosity"), [3, 10]);
    assert_eq!(shape("nodes"), [10, 3]);
    assert_eq!(shape("texture_0"), [3, 2, 3]);
    let reflectance = Array::parse(&arrays["reflectance"]).expect("an array").f64s().expect("numbers");
    assert!(reflectance[..3].iter().all(|r| r.is_nan()) && reflectance[3..] == [0.25; 3], "{reflectance:?}");
}

#[test]
fn a_damaged_solution_is_an_error_that_names_the_file() {
    let folder = folder();
    let (path, bad) = (folder.path().join("solution.npz"), folder.path().join("bad.npz"));
    npz::save(&rich(), &path).expect("written");
    let whole = std::fs::read(&path).expect("there");
    for end in (0..whole.len()).step_by(97) {
        std::fs::write(&bad, &whole[..end]).expect("written");
        let error = npz::load(&bad).expect_err("cut off").to_string();
        assert!(error.contains("bad.npz"), "{error}");
    }
    // Damage anywhere is an error or harmless, but never a crash.
    for place in (0..whole.len()).step_by(13) {
        let mut damaged = whole.clone();
        damaged[place] ^= 0x41;
        std::fs::write(&bad, &damaged).expect("written");
        let _ = npz::load(&bad);
    }
    assert!(npz::load(&folder.path().join("missing.npz")).is_err());
}

#[test]
fn no_foreign_array_crashes_the_reader() {
    let folder = folder();
    let (path, bad) = (folder.path().join("solution.npz"), folder.path().join("bad.npz"));
    npz::save(&rich(), &path).expect("written");
    let whole = unzip(&path);
    for (key, bytes) in &whole {
        let mut arrays = whole.clone();
        arrays.remove(key);
        rezip(&bad, &arrays);
        let optional = ["nodes", "continuous", "hidden"].contains(&key.as_str());
        assert_eq!(npz::load(&bad).is_ok(), optional, "without `{key}`");
        let array = Array::parse(bytes).expect("an array");
        let mut others: Vec<_> = [(vec![1], 7_u8), (vec![0], 0), (vec![3], 255), (vec![], 9), (vec![2, 4, 3], 1)]
            .map(|(shape, fill)| npy::encode(&shape, std::iter::repeat_n(fill, shape.iter().product())))
            .into();
        if let Ok(values) = array.f64s() {
            others.push(npy::encode(array.shape(), values.iter().map(|v| v + 1000.0)));
            others.push(npy::encode(array.shape(), values.iter().map(|v| -v - 1.0)));
            let empty: Vec<usize> = array.shape().iter().map(|_| 0).collect();
            others.push(npy::encode::<f64>(&empty, std::iter::repeat_n(0.0, empty.iter().product())));
        }
        for other in others {
            arrays.insert(key.clone(), other);
            rezip(&bad, &arrays);
            let _ = npz::load(&bad);
        }
    }
}

#[test]
fn arrays_that_contradict_each_other_are_errors() {
    let folder = folder();
    let (path, bad) = (folder.path().join("solution.npz"), folder.path().join("bad.npz"));
    npz::save(&rich(), &path).expect("written");
    let whole = unzip(&path);
    let cases = [
        ("cells", npy::encode(&[3, 4], [9_u32; 12]), "index 9 is out of range, there are 6"),
        ("corners", npy::encode(&[3], [3_u8; 3]), "claims 3 corners"),
        ("basis", npy::encode_strings(&[], &["cubic"]), "no basis `cubic`"),
        ("basis", npy::encode_strings(&[], &["linear"]), "split it into triangles"),
        ("hatbox_format", npy::encode(&[], [2]), "format 2"),
        ("irradiance", npy::encode(&[3, 9], [0.0; 27]), "its shape is [3, 9], not [3, 10]"),
        ("vertices", npy::encode(&[6, 3], [f64::NAN; 18]), "not finite"),
        ("reflectance_texture", npy::encode(&[2], [5, -1]), "no texture 5"),
    ];
    for (key, bytes, expected) in cases {
        let mut arrays = whole.clone();
        arrays.insert(key.to_owned(), bytes);
        rezip(&bad, &arrays);
        let error = npz::load(&bad).expect_err(key).to_string();
        assert!(error.contains(expected), "{key}: {error}");
    }
}

#[test]
fn baking_shares_vertices_where_values_agree_and_keeps_jumps() {
    let smooth = |p: DVec3, _: usize| p.x;
    // Each half, a material of its own, has its own vertices: 4 corners, or 9 with the midpoints.
    for (basis, quads, vertices, triangles) in
        [("linear", false, 8, 4), ("bilinear", true, 8, 4), ("constant", true, 10, 4), ("quadratic", false, 18, 16)]
    {
        let baked = bake(&solution(floor(quads, 1), basis, smooth), Shown::Radiosity);
        assert_eq!((baked.positions.len(), baked.triangles.len()), (vertices, triangles), "{basis}");
        assert_eq!(baked.parts.len(), 2);
        if basis != "constant" {
            for (p, value) in baked.positions.iter().zip(baked.values.band(0)) {
                assert!((p.x - value).abs() < 1e-12, "{basis} at {p}");
            }
        }
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| baked.positions[v as usize]);
            0.5 * (b - a).cross(c - a).z
        };
        assert!((baked.triangles.iter().map(area).sum::<f64>() - 2.0).abs() < 1e-12, "{basis} faces the same way");
    }
    let mut jump = solution(floor(false, 1), "linear", smooth);
    jump.irradiance.band_mut(0)[..3].fill(10.0);
    for shown in [Shown::Radiosity, Shown::Irradiance] {
        assert_eq!(bake(&jump, shown).positions.len(), 10, "the jumping triangle has corners of its own");
    }
}

#[test]
fn the_automatic_exposure_ignores_lamps() {
    let mut scene = floor(true, 3);
    scene.materials[1].exitance = Quantity::gray(1e6);
    let lit = solution(scene, "constant", |p, _| if p.x > 1.0 { 1e6 } else { 4.0 });
    let exposure = Exposure::automatic(&lit, Shown::Radiosity);
    assert!((exposure.scale - 0.2).abs() < 1e-12, "{exposure:?}");
    let dark = solution(floor(true, 3), "constant", |_, _| 0.0);
    assert_eq!(Exposure::automatic(&dark, Shown::Radiosity), Exposure { scale: 1.0 });
}

#[test]
fn a_glb_is_read_back_by_the_gltf_crate() {
    let folder = folder();
    for solution in samples().into_iter().chain([rich()]) {
        let path = folder.path().join("out.glb");
        write(&solution, &path, &WriteOptions::default()).expect("written");
        let glb = gltf::Gltf::open(&path).expect("valid glTF");
        let blob = glb.blob.as_deref().expect("a binary chunk");
        let names: Vec<_> = glb.materials().filter_map(|m| m.name().map(str::to_owned)).collect();
        assert_eq!(names, ["left", "right, \"quoted\""]);
        assert_eq!(glb.nodes().filter_map(|n| n.name()).collect::<Vec<_>>(), ["Böden", "rest", "camera"]);
        let baked = bake(&solution, Shown::Radiosity);
        let mut vertices = 0;
        for primitive in glb.meshes().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>()) {
            let reader = primitive.reader(|_| Some(blob));
            let count = reader.read_positions().expect("positions").count();
            let mut colors = reader.read_colors(0).expect("colours").into_rgb_f32().flatten();
            assert!(colors.all(|c| (0.0..=1.0).contains(&c)));
            assert!(reader.read_indices().expect("indices").into_u32().all(|i| (i as usize) < count));
            assert_eq!(radiosity(&primitive, blob, solution.bands()), expected(&baked.values, vertices, count));
            vertices += count;
        }
        assert_eq!(vertices, baked.positions.len());
        let camera = glb.nodes().find(|node| node.camera().is_some()).expect("a camera");
        assert_eq!(camera.transform().decomposed().0, [1.0, 0.5, 3.0]);
    }
}

/// The values of a primitive's vertices, band after band.
fn radiosity(primitive: &gltf::Primitive, blob: &[u8], bands: usize) -> Vec<f32> {
    let values = |name: &str| {
        let accessor = primitive.get(&gltf::Semantic::Extras(name.to_owned())).expect("the attribute");
        let view = accessor.view().expect("a view");
        let bytes = blob[view.offset()..view.offset() + view.length()].as_chunks().0;
        bytes.iter().map(|&b| f32::from_le_bytes(b)).collect::<Vec<_>>()
    };
    match bands {
        1 => values("RADIOSITY"),
        3 => {
            let rows = values("RADIOSITY");
            (0..3).flat_map(|b| rows.iter().skip(b).step_by(3).copied().collect::<Vec<_>>()).collect()
        }
        n => (0..n).flat_map(|b| values(&format!("RADIOSITY_{b}"))).collect(),
    }
}

fn expected(values: &MultiVector, first: usize, count: usize) -> Vec<f32> {
    values.iter_bands().flat_map(|band| band[first..first + count].iter().map(|&v| v as f32)).collect()
}

#[test]
fn the_gltf_camera_looks_the_same_way() {
    let folder = folder();
    let mut solution = samples().remove(0);
    let camera = Camera { eye: DVec3::new(3.0, 4.0, 5.0), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.7 };
    solution.scene.camera = Some(camera);
    let path = folder.path().join("out.glb");
    write(&solution, &path, &WriteOptions::default()).expect("written");
    let glb = gltf::Gltf::open(&path).expect("valid glTF");
    let node = glb.nodes().find(|node| node.camera().is_some()).expect("a camera");
    let matrix = node.transform().matrix();
    let forward = DVec3::from_array([0, 1, 2].map(|k| -f64::from(matrix[2][k])));
    assert!(forward.distance((camera.target - camera.eye).normalize()) < 1e-6, "{forward}");
    assert!(matrix[1][1] > 0.0, "up is up");
}

#[test]
fn a_vtu_holds_the_nodes_in_raw_arrays() {
    let folder = folder();
    let path = folder.path().join("out.vtu");
    for solution in samples() {
        write(&solution, &path, &WriteOptions::default()).expect("written");
        let bytes = std::fs::read(&path).expect("there");
        let start = bytes.windows(2).position(|w| w == b"\n_").expect("appended data") + 2;
        let head = std::str::from_utf8(&bytes[..start]).expect("text");
        let array = |name: &str| {
            let tag = head.split("<DataArray").find(|tag| tag.contains(&format!("Name=\"{name}\"")))?;
            let offset: usize = tag.split("offset=\"").nth(1)?.split('"').next()?.parse().ok()?;
            let (length, data) = bytes[start + offset..].split_first_chunk()?;
            Some(data[..u64::from_le_bytes(*length) as usize].to_vec())
        };
        let radiosity = array("radiosity").expect("an array");
        let radiosity: Vec<f64> = radiosity.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect();
        let bands = solution.bands();
        assert_eq!(radiosity.len(), solution.space.broken_dofs() * bands);
        assert_eq!(radiosity[bands - 1].to_bits(), solution.radiosity.band(bands - 1)[0].to_bits());
        let types = array("types").expect("an array");
        let expected: &[u8] = match (solution.space.basis().name, types.len()) {
            ("quadratic", _) => &[69; 4],
            (_, 3) => &[9, 5, 5],
            _ => &[5; 4],
        };
        assert_eq!(types, expected);
        let in_cells = head.find("Name=\"radiosity\"") > head.find("<CellData>");
        assert_eq!(in_cells, solution.space.basis().name == "constant");
        assert!(bytes.ends_with(b"</VTKFile>\n"));
    }
}

#[test]
fn the_table_of_nodes_is_also_a_table_of_points() {
    let folder = folder();
    let path = folder.path().join("out.csv");
    let solution = solution(floor(true, 2), "bilinear", |p, band| p.x / 3.0 + band as f64);
    write(&solution, &path, &WriteOptions::default()).expect("written");
    let text = std::fs::read_to_string(&path).expect("text");
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "x,y,z,nx,ny,nz,cell,material,E_0,E_1,B_0,B_1");
    let values = [2.0 * (1.0 / 3.0), 2.0 * (1.0 / 3.0 + 1.0), 1.0 / 3.0, 1.0 / 3.0 + 1.0].map(|v: f64| v.to_string());
    assert_eq!(lines[2], format!("1.0,0.0,0.0,0.0,0.0,1.0,0,left,{}", values.join(",")));
    assert!(lines[5].contains("\"right, \"\"quoted\"\"\""), "{}", lines[5]);
    let points = read_points(&path).expect("points");
    assert_eq!(points.len(), solution.space.broken_dofs());
    assert_eq!(points[1].position, DVec3::X);

    for name in ["out.npy", "probe.csv"] {
        let path = folder.path().join(name);
        save_points(&points, &solution.irradiance, &solution.radiosity, &path).expect("written");
    }
    let array = Array::parse(&std::fs::read(folder.path().join("out.npy")).expect("there")).expect("an array");
    assert_eq!(array.shape(), [10, 10]);
    assert_eq!(array.f64s().expect("numbers")[10..16], [1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(read_points(&folder.path().join("probe.csv")).expect("points"), points);
    assert!(matches!(read_points(&folder.path().join("out.npy")), Err(PointsError::Array { .. })));
    let path = folder.path().join("points.npy");
    std::fs::write(&path, npy::encode(&[1, 6], [0.0_f32, 1.0, 2.0, 0.0, 0.0, 1.0])).expect("written");
    assert_eq!(read_points(&path).expect("points")[0].position, DVec3::new(0.0, 1.0, 2.0));
}

/// The floor from above at 10 pixels per metre of a picture 30 pixels high: left half B = (1, 0, 0), right half
/// B = (0, 0.25, 0).
fn two_tones() -> Solution {
    let colors = [[1.0, 0.0, 0.0], [0.0, 0.25, 0.0]];
    solution(floor(true, 3), "constant", |p, band| colors[usize::from(p.x > 1.0)][band])
}

#[test]
fn a_view_of_two_tones_has_the_right_colours_at_the_right_pixels() {
    let options = RenderOptions { width: 40, height: 30, samples: 2, ..RenderOptions::default() };
    let image = render(&two_tones(), &options, &Silent).expect("rendered");
    assert_eq!(image.pixels.len(), 40 * 30);
    let pixel = |x: usize, y: usize| image.pixels[y * 40 + x];
    assert_eq!(pixel(15, 15), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(pixel(25, 15), [0.0, 0.25, 0.0, 1.0]);
    assert_eq!([pixel(0, 0), pixel(20, 3), pixel(39, 29)], [[0.0; 4]; 3], "nothing is there");
    let covered: f32 = image.pixels.iter().map(|p| p[3]).sum();
    assert!((covered - 200.0).abs() < 1e-3, "{covered} pixels of 2 m × 1 m");
    assert_eq!(render(&two_tones(), &options, &Silent), Ok(image));
    let irradiance = RenderOptions { shown: Shown::Irradiance, ..options };
    let image = render(&two_tones(), &irradiance, &Silent).expect("rendered");
    assert_eq!(image.pixels[15 * 40 + 15], [2.0, 0.0, 0.0, 1.0]);
}

#[test]
fn backs_are_see_through() {
    let mut solution = two_tones();
    if let Some(camera) = &mut solution.scene.camera {
        camera.eye.z = -3.0;
    }
    let image = render(&solution, &RenderOptions { width: 20, height: 20, ..RenderOptions::default() }, &Silent);
    assert!(image.expect("rendered").pixels.iter().all(|p| *p == [0.0; 4]));
}

#[test]
fn a_texture_is_crisp_however_coarse_the_elements_are() {
    let mut solution = two_tones();
    let texture = Texture::new(2, 1, 1, vec![0.0, 1.0], [Wrap::Clamp; 2]).expect("fits");
    solution.scene.materials[0].reflectance = Quantity::Textured { factor: vec![0.5], texture: Arc::new(texture) };
    set_uvs(Arc::make_mut(&mut solution.scene.mesh));
    let options = RenderOptions { width: 40, height: 30, samples: 1, ..RenderOptions::default() };
    let image = render(&solution, &options, &Silent).expect("rendered");
    // E = 2 and R = 0.5 × texture.
    assert_eq!(image.pixels[15 * 40 + 11], [0.0, 0.0, 0.0, 1.0]);
    assert_eq!(image.pixels[15 * 40 + 19], [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(image.pixels[15 * 40 + 25], [0.0, 0.25, 0.0, 1.0], "uniform materials show the expansion");
}

#[test]
fn rendering_can_be_interrupted() {
    struct Stop;
    impl Progress for Stop {
        fn interrupted(&self) -> bool {
            true
        }
    }
    assert_eq!(render(&two_tones(), &RenderOptions::default(), &Stop), Err(Interrupted));
    let folder = folder();
    let options = WriteOptions { progress: &Stop, ..WriteOptions::default() };
    let result = write(&two_tones(), &folder.path().join("out.png"), &options);
    assert!(matches!(result, Err(WriteError::Interrupted(_))));
    assert_eq!(entries(folder.path()), 0);
}

#[test]
fn pictures_have_the_size_and_the_colours_that_were_asked_for() {
    let folder = folder();
    let path = folder.path().join("out.png");
    let view = RenderOptions { width: 400, height: 300, samples: 1, ..RenderOptions::default() };
    let options = WriteOptions { view, exposure: Some(Exposure { scale: 0.5 }), ..WriteOptions::default() };
    write(&two_tones(), &path, &options).expect("written");
    let picture = image::open(&path).expect("a picture").into_rgba8();
    assert_eq!(picture.dimensions(), (400, 300));
    // sRGB of 0.5 and of 0.125.
    assert_eq!(picture.get_pixel(150, 150).0, [188, 0, 0, 255]);
    assert_eq!(picture.get_pixel(250, 150).0, [0, 99, 0, 255]);
    assert_eq!(picture.get_pixel(0, 0).0, [0; 4]);

    let path = folder.path().join("out.exr");
    write(&two_tones(), &path, &options).expect("written");
    let picture = image::open(&path).expect("a picture").into_rgba32f();
    assert_eq!(picture.dimensions(), (400, 300));
    assert_eq!(picture.get_pixel(250, 150).0, [0.0, 0.25, 0.0, 1.0]);

    let path = folder.path().join("false.png");
    write(&two_tones(), &path, &WriteOptions { false_color: true, ..options }).expect("written");
    let picture = image::open(&path).expect("a picture").into_rgb8();
    assert_eq!(picture.dimensions(), (400, 300));
    let levels = [picture.get_pixel(110, 150), picture.get_pixel(210, 150), picture.get_pixel(0, 0)];
    assert!(levels[0] != levels[1] && levels[1] != levels[2], "{levels:?}");
}
