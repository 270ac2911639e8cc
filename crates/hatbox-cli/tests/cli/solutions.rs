//! What can be done with a solution that was saved.

use crate::failures::fail;
use crate::{Folder, hatbox, solve_cube, succeed, text};
use std::path::PathBuf;
use std::process::Command;

/// Solves the cube into a folder and returns the solution's path.
fn solved(folder: &Folder) -> PathBuf {
    let path = folder.path("cube.npz");
    succeed(solve_cube().arg("-o").arg(&path));
    path
}

fn probe(folder: &Folder, points: &str) -> Command {
    let mut command = hatbox();
    command.arg("probe").arg(folder.path("cube.npz")).arg("--points").arg(folder.file("points.csv", points));
    command
}

#[test]
fn a_point_takes_the_value_of_the_nearest_surface_that_looks_its_way() {
    let folder = Folder::new();
    solved(&folder);
    // On the floor; above it; and on the floor, but looking at the ceiling's back.
    let points = "x,y,z,nx,ny,nz\n0.5,0.5,0,0,0,1\n0.5,0.5,0.3,0,0,2\n0.5,0.5,0,0,0,-1\n";
    let mut command = probe(&folder, points);
    let output = succeed(&mut command);
    let table = text(&output.stdout);
    let rows: Vec<&str> = table.lines().collect();
    assert_eq!((rows.len(), rows[0]), (4, "x,y,z,nx,ny,nz,E_0,E_1,E_2,B_0,B_1,B_2"));
    assert!(text(&output.stderr).contains("whose value they were given: 2"), "{}", text(&output.stderr));
    let values = |row: &str| row.split(',').map(|value| value.parse().expect("a number")).collect::<Vec<f64>>();
    let [on, above, ceiling] = [1, 2, 3].map(|row| values(rows[row]));
    assert!(on[6] > 0.0 && on[6..] == above[6..], "{table}");
    assert!(ceiling[9] > 1.0 && on[9] < 1.0, "the ceiling emits 1: {table}");
    let csv = folder.path("out.csv");
    succeed(command.arg("-o").arg(&csv));
    assert_eq!(std::fs::read_to_string(&csv).expect("the table"), table);
    succeed(probe(&folder, points).arg("-o").arg(folder.path("out.npy")));
    assert!(folder.path("out.npy").metadata().is_ok_and(|file| file.len() == 128 + 3 * 12 * 8));
}

#[test]
fn pictures_of_a_saved_solution() {
    let folder = Folder::new();
    let solution = solved(&folder);
    let picture = |name: &str, arguments: &[&str]| {
        let mut command = hatbox();
        command.arg("render").arg(&solution).arg("-o").arg(folder.path(name));
        succeed(command.args(["--width", "48", "--height", "32", "--samples", "1"]).args(arguments));
        std::fs::read(folder.path(name)).expect("the picture")
    };
    let plain = picture("view.png", &[]);
    let moved = picture("moved.png", &["--camera", "-0.5,0.5,0.5;0.5,0.5,0.5;0,0,1;60"]);
    let colored = picture("false.png", &["--false-color", "--exposure", "2"]);
    assert!(plain != moved && plain != colored);
    let error = ["--quantity", "error"];
    assert_eq!(picture("error.png", &error), picture("same.png", &[&error[..], &["--false-color"]].concat()));
    assert!(picture("view.exr", &["--quantity", "irradiance"]).len() > 1000);
}

#[test]
fn solutions_and_points_that_are_none_are_refused() {
    let folder = Folder::new();
    let solution = std::fs::read(solved(&folder)).expect("the solution");
    let cut = folder.file("cut.npz", &solution[..solution.len() / 2]);
    let picture = folder.path("out.png");
    fail(&folder, 1, hatbox().arg("render").arg(&cut).arg("-o").arg(&picture), &["cut.npz", "hatbox solve"]);
    let mut wrong = probe(&folder, "0,0,0,0,0,1\n0,0,zero,0,0,1\n");
    fail(&folder, 1, &mut wrong, &["points.csv", "line 2", "zero"]);
    let mut unknown = probe(&folder, "0,0,0,0,0,1\n");
    fail(&folder, 1, unknown.arg("-o").arg(folder.path("out.txt")), &["out.txt", ".npy"]);
}
