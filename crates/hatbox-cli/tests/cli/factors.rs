//! `hatbox factors` and its options.

use crate::failures::fail;
use crate::{CUBE, Folder, hatbox, json, sample, succeed, text};
use std::process::Command;

/// `hatbox factors` of the cube, inaccurate enough that there is something to correct.
fn coarse() -> Command {
    let mut command = hatbox();
    command.arg("factors").arg(sample(CUBE)).args(["--elements", "96", "--tolerance", "10%"]);
    command
}

#[test]
fn every_closure_can_be_chosen_and_is_reported() {
    let help = text(&succeed(hatbox().args(["factors", "--help"])).stdout);
    for method in hatbox::view_factors::CLOSURES {
        assert!(help.contains(method.name), "{} is not in the help", method.name);
        let report = json(coarse().args(["--closure", method.name, "--json"]));
        let error = report["max_row_sum_error"].as_f64().expect("a number");
        if method.kind == hatbox::view_factors::ClosureMethodKind::None {
            assert!(report["closure"].is_null() && error > 1e-9, "{report:#}");
            continue;
        }
        let closure = &report["closure"];
        assert_eq!(closure["method"], method.name);
        assert!(error < 1e-12 && report["row_sums"][1].as_f64().is_some_and(|sum| sum <= 1.0), "{report:#}");
        assert!(closure["row_sum_error_before"].as_f64() > closure["row_sum_error_after"].as_f64());
        assert!(closure["largest_relative_change"].as_f64() > Some(0.0) && closure["capped_pairs"] == 0);
        let summary = text(&succeed(coarse().args(["--closure", method.name])).stdout);
        assert!(summary.contains("Closure") && summary.contains(method.name), "{summary}");
    }
    for extension in hatbox::io::factors::OUTPUTS.iter().map(|output| output.extension) {
        assert!(help.contains(&format!(".{extension} ")), "{extension} is not in the help");
    }
}

#[test]
fn a_threshold_is_reported_and_makes_the_file_smaller() {
    let folder = Folder::new();
    let whole = json(coarse().args(["--json", "-o"]).arg(folder.path("whole.mtx")));
    let report = json(coarse().args(["--threshold", "0.4%", "--json", "-o"]).arg(folder.path("thin.mtx")));
    let threshold = &report["threshold"];
    let number = |key: &str| threshold[key].as_u64().expect("a number");
    assert!(number("dropped") > 0 && report["nonzeros"].as_u64() == Some(number("kept")), "{report:#}");
    assert_eq!(whole["nonzeros"].as_u64(), Some(number("dropped") + number("kept")));
    assert_eq!(threshold["rebalancing"]["method"], "scaling");
    let length = |name: &str| folder.path(name).metadata().expect("the file").len();
    assert!(length("thin.mtx") < length("whole.mtx"));
    let summary = text(&succeed(coarse().args(["--threshold", "0.004"])).stdout);
    assert!(summary.contains("left out") && summary.contains("made up for by scaling"), "{summary}");
}

#[test]
fn the_errors_of_all_rows_are_summed_up() {
    let report = json(coarse().arg("--json"));
    assert!(report["environment"].is_null() && report["reversed_error"].is_f64(), "{report:#}");
    let spread = ["min", "median", "max"].map(|key| report["row_sum_errors"][key].as_f64().expect("a number"));
    assert!(spread.is_sorted() && spread[0] < spread[2], "{spread:?}");
    let folder = Folder::new();
    let open = folder.file("open.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nf 1 2 3 4\nf 1 5 6 2\n");
    let report = json(hatbox().arg("factors").arg(&open).arg("--json"));
    assert!(report["environment"]["median"].as_f64().is_some_and(|e| (e - 0.8).abs() < 0.01), "{report:#}");
}

