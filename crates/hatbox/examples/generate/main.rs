//! Writes a scene of any size: `cargo run --release -p hatbox --example generate -- KIND --elements N -o FILE.glb`.
//!
//! N is the number of triangles in the file, about; `hatbox solve --elements` subdivides further.

mod kinds;

use std::process::ExitCode;

fn main() -> ExitCode {
    run().map_or_else(
        |error| {
            eprintln!("{error}");
            ExitCode::FAILURE
        },
        |()| ExitCode::SUCCESS,
    )
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let (mut kind, mut elements, mut output) = (None, 1000, None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--elements" => elements = arguments.next().ok_or("--elements wants a number")?.parse()?,
            "-o" => output = arguments.next(),
            name => kind = kinds::ALL.iter().find(|kind| kind.name == name),
        }
    }
    let (Some(kind), Some(output)) = (kind, output) else {
        let kinds: Vec<String> = kinds::ALL.iter().map(|kind| format!("  {:<10}{}", kind.name, kind.summary)).collect();
        return Err(format!("usage: generate KIND --elements N -o FILE.glb\n{}", kinds.join("\n")).into());
    };
    let model = (kind.make)(elements);
    std::fs::write(&output, model.to_glb())?;
    println!("{output}: {} triangles", model.triangles());
    Ok(())
}
