//! The binary as its users meet it: what it prints, what it writes, how it ends.

#[path = "cli/checkpoints.rs"]
mod checkpoints;
#[path = "cli/factors.rs"]
mod factors;
#[path = "cli/failures.rs"]
mod failures;
#[path = "cli/solutions.rs"]
mod solutions;

use failures::fail;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A scene that is solved in no time …
const CUBE: &str = "cube.obj";
/// … with so few elements.
const FEW: [&str; 2] = ["--elements", "24"];

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes").join(name)
}

fn hatbox() -> Command {
    Command::new(env!("CARGO_BIN_EXE_hatbox"))
}

/// `hatbox solve` of the cube.
fn solve_cube() -> Command {
    let mut command = hatbox();
    command.arg("solve").arg(sample(CUBE)).args(FEW);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A folder for the files of one test.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn file(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.path(name), content).expect("writing a test file");
        self.path(name)
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).expect("the folder");
        let name = |entry: std::io::Result<std::fs::DirEntry>| entry.expect("an entry").file_name();
        let mut names: Vec<String> = entries.map(|entry| name(entry).to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

#[track_caller]
fn succeed(command: &mut Command) -> Output {
    let output = command.output().expect("the binary runs");
    assert!(output.status.success(), "{command:?}: {}", text(&output.stderr));
    output
}

/// The one JSON object on standard output.
#[track_caller]
fn json(command: &mut Command) -> Value {
    let output = succeed(command);
    let mut values = serde_json::Deserializer::from_slice(&output.stdout).into_iter();
    let value = values.next().expect("an object").expect("valid JSON");
    assert!(values.next().is_none(), "more than one value on standard output");
    value
}

#[test]
fn solve_reports_in_json_and_writes_every_format() {
    let folder = Folder::new();
    let mut command = solve_cube();
    command.args(["--json", "--width", "32", "--height", "24"]);
    for output in &hatbox::io::OUTPUTS {
        command.arg("-o").arg(folder.path(&format!("out.{}", output.extension)));
    }
    let report = json(&mut command);
    let keys = "/elements /dofs /basis /continuity /bands /operator/kind /operator/bytes /operator/recast /operator/rays \
                /operator/pairs /operator/seconds /operator/quadrature_error /operator/visibility_error \
                /solver/kind /solver/iterations /solver/residual /solver/seconds /energy/emitted /energy/leaving \
                /energy/absorbed /energy/escaped /energy/defect /closure/escape /closure/deficit /closure/balanced \
                /parts/0/object /parts/0/material /parts/0/net/0 /parts/0/least_irradiance/0 /error/estimate /error/residual /seconds /peak_bytes /outputs /warnings";
    for key in keys.split(' ') {
        assert!(report.pointer(key).is_some(), "{key} is missing in {report:#}");
    }
    assert_eq!((&report["error"]["kind"], &report["continuity"]), (&"estimated".into(), &"continuous".into()));
    assert!(report["energy"]["defect"].as_f64().is_some_and(|defect| defect < 1e-9));
    assert_eq!(folder.names().len(), hatbox::io::OUTPUTS.len());
    assert_eq!(report["outputs"].as_array().map(Vec::len), Some(hatbox::io::OUTPUTS.len()));
}

#[test]
fn solve_tells_people_what_it_did() {
    let output = succeed(&mut solve_cube());
    let summary = text(&output.stdout);
    let words =
        ["Scene", "6 faces", "elements", "lm emitted", "pairs", "iterations", "estimated", "nothing; name files"];
    for word in words {
        assert!(summary.contains(word), "`{word}` is missing in\n{summary}");
    }
    assert!(!summary.contains("escaped"), "the cube is closed:\n{summary}");
    let rays = text(&succeed(solve_cube().args(["--operator", "sampled"])).stdout);
    assert!(rays.contains("row sums were exact") && !rays.contains("cast again"), "{rays}");
    let recast = text(&succeed(solve_cube().args(["--operator", "sampled", "--memory", "1K"])).stdout);
    assert!(recast.contains("does not hold the rays of 100 % of the elements: they are cast again"), "{recast}");
    assert!(!summary.contains('\x1b'), "no colours in a pipe");
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
    assert!(succeed(solve_cube().arg("--quiet")).stdout.is_empty());
}

#[test]
fn a_scene_without_light_is_warned_of() {
    let folder = Folder::new();
    let dark = folder.file("dark.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
    let output = succeed(hatbox().arg("solve").arg(dark).args(FEW));
    assert!(text(&output.stderr).contains("warning: nothing shines"), "{}", text(&output.stderr));
}

#[test]
fn every_choice_of_the_library_can_be_made() {
    let operators = hatbox::exchange::ALL.iter().map(|kind| kind.name).chain(["auto"]);
    let solvers = hatbox::solve::ALL.iter().map(|solver| solver.name).chain(["auto"]);
    let continuities = hatbox::space::Continuity::NAMES.map(|(name, _)| name);
    let choices: [(&str, Vec<&str>); 4] = [
        ("--basis", hatbox::element::ALL.iter().map(|basis| basis.name).collect()),
        ("--operator", operators.collect()),
        ("--solver", solvers.collect()),
        ("--continuity", continuities.to_vec()),
    ];
    let help = text(&succeed(hatbox().args(["solve", "--help"])).stdout);
    for (option, names) in choices {
        for name in names {
            assert!(help.contains(name), "{name} is not in the help");
            let report = json(solve_cube().args([option, name, "--json"]));
            assert!(report["elements"].as_u64().is_some_and(|elements| elements >= 24), "{option} {name}");
        }
    }
    for extension in hatbox::io::OUTPUTS.iter().map(|output| output.extension) {
        assert!(help.contains(&format!(".{extension} ")), "{extension} is not in the help");
    }
}

#[test]
fn lengths_and_tolerances_are_understood() {
    let mut command = hatbox();
    command.arg("solve").arg(sample(CUBE)).args(["--max-edge", "50 cm", "--basis", "bilinear"]);
    let report = json(command.args(["--tolerance", "2%", "--json"]));
    assert_eq!(report["elements"], 24);
}

#[test]
fn a_tolerance_is_reached_or_it_is_said_that_it_is_not() {
    let solve = |more: &[&str]| {
        let mut command = hatbox();
        command.arg("solve").arg(sample("cube.toml")).args(more);
        command
    };
    let report = json(solve(&["--tolerance", "20%", "--json"]).args(["--gather", "--grading", "1.5"]));
    assert_eq!(report["adaptivity"]["reached"], true);
    assert!(report["error"]["estimate"].as_f64().is_some_and(|error| error <= 0.2), "{report:#}");
    let text = text(&succeed(&mut solve(&["--tolerance", "0.01%", "--max-unknowns", "3000"])).stdout);
    assert!(text.contains("NOT reached: the next mesh") && text.contains("3000"), "{text}");
    assert!(text.contains("point by point"), "{text}");
    let unrefined = self::text(&succeed(&mut solve(&["--tolerance", "0.01%", "--max-unknowns", "100"])).stdout);
    assert!(unrefined.contains("NOT reached: the mesh was not refined"), "{unrefined}");
    let folder = Folder::new();
    fail(&folder, 1, &mut solve(&["--focus", "nowhere"]), &["--focus", "use a box"]);
}

#[test]
fn a_certificate_says_more_than_the_estimate_and_what_has_none_is_refused_before_the_work() {
    let solve = |scene: &Path, more: &[&str]| {
        let mut command = hatbox();
        command.arg("solve").arg(scene).arg("--certify").args(more);
        command
    };
    let given = ["--elements", "48", "--basis", "constant"];
    let report = json(solve(&sample(CUBE), &given).arg("--json"));
    let [estimate, bound] = [&report["error"]["estimate"], &report["certificate"]["bound"]].map(Value::as_f64);
    assert!(estimate.is_some() && bound > estimate && bound < Some(1.0), "{report:#}");
    let text = text(&succeed(&mut solve(&sample(CUBE), &given)).stdout);
    assert!(text.contains("Certified at most"), "{text}");
    let folder = Folder::new();
    // What is written is what is certified.
    let written = folder.path("gathered.npz");
    let gathered = json(solve(&sample(CUBE), &["--elements", "48", "--gather", "--json", "-o"]).arg(&written));
    let solution = hatbox::io::npz::load(&written).expect("a solution");
    let found = hatbox::certificate::certify(&solution, &hatbox::progress::Silent).expect("certified");
    assert_eq!(gathered["certificate"]["bound"].as_f64(), Some(found.relative));
    let trapezium = folder.file("floor.obj", "v 0 0 0\nv 1 0 0\nv 0.7 1 0\nv 0.2 1 0\nf 1 2 3 4\n");
    fail(&folder, 1, &mut solve(&trapezium, &["--elements", "10"]), &["cell 0", "split the quads"]);
    succeed(&mut solve(&trapezium, &["--elements", "10", "--basis", "constant"]));
}

/// Right below a lamp there may be nearly all of what errors are relative to, and much larger errors elsewhere.
#[test]
fn a_norm_that_little_of_the_area_decides_is_told() {
    let folder = Folder::new();
    folder.file("site.mtl", "newmtl lamp\nKd 0 0 0\nKe 1e4 1e4 1e4\nnewmtl gray\nKd 0.5 0.5 0.5\n");
    let square = |half: f64, z: f64| {
        format!("v -{half} -{half} {z}\nv {half} -{half} {z}\nv {half} {half} {z}\nv -{half} {half} {z}\n")
    };
    let faces =
        "mtllib site.mtl\no ground\nusemtl gray\nf 1 2 3 4\no post\nf 5 6 7 8\no lamp\nusemtl lamp\nf 9 12 11 10\n";
    let scene = folder.file("site.obj", &(square(20.0, 0.0) + &square(0.05, 3.9) + &square(0.01, 4.0) + faces));
    let solve = |more: &[&str]| text(&succeed(hatbox().arg("solve").arg(&scene).args(more)).stdout);
    let said = "of the area (`post`); the rest may err by more: see --focus";
    assert!(solve(&[]).contains(said) && !solve(&["--focus", "ground"]).contains("see --focus"));
    folder.file("site.mtl", "newmtl lamp\nKd 0 0 0\nKe 1e4 1e4 1e4\nnewmtl gray\nKd 0 0 0\n");
    assert!(!solve(&[]).contains("see --focus"), "nothing is reflected");
}

#[test]
fn joined_functions_that_cannot_follow_bends_are_named() {
    let folder = Folder::new();
    folder.file("roof.mtl", "newmtl lamp\nKd 0 0 0\nKe 1 1 1\nnewmtl roof\nKd 0.5 0.5 0.5\n");
    let roof = folder.file(
        "roof.obj",
        "mtllib roof.mtl\nv -1 0 -0.2\nv -1 1 -0.2\nv 0 0 0\nv 0 1 0\nv 1 0 -0.2\nv 1 1 -0.2\nv 2 0 2\nv 2 1 2\nv 3 1 2\n\
         v 3 0 2\nusemtl roof\nf 1 3 4 2\nf 3 5 6 4\nusemtl lamp\nf 7 8 9 10\n",
    );
    for (continuity, advised) in [("continuous", true), ("broken", false)] {
        let mut command = hatbox();
        command.arg("solve").arg(&roof).args(["--tolerance", "0.01%", "--max-unknowns", "500"]);
        let text = text(&succeed(command.args(["--continuity", continuity])).stdout);
        assert_eq!((text.contains("NOT reached"), text.contains("`--continuity broken`")), (true, advised), "{text}");
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let folder = Folder::new();
    let solve = |threads: &str| {
        let path = folder.path(&format!("{threads}.npz"));
        let mut command = hatbox();
        command.arg("solve").arg(sample("cornell-box.glb")).args(["--elements", "150", "--threads", threads]);
        succeed(command.arg("-o").arg(&path));
        std::fs::read(path).expect("the solution")
    };
    assert!(solve("1") == solve("2"));
}

#[test]
fn factors_of_the_cube() {
    let folder = Folder::new();
    let outputs = ["f.npz", "f.mtx", "f.csv"].map(|name| folder.path(name));
    let mut command = hatbox();
    command.arg("factors").arg(sample(CUBE)).args(["--json", "--tolerance", "1e-6"]);
    for output in &outputs {
        command.arg("-o").arg(output);
    }
    let report = json(&mut command);
    assert_eq!((report["elements"].as_u64(), report["closed"].as_bool()), (Some(6), Some(true)));
    for key in ["max_row_sum_error", "max_reciprocity_error"] {
        assert!(report[key].as_f64().is_some_and(|error| error < 1e-5), "{key}: {report:#}");
    }
    assert!(report["rays"].is_u64() && report["seconds"].is_f64());
    assert!(outputs.iter().all(|output| output.metadata().is_ok_and(|file| file.len() > 0)));
    let summary = text(&succeed(hatbox().arg("factors").arg(sample(CUBE)).arg("--groups=material")).stdout);
    assert!(summary.contains("in 2 groups") && summary.contains("ceiling"), "{summary}");
    assert_eq!((report["tolerance"].as_f64(), report["reached"].as_bool()), (Some(1e-6), Some(true)));
    assert!(!summary.contains("that was asked for"), "{summary}");
    let asked = ["--tolerance", "1e-15"];
    let report = json(hatbox().arg("factors").arg(sample(CUBE)).arg("--json").args(asked));
    assert_eq!(report["reached"].as_bool(), Some(false), "{report:#}");
    let summary = text(&succeed(hatbox().arg("factors").arg(sample(CUBE)).args(asked)).stdout);
    assert!(summary.contains("more than the 1.0e-15 that was asked for"), "{summary}");
}

#[test]
fn check_finds_small_lamps_far_away() {
    let folder = Folder::new();
    folder.file("far.mtl", "newmtl lamp\nKd 0 0 0\nKe 1 1 1\nnewmtl floor\nKd 0.5 0.5 0.5\n");
    // A square metre at 300 m, which one ray in a quarter of a million meets.
    let scene = "mtllib far.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 300\nv 0 1 300\nv 1 1 300\nv 1 0 300\n\
                 usemtl floor\nf 1 2 3 4\nusemtl lamp\nf 5 6 7 8\n";
    let report = text(&succeed(hatbox().arg("check").arg(folder.file("far.obj", scene))).stdout);
    assert!(!report.contains("no light reaches"), "{report}");
    // Among three hundred that shine the other way.
    let vertices = "v 0 0 -1\nv 0 1 -1\nv 1 1 -1\nv 1 0 -1\n";
    let others = format!("usemtl lamp\n{}", "f 9 10 11 12\n".repeat(300));
    let among = scene.replace("usemtl floor", &format!("{vertices}{others}usemtl floor"));
    let report = text(&succeed(hatbox().arg("check").arg(folder.file("among.obj", among))).stdout);
    assert!(!report.contains("no light reaches"), "{report}");
    let between = "v -9 -9 150\nv 9 -9 150\nv 9 9 150\nv -9 9 150\nusemtl floor\nf 9 10 11 12\n";
    let report =
        text(&succeed(hatbox().arg("check").arg(folder.file("hidden.obj", format!("{scene}{between}")))).stdout);
    assert!(report.contains("no light reaches 1 face "), "{report}");
}

#[test]
fn check_finds_dark_rooms() {
    let report = json(hatbox().arg("check").arg(sample("cornell-box.glb")).arg("--json"));
    assert_eq!((report["ok"].as_bool(), report["lighting"]["dark"].as_u64()), (Some(true), Some(0)));
    let report = json(hatbox().arg("check").arg(sample("two-rooms-walled.glb")).arg("--json"));
    let dark = report["findings"].as_array().and_then(|found| found.iter().find(|f| f["kind"] == "unlit"));
    assert!(dark.is_some_and(|dark| dark["count"].as_u64() > Some(0)), "{report:#}");
    let folder = Folder::new();
    let unlit = folder.file("unlit.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n");
    assert!(text(&succeed(hatbox().arg("check").arg(unlit)).stdout).contains("nothing emits"));
}

#[test]
fn check_and_solve_agree_that_a_room_of_mirrors_has_no_solution() {
    let folder = Folder::new();
    std::fs::copy(sample(CUBE), folder.path("cube.obj")).expect("copied");
    let scene = "[[mesh]]\nfile = 'cube.obj'\n[material.'*']\nreflectance = 1\nexitance = 1\n";
    let scene = folder.file("mirrors.toml", scene);
    let [checked, solved] =
        ["check", "solve"].map(|command| hatbox().arg(command).arg(&scene).output().expect("the binary runs"));
    for (output, said) in [(&checked, text(&checked.stdout)), (&solved, text(&solved.stderr))] {
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("nothing in it absorbs light"), "{said}");
    }
}

#[test]
fn check_says_when_a_room_is_inside_out() {
    let folder = Folder::new();
    let room = std::fs::read_to_string(sample(CUBE)).expect("the sample");
    let turned = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["f", a, b, c, d] => format!("f {d} {c} {b} {a}"),
            _ => line.to_owned(),
        }
    };
    let turned: Vec<String> = room.lines().map(turned).collect();
    for (text, expected) in [(room, false), (turned.join("\n"), true)] {
        let scene = folder.file("room.obj", text);
        let report = json(hatbox().arg("check").arg(&scene).arg("--json"));
        let findings = report["findings"].as_array().expect("a list");
        let found = findings.iter().find(|finding| finding["kind"] == "inside-out");
        assert_eq!(found.is_some(), expected, "{report:#}");
        if let Some(found) = found {
            let message = found["message"].as_str().expect("text");
            assert!(found["count"] == 6 && message.contains("outwards") && message.contains("turn them"), "{message}");
        }
    }
}

#[test]
fn shells_complete_commands() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = text(&succeed(hatbox().args(["completions", shell])).stdout);
        assert!(script.contains("factors"), "{shell}");
    }
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let mut command = hatbox();
    command.args(["completions", "bash"]).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the binary runs");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("it ends");
    assert!(output.status.success() && output.stderr.is_empty(), "{}", text(&output.stderr));
}
