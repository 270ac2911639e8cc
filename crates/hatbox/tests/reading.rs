//! Reading scenes: what each format's values become, and what the errors say.

#[path = "../examples/make_scenes/samples/mod.rs"]
mod samples;

#[path = "reading/bad_input.rs"]
mod bad_input;
#[path = "reading/geometry.rs"]
mod geometry;
#[path = "reading/gltf.rs"]
mod gltf;
#[path = "reading/obj.rs"]
mod obj;
#[path = "reading/sample_scenes.rs"]
mod sample_scenes;
#[path = "reading/scene_file.rs"]
mod scene_file;
#[path = "reading/vs3.rs"]
mod vs3;

use glam::{DVec2, DVec3};
use hatbox::io::{RawScene, ReadError, read_raw};
use hatbox::scene::{Material, Quantity, Site};
use std::path::{Path, PathBuf};

/// A folder with files that lives as long as the value.
struct Files(tempfile::TempDir);

impl Files {
    fn new(files: &[(&str, &[u8])]) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for (name, content) in files {
            std::fs::write(folder.path().join(name), content).expect("writing a test file");
        }
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str) -> Result<RawScene, ReadError> {
        read_raw(&self.path(name))
    }
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes").join(name)
}

fn material<'a>(scene: &'a RawScene, name: &str) -> &'a Material {
    scene.materials.iter().find(|material| material.name == name).expect("the material is there")
}

/// The three bands of a quantity at (u, v).
fn rgb(quantity: &Quantity, u: f64, v: f64) -> [f64; 3] {
    let site = Site { position: DVec3::ZERO, uv: DVec2::new(u, v) };
    [0, 1, 2].map(|band| quantity.at(&site, band))
}

#[track_caller]
fn assert_close(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
    let far = (0..3).any(|k| (found[k] - expected[k]).abs() > tolerance * expected[k].abs().max(1.0));
    assert!(!far, "{found:?} instead of {expected:?}");
}

/// A PNG of the given texels, row by row.
fn png(width: u32, texels: &[[u8; 3]]) -> Vec<u8> {
    let height = texels.len() as u32 / width;
    let picture = image::RgbImage::from_raw(width, height, texels.concat()).expect("the texels fit");
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).expect("PNG in memory");
    bytes.into_inner()
}
