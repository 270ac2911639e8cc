//! View3D's files: its scenes read, its text written.

use crate::{between, cube};
use hatbox::io::{factors, read_scene};
use hatbox::progress::Silent;
use hatbox::view_factors::{Between, Options, ViewFactors};

/// Two unit squares opposite each other at a distance of 1, and what `more` says; its vertices begin with 9.
fn squares(more: &str, options: &Options) -> ViewFactors {
    let text = format!(
        "T two squares\nC eps=1e-4 list=2\nF 3\n! the lower\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\n\
         V 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\n{more}\nEnd of data\nS what follows is not read\n"
    );
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.vs3");
    std::fs::write(&path, text).expect("writing a test file");
    let (scene, _) = read_scene(&path).expect("a valid scene");
    ViewFactors::new(&scene, options, &Silent).expect("few elements")
}

fn by_name() -> Options {
    Options { between: Between::Groups, tolerance: 1e-6, ..Options::default() }
}

const BOTH: &str = "S 1 1 2 3 4 0 0 0.9 bottom\nS 2 8 7 6 5 0 0 0.8 top\n";
const OPPOSITE: f64 = 0.199_824_895_698_387;

fn names(found: &ViewFactors) -> Vec<&str> {
    found.surfaces.iter().map(|surface| surface.name.as_str()).collect()
}

#[test]
fn surfaces_have_their_names_and_emittances() {
    let found = squares(BOTH, &by_name());
    assert_eq!(names(&found), ["bottom", "top"]);
    assert!((found.get(0, 1) - OPPOSITE).abs() < 1e-6);
    assert!((found.surfaces[1].emittance - 0.8).abs() < 1e-15);
}

#[test]
fn an_obstruction_stands_in_the_way_and_is_no_row() {
    let vertices = "V 9 .25 .25 .75\nV 10 .75 .25 .75\nV 11 .75 .75 .75\nV 12 .25 .75 .75\n";
    let options = Options { tolerance: 3e-4, ..by_name() };
    let found = squares(&format!("{vertices}{BOTH}O 3 9 10 11 12"), &options);
    assert_eq!(names(&found), ["bottom", "top"]);
    assert!((found.get(0, 1) - 0.115_620_602_132).abs() < 1e-3, "{}", found.get(0, 1));
    assert!((found.surfaces[0].escape - (1.0 - found.get(0, 1))).abs() < 5e-3, "{:?}", found.surfaces[0]);
}

/// A window in the lower square.
const WINDOW: &str = "V 9 .2 .3 0\nV 10 .7 .3 0\nV 11 .7 .8 0\nV 12 .2 .8 0\n";

#[test]
fn a_part_is_cut_out_of_its_base() {
    let found = squares(&format!("{WINDOW}{BOTH}S 3 9 10 11 12 1 0 0.1 window"), &by_name());
    assert_eq!(names(&found), ["bottom", "top", "window"]);
    let areas: Vec<f64> = found.surfaces.iter().map(|surface| surface.area).collect();
    assert!((areas[0] - 0.75).abs() < 1e-12 && (areas[2] - 0.25).abs() < 1e-12, "{areas:?}");
    assert!(found.get(0, 2) == 0.0);
    let both = areas[0] * found.get(0, 1) + areas[2] * found.get(2, 1);
    assert!((both - OPPOSITE).abs() < 1e-6, "{both}");
}

#[test]
fn a_null_surface_takes_area_away_and_lets_nothing_through() {
    let null = squares(&format!("{WINDOW}{BOTH}N 3 12 11 10 9 1 0 0.1 nothing"), &by_name());
    let window = squares(&format!("{WINDOW}{BOTH}S 3 9 10 11 12 1 0 0.1 window"), &by_name());
    assert_eq!(names(&null), ["bottom", "top"]);
    assert!((null.surfaces[0].area - 0.75).abs() < 1e-12);
    assert!((null.get(0, 1) - window.get(0, 1)).abs() < 1e-6);
    assert!((null.get(1, 0) - window.get(1, 0)).abs() < 1e-6);
}

#[test]
fn combined_surfaces_are_one_group() {
    let halves = "V 9 .5 0 0\nV 10 .5 1 0\nS 1 1 9 10 4 0 0 0.9 bottom\nS 2 8 7 6 5 0 0 0.8 top\n\
                  S 3 9 2 3 10 0 1 0.9 bottom-b\n";
    let found = squares(halves, &by_name());
    assert_eq!(names(&found), ["bottom", "top"]);
    assert!((found.get(0, 1) - OPPOSITE).abs() < 1e-6 && (found.get(1, 0) - OPPOSITE).abs() < 1e-6);
    let apart = squares(halves, &Options { between: Between::Materials, ..by_name() });
    assert_eq!(names(&apart), ["bottom", "top", "bottom-b"]);
    assert!((apart.get(1, 0) + apart.get(1, 2) - OPPOSITE).abs() < 1e-6);
}

#[test]
fn its_text_holds_areas_factors_and_emittances() {
    let closed = between(&cube(), &Options::default());
    let open = squares(BOTH, &by_name());
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (found, encloses) in [(closed, "1"), (open, "0")] {
        let path = folder.path().join("out.vf");
        factors::write(&found, &path, &Silent).expect("written");
        let text = std::fs::read_to_string(&path).expect("text");
        let lines: Vec<&str> = text.lines().collect();
        // View3D's reader takes 34 characters for the header.
        assert!(lines[0].len() >= 30 && lines[0].len() < 34, "{:?}", lines[0]);
        let header: Vec<&str> = lines[0].split_whitespace().collect();
        assert_eq!((header[0], &header[2..]), ("View3D", &["0", encloses, "0", &found.len().to_string()][..]));
        let numbers: Vec<Vec<f64>> = lines[1..]
            .iter()
            .map(|line| line.split(' ').map(|word| word.parse().expect("a number")).collect())
            .collect();
        assert_eq!(numbers.len(), found.len() + 2);
        let bits = |values: &mut dyn Iterator<Item = f64>| values.map(f64::to_bits).collect::<Vec<_>>();
        for (i, surface) in found.surfaces.iter().enumerate() {
            assert_eq!(numbers[0][i].to_bits(), surface.area.to_bits());
            assert_eq!(bits(&mut numbers[i + 1].iter().copied()), bits(&mut found.row(i)));
            assert_eq!(numbers[found.len() + 1][i].to_bits(), surface.emittance.to_bits());
        }
    }
}
