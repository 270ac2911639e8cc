//! Work that is killed and goes on.

use crate::failures::fail;
use crate::{CUBE, Folder, hatbox, sample, solve_cube, succeed, text};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Bytes of a checkpoint without work.
const HEADER: u64 = 16;

fn solve(output: &Path) -> Command {
    let mut command = hatbox();
    command.arg("solve").arg(sample("two-rooms.glb")).args(["--operator", "hierarchical", "--elements", "1500"]);
    command.args(["--tolerance", "4%", "--json", "-o"]).arg(output);
    command
}

/// The process is killed sooner and later, wherever it happens to be; the last run finds what the others have left.
#[test]
fn what_is_killed_goes_on_to_the_same_bits() {
    let folder = Folder::new();
    let [whole, resumed, checkpoint] = ["whole.vtu", "resumed.vtu", "work"].map(|name| folder.path(name));
    succeed(&mut solve(&whole));
    for attempt in 1..6 {
        let mut command = solve(&resumed);
        let mut child = command
            .arg("--checkpoint")
            .arg(&checkpoint)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("it runs");
        std::thread::sleep(Duration::from_millis(40 * attempt));
        let _ = child.kill();
        child.wait().expect("it ends");
    }
    let size = std::fs::metadata(&checkpoint).map_or(0, |found| found.len());
    let told = text(&succeed(solve(&resumed).arg("--checkpoint").arg(&checkpoint)).stderr);
    assert_eq!(told.contains("of finished work in the checkpoint"), size > HEADER, "{size} bytes: {told}");
    let [a, b] = [&whole, &resumed].map(|path| std::fs::read(path).expect("an output"));
    assert!(a == b, "a run that was killed has another result");
    assert!(!checkpoint.exists(), "it is removed when the work is done");
}

/// It was removed when it had been written.
#[test]
fn a_checkpoint_that_is_an_output_is_refused() {
    let folder = Folder::new();
    let output = folder.path("out.npz");
    std::fs::create_dir(folder.path("inner")).expect("a folder");
    for checkpoint in [output.clone(), folder.path("inner/../out.npz")] {
        let mut command = solve_cube();
        command.arg("-o").arg(&output).arg("--checkpoint").arg(checkpoint);
        fail(&folder, 1, &mut command, &["out.npz", "removed when the work is done", "another name"]);
    }
}

#[test]
fn a_checkpoint_of_something_else_is_refused() {
    let folder = Folder::new();
    let precious = folder.file("precious", "a file of the user's own");
    let mut command = hatbox();
    command.arg("solve").arg(sample(CUBE)).args(["--elements", "24", "--checkpoint"]).arg(&precious);
    fail(&folder, 1, &mut command, &["precious", "is not a checkpoint of this work", "help"]);
    assert_eq!(std::fs::read_to_string(&precious).expect("it is there"), "a file of the user's own");
}