#[test]
fn the_time_is_told_by_stages() {
    let folder = Folder::new();
    let report = json(coarse().args(["--json", "-o"]).arg(folder.path("factors.csv")));
    let stages = ["reading", "meshing", "computing", "writing"];
    let seconds = stages.map(|stage| report["stages"][stage].as_f64().expect("a number"));
    let whole = report["seconds"].as_f64().expect("a number");
    assert!(seconds.iter().all(|&seconds| seconds >= 0.0) && seconds[2] > 0.0 && seconds[3] > 0.0, "{report:#}");
    assert!((seconds.iter().sum::<f64>() - whole).abs() < 1e-6, "{report:#}");
}

#[test]
fn too_little_memory_is_said_before_the_work() {
    let folder = Folder::new();
    let report = json(coarse().args(["--memory", "1G", "--json"]));
    for quiet in [&["--json"][..], &["--json", "--quiet"], &["--quiet"]] {
        let output = succeed(coarse().args(quiet));
        assert!(output.stderr.is_empty(), "{quiet:?}: {}", text(&output.stderr));
    }
    assert_eq!(report["available_bytes"], 1_000_000_000);
    let estimate = report["estimated_bytes"].as_u64().expect("a number");
    assert!(estimate > report["bytes"].as_u64().expect("a number"));
    let little = (estimate / 2).to_string();
    fail(&folder, 1, coarse().args(["--memory", &little]), &["cube.obj", "MB", "fewer", "--groups", "--memory"]);
}

const SQUARES: &str = "T two squares and a sheet\nC eps=1e-3\nF 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\n\
    V 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\nV 9 .25 .25 .5\nV 10 .75 .25 .5\nV 11 .75 .75 .5\n\
    S 1 1 2 3 4 0 0 0.9 bottom\nS 2 8 7 6 5 0 0 0.8 top\nO 3 9 10 11 0\nEnd\n";

#[test]
fn view3d_goes_in_and_out() {
    let folder = Folder::new();
    let scene = folder.file("squares.vs3", SQUARES);
    let output = folder.path("squares.vf");
    let report = json(hatbox().arg("factors").arg(&scene).args(["--groups", "--json", "-o"]).arg(&output));
    assert_eq!((report["groups"].as_u64(), report["closed"].as_bool()), (Some(2), Some(false)));
    let warning = report["warnings"][0].as_str().expect("a warning");
    assert!(warning.contains("line 2") && warning.contains("eps = 0.001"), "{warning}");
    let written = std::fs::read_to_string(output).expect("text");
    let lines: Vec<&str> = written.lines().collect();
    assert!(lines[0].starts_with("View3D ") && lines.len() == 5 && lines[4] == "0.9 0.8", "{written}");
    let wrong = folder.file("wrong.vs3", SQUARES.replace("0.9 bottom", "9 bottom"));
    fail(&folder, 1, hatbox().arg("factors").arg(&wrong), &["wrong.vs3", "line 15", "emittance of 9", "help"]);
}

#[test]
fn wrong_options_have_status_2() {
    let folder = Folder::new();
    for arguments in [["--closure", "rows"], ["--threshold", "1"], ["--threshold", "-1"], ["--memory", "4X"]] {
        fail(&folder, 2, coarse().args([&format!("{}={}", arguments[0], arguments[1])]), &[arguments[0]]);
    }
}

/// The table on the terminal of two squares that face each other has what arrives nowhere; that of a closed cube has no such column.
#[test]
fn the_table_of_an_open_scene_has_the_environment() {
    let folder = Folder::new();
    let squares =
        "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\no b\nv 0 0 1\nv 0 1 1\nv 1 1 1\nv 1 0 1\nf 5 6 7 8\n";
    std::fs::write(folder.path("squares.obj"), squares).expect("written");
    let table = |scene: &std::path::Path| text(&succeed(hatbox().arg("factors").arg(scene).arg("--groups")).stdout);
    let open = table(&folder.path("squares.obj"));
    let row: Vec<&str> = open.lines().last().expect("rows").split_whitespace().collect();
    assert_eq!(row, ["b", "0.199825", "0.000000", "0.800175"], "{open}");
    assert!(open.contains("b  environment\n") && open.contains(" 1 pair of elements"), "{open}");
    assert!(!table(&sample(CUBE)).contains("  environment"));
}
