//! What is wrong is said, with file, place and remedy, and nothing is left behind.

use crate::{CUBE, FEW, Folder, hatbox, sample, text};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

/// Runs a command that must fail, leave no new file, and say all of the words.
#[track_caller]
pub(crate) fn fail(folder: &Folder, status: i32, command: &mut Command, words: &[&str]) {
    let before = folder.names();
    let output = command.output().expect("the binary runs");
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{command:?}: {message}");
    assert!(output.stdout.is_empty(), "{}", text(&output.stdout));
    for word in words {
        assert!(message.contains(word), "`{word}` is missing in\n{message}");
    }
    assert!(!message.contains("panicked"), "{message}");
    assert_eq!(folder.names(), before, "nothing is written");
}

/// Fails to solve a file with that content: status 1, and a message that names the file.
#[track_caller]
fn fail_to_solve(folder: &Folder, name: &str, content: impl AsRef<[u8]>, words: &[&str]) {
    let scene = folder.file(name, content);
    let output = folder.path("out.npz");
    fail(folder, 1, hatbox().arg("solve").arg(&scene).args(FEW).arg("-o").arg(output), &[&[name], words].concat());
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn bad_scenes_get_a_message_with_file_place_and_remedy() {
    let folder = Folder::new();
    let missing = folder.path("missing.obj");
    fail(&folder, 1, hatbox().arg("solve").arg(&missing), &["missing.obj", "cannot be read", "check the path"]);
    fail_to_solve(&folder, "nan.obj", "v 0 0 0\nv nan 0 0\nv 1 1 0\nf 1 2 3\n", &["line 4", "vertex 2", "help"]);
    fail_to_solve(&folder, "index.obj", format!("{SQUARE}f 1 2 9\n"), &["line 5", "9", "help"]);
    fail_to_solve(&folder, "empty.obj", "# nothing\n", &["the scene is empty", "export"]);
    fail_to_solve(&folder, "scene.xyz", "", &["extension", ".obj", ".glb"]);
    let whole = std::fs::read(sample("cornell-box.glb")).expect("the sample");
    fail_to_solve(&folder, "truncated.glb", &whole[..whole.len() / 2], &["help"]);
    folder.file("bright.mtl", "newmtl paint\nKd 1.4 0.2 0.2\n");
    let scene = folder.file("bright.obj", format!("mtllib bright.mtl\n{SQUARE}usemtl paint\nf 1 2 3 4\n"));
    fail(&folder, 1, hatbox().arg("solve").arg(scene), &["bright.mtl", "paint", "1.4", "between 0 and 1"]);
}

/// The sample with an f32 NaN in place of the first number of its binary chunk: a position.
#[test]
fn positions_that_are_no_number_are_found_in_binary_files() {
    let folder = Folder::new();
    let mut bytes = std::fs::read(sample("cornell-box.glb")).expect("the sample");
    let text_length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    bytes[20 + text_length + 8..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    fail_to_solve(&folder, "nan.glb", bytes, &["node `floor`", "vertex 0", "help"]);
}

#[test]
fn mistakes_in_scene_files_are_shown_underlined() {
    let folder = Folder::new();
    folder.file("square.obj", format!("{SQUARE}usemtl paint\nf 1 2 3 4\n"));
    let mesh = "[[mesh]]\nfile = \"square.obj\"\n";
    let unknown = format!("{mesh}[material.paint]\nreflectence = 0.5\n");
    fail_to_solve(
        &folder,
        "unknown.toml",
        unknown,
        &["line 4", "reflectence = 0.5", "unknown field", "did you mean `reflectance`?"],
    );
    let bright = format!("{mesh}[material.paint]\nreflectance = 1.4\n");
    fail_to_solve(&folder, "bright.toml", bright, &["line 4", "reflectance = 1.4", "between 0 and 1"]);
}

#[test]
fn bad_outputs_are_refused_before_the_work() {
    let folder = Folder::new();
    let solve = |scene: &Path, output: &Path| {
        let mut command = hatbox();
        command.arg("solve").arg(scene).args(["--elements", "100000"]).arg("-o").arg(output);
        command
    };
    let scene = sample(CUBE);
    fail(&folder, 1, &mut solve(&scene, &folder.path("out.jpg")), &["out.jpg", ".png", ".npz"]);
    fail(&folder, 1, &mut solve(&scene, &folder.path("nowhere/out.npz")), &["nowhere", "does not exist", "help"]);
    let input = folder.file("scene.glb", std::fs::read(sample("cornell-box.glb")).expect("the sample"));
    fail(&folder, 1, &mut solve(&input, &input), &["scene.glb", "destroy the input"]);
    let twice = folder.path("out.npz");
    std::fs::create_dir(folder.path("inner")).expect("a folder");
    for again in [twice.clone(), folder.path("inner/../out.npz")] {
        fail(&folder, 2, solve(&scene, &twice).arg("-o").arg(&again), &["named twice"]);
    }
    fail(&folder, 1, hatbox().arg("factors").arg(&scene).args(["-o", "f.glb"]), &["f.glb", ".mtx"]);
}

#[test]
fn a_focus_on_nothing_is_refused_before_the_work() {
    let folder = Folder::new();
    folder.file("square.mtl", "newmtl floor\nKd 0.5 0.5 0.5\n");
    let scene = folder.file("square.obj", format!("mtllib square.mtl\n{SQUARE}usemtl floor\nf 1 2 3 4\n"));
    for (focus, expected) in [
        ("flor", ["`flor`", "did you mean `floor`?"]),
        ("ceiling", ["`ceiling`", "one of: "]),
        ("5,5,5;6,6,6", ["between [5, 5, 5] and [6, 6, 6]", "the scene lies between"]),
    ] {
        fail(&folder, 1, hatbox().arg("solve").arg(&scene).args(["--focus", focus]), &expected);
    }
    folder.file("square.mtl", "newmtl floor\nKd 0 0 0\n");
    let expected = ["nothing of `floor` reflects light", "0.001"];
    fail(&folder, 1, hatbox().arg("solve").arg(&scene).args(["--focus", "floor"]), &expected);
}

/// Before, nothing was said, and the error was about 0 %.
#[test]
fn a_lamp_whose_light_arrives_nowhere_is_warned_of() {
    let folder = Folder::new();
    folder.file("square.mtl", "newmtl lamp\nKd 0.5 0.5 0.5\nKe 1 1 1\nnewmtl wall\nKd 0.5 0.5 0.5\n");
    let lamp = format!("mtllib square.mtl\n{SQUARE}usemtl lamp\nf 1 2 3 4\n");
    // A wall above it, whose front is the upper or the lower side.
    let wall = |order: &str| format!("{lamp}v 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nusemtl wall\nf {order}\n");
    for (scene, warned) in [(lamp.clone(), false), (wall("5 6 7 8"), true), (wall("8 7 6 5"), false)] {
        let scene = folder.file("square.obj", scene);
        let output = hatbox().arg("solve").arg(&scene).args(["--json"]).output().expect("the binary runs");
        assert_eq!(text(&output.stderr).contains("arrives at any surface"), warned);
        let report: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!(report["warnings"].to_string().contains("`hatbox check`"), warned, "{}", report["warnings"]);
    }
}

#[test]
fn more_elements_than_memory_are_refused() {
    let folder = Folder::new();
    for command in [["solve", "--operator=dense"], ["factors", "--threads=2"]] {
        let refused = ["cube.obj", "more than the", "fewer"];
        fail(&folder, 1, hatbox().args(command).arg(sample(CUBE)).args(["--elements", "300000"]), &refused);
    }
}

#[test]
fn wrong_usage_has_status_2() {
    let folder = Folder::new();
    let scene = sample(CUBE);
    let wrong: [&[&str]; 7] = [
        &["--basis", "cubic"],
        &["--tolerance", "0"],
        &["--tolerance", "200%"],
        &["--max-edge", "5 furlongs"],
        &["--max-edge", "1", "--elements", "10"],
        &["--threads", "0"],
        &["--camera", "1,2,3"],
    ];
    for arguments in wrong {
        fail(&folder, 2, hatbox().arg("solve").arg(&scene).args(arguments), &[arguments[0]]);
    }
    fail(&folder, 2, hatbox().arg("sovle").arg(&scene), &["solve"]);
    fail(&folder, 2, &mut hatbox(), &["Usage"]);
}

#[test]
fn check_says_what_cannot_be_read() {
    let folder = Folder::new();
    let broken = folder.file("broken.obj", format!("{SQUARE}f 1 2 9\n"));
    fail(&folder, 1, hatbox().arg("check").arg(&broken), &["broken.obj", "line 5"]);
    let output = hatbox().arg("check").arg(&broken).arg("--json").output().expect("the binary runs");
    let report: Value = serde_json::from_slice(&output.stdout).expect("one object");
    assert_eq!((output.status.code(), report["ok"].as_bool()), (Some(1), Some(false)));
}

#[cfg(unix)]
#[test]
fn an_interrupted_solve_leaves_nothing() {
    let folder = Folder::new();
    let mut command = hatbox();
    command.arg("solve").arg(sample("cornell-box.glb")).args(["--elements", "20000", "--basis", "constant"]);
    command.arg("--tolerance=1e-5").arg("-o").arg(folder.path("out.npz"));
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary runs");
    std::thread::sleep(std::time::Duration::from_secs(2));
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(sent.success());
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    assert!(output.stdout.is_empty() && text(&output.stderr).contains("interrupted"));
    assert_eq!(folder.names(), [""; 0]);
}
