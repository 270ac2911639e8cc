//! Writes the sample scenes into `scenes/`: `cargo run --release -p hatbox --example make_scenes [FOLDER]`.

mod samples;

use std::path::Path;

fn main() -> std::io::Result<()> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    let folder = std::env::args_os().nth(1).map_or(default, Into::into);
    std::fs::create_dir_all(&folder)?;
    for (name, bytes) in samples::all() {
        std::fs::write(folder.join(name), bytes)?;
        println!("{name}");
    }
    Ok(())
}
