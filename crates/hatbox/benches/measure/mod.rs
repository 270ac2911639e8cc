//! What the benches share: scenes by name, and what a process has used.

#[path = "../../examples/generate/kinds/mod.rs"]
pub(crate) mod kinds;

use hatbox::io::read_scene;
use hatbox::scene::Scene;
use std::path::Path;

/// Seconds of CPU time of this process, as Linux tells; 0 elsewhere.
pub(crate) fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<f64> = text.split_whitespace().map(|word| word.parse().unwrap_or(0.0)).collect();
    fields.get(13).zip(fields.get(14)).map_or(0.0, |(user, system)| (user + system) / 100.0)
}

/// The most memory that this process has held, in megabytes, as Linux tells; 0 elsewhere.
pub(crate) fn peak_megabytes() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
    // What Linux calls kB are 1024 bytes.
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<f64>().ok()).unwrap_or(0.0) * 1024e-6
}

/// The scene of a kind of the generator with about so many faces, or a sample or test scene by the name of its file.
pub(crate) fn scene(name: &str, faces: usize) -> Scene {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let Some(kind) = kinds::ALL.iter().find(|kind| kind.name == name) else {
        let places = [root.join("../../scenes"), root.join("tests/data")];
        let file = places.iter().map(|place| place.join(name)).find(|path| path.exists());
        return read_scene(&file.expect("a scene")).expect("a scene").0;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, (kind.make)(faces).to_glb()).expect("written");
    read_scene(&path).expect("a scene").0
}
