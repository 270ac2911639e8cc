//! View factors against closed forms (numbers of J. R. Howell's catalogue), with and without occluders.

#[path = "factors/catalogue.rs"]
mod catalogue;
#[allow(dead_code, reason = "other tests use the rest")]
mod closed_forms;
#[path = "factors/closures.rs"]
mod closures;
#[allow(dead_code, reason = "other tests use the rest")]
mod meshes;
#[allow(dead_code, reason = "other tests use the rest")]
mod random;
#[path = "factors/rooms.rs"]
mod rooms;
#[path = "factors/view3d.rs"]
mod view3d;

use hatbox::exchange::ExchangeError;
use hatbox::io::{WriteError, factors, npy, read_scene};
use hatbox::mesh::Refinement;
use hatbox::progress::{Progress, Silent};
use hatbox::view_factors::{Between, Error, Estimate, Options, ViewFactors};
use std::fmt::Write as _;
use std::io::Read;
use std::sync::atomic::{AtomicU64, Ordering};

type Quad = [[f64; 3]; 4];

/// View factors between quads, each an object of an OBJ file with the name of its place: `q0`, `q1`, …
fn between(quads: &[Quad], options: &Options) -> ViewFactors {
    let parts: Vec<Part> = quads.iter().map(|quad| vec![quad.to_vec()]).collect();
    between_parts(&parts, options)
}

/// Triangles and quads.
type Part = Vec<Vec<[f64; 3]>>;

/// View factors of objects of several faces.
fn between_parts(parts: &[Part], options: &Options) -> ViewFactors {
    let mut text = String::new();
    for (k, part) in parts.iter().enumerate() {
        writeln!(text, "o q{k}").expect("a string");
        for face in part {
            for [x, y, z] in face {
                writeln!(text, "v {x:?} {y:?} {z:?}").expect("a string");
            }
            text += if face.len() == 3 { "f -3 -2 -1\n" } else { "f -4 -3 -2 -1\n" };
        }
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.obj");
    std::fs::write(&path, text).expect("writing a test file");
    let (scene, _) = read_scene(&path).expect("a valid scene");
    ViewFactors::new(&scene, options, &Silent).expect("few elements")
}

fn exactly() -> Options {
    Options { tolerance: 1e-7, ..Options::default() }
}

/// A rectangle in the plane of height z that looks up or down.
fn level([x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: f64, up: bool) -> Quad {
    let quad = [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]];
    if up { quad } else { [quad[0], quad[3], quad[2], quad[1]] }
}

const FLOOR: Quad = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];

/// The factor from the first to the second quad alone.
#[track_caller]
fn assert_factor(from: Quad, to: Quad, exact: f64) {
    let factors = between(&[from, to], &exactly());
    assert_eq!(factors.len(), 2, "a single element each");
    assert!((factors.get(0, 1) - exact).abs() < 1e-6, "{} instead of {exact}", factors.get(0, 1));
    assert!(factors.check().max_reciprocity_error < 1e-15);
}

#[test]
fn c_11_parallel_squares() {
    for (gap, exact) in [(1.0, 0.199_824_895_698_387), (0.5, 0.415_253_283_577_147), (0.1, 0.826_994_522_397_257)] {
        assert_factor(FLOOR, level([0., 1.], [0., 1.], gap, false), exact);
    }
}

#[test]
fn c_13_parallel_rectangles_with_an_offset() {
    assert_factor(FLOOR, level([0.5, 2.], [1., 1.5], 1., false), 0.058_720_926_649_154);
}

#[test]
fn c_14_perpendicular_rectangles_with_a_common_edge() {
    for (height, exact) in [(1.0, 0.200_043_776_075_403), (2.0, 0.232_852_602_795_362)] {
        assert_factor(FLOOR, [[0., 0., 0.], [0., 1., 0.], [0., 1., height], [0., 0., height]], exact);
    }
}

#[test]
fn c_16_squares_at_an_angle() {
    let angles = [
        (30.0_f64, 0.619_028_323_090_803),
        (45.0, 0.483_347_695_478_878),
        (60.0, 0.370_905_321_150_051),
        (120.0, 0.086_615_001_118_276),
        (135.0, 0.048_309_447_801_818),
        (150.0, 0.021_345_325_412_689),
    ];
    for (degrees, exact) in angles {
        let (sin, cos) = degrees.to_radians().sin_cos();
        assert_factor(FLOOR, [[0., 0., 0.], [0., 1., 0.], [cos, 1., sin], [cos, 0., sin]], exact);
    }
}

#[test]
fn sheets_between_parallel_squares_take_away_what_they_must() {
    let sheets = [
        ([0., 0.5], [0., 1.], 0.5, 0.099_912_447_849_194),
        ([0., 0.5], [0., 0.5], 0.5, 0.149_868_671_773_790),
        ([0.25, 0.75], [0.25, 0.75], 0.75, 0.115_620_602_132),
    ];
    for (x, y, z, exact) in sheets {
        let quads = [FLOOR, level([0., 1.], [0., 1.], 1., false), level(x, y, z, true)];
        for tolerance in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
            let found = between(&quads, &Options { tolerance, ..Options::default() });
            let error = (found.get(0, 1) - exact).abs();
            assert!(error < tolerance * exact, "{} instead of {exact} at {tolerance:e}", found.get(0, 1));
            assert!(error < found.statistics.quadrature_error + 1e-10, "{error:e} is not within the estimate");
            assert_eq!(found.statistics.rays, 0, "shadows of few polygons are cut out exactly");
        }
    }
}

/// The unit cube, seen from inside.
fn cube() -> Vec<Quad> {
    let wall = |a: [f64; 3], b: [f64; 3], c: [f64; 3], d: [f64; 3]| [a, b, c, d];
    vec![
        level([0., 1.], [0., 1.], 0., true),
        level([0., 1.], [0., 1.], 1., false),
        wall([0., 0., 0.], [0., 0., 1.], [1., 0., 1.], [1., 0., 0.]),
        wall([0., 1., 0.], [1., 1., 0.], [1., 1., 1.], [0., 1., 1.]),
        wall([0., 0., 0.], [0., 1., 0.], [0., 1., 1.], [0., 0., 1.]),
        wall([1., 0., 0.], [1., 0., 1.], [1., 1., 1.], [1., 1., 0.]),
    ]
}

#[test]
fn the_rows_of_a_closed_cube_sum_to_one() {
    let whole = between(&cube(), &exactly());
    assert!(whole.is_closed() && whole.len() == 6);
    assert!(whole.check().max_row_sum_error < 1e-6, "{:?}", whole.check());
    let tolerance = 1e-3;
    let fine = Options { tolerance, refinement: Refinement::Elements(300), ..Options::default() };
    let fine = between(&cube(), &fine);
    assert!(fine.len() >= 300);
    assert!(fine.check().max_row_sum_error < tolerance, "{:?}", fine.check());
}

#[test]
fn parallel_planes_far_from_the_origin_stay_apart() {
    let shelves = [level([0., 1.], [0., 1.], 0.3, true), level([0., 1.], [0., 1.], 0.6, false)];
    let scene = |shift: [f64; 3]| -> Vec<Quad> {
        let moved = |quad: Quad| quad.map(|corner| [0, 1, 2].map(|axis| corner[axis] + shift[axis]));
        cube().into_iter().take(2).chain(shelves).map(moved).collect()
    };
    let options =
        Options { tolerance: 1e-4, refinement: Refinement::Elements(200), between: Between::Groups, ..exactly() };
    let here = between(&scene([0.0; 3]), &options);
    for shift in [[5e5, 5e6, 0.0], [0.0, 0.0, 1e7]] {
        let there = between(&scene(shift), &options);
        for (i, j) in (0..here.len()).flat_map(|i| (0..here.len()).map(move |j| (i, j))) {
            assert!(
                (here.get(i, j) - there.get(i, j)).abs() < 1e-6,
                "{shift:?}: {} {}",
                here.get(i, j),
                there.get(i, j)
            );
        }
    }
}

#[test]
fn groups_of_elements_have_the_factors_of_the_whole() {
    let options = Options { refinement: Refinement::Elements(200), between: Between::Groups, ..exactly() };
    let (whole, grouped) = (between(&cube(), &exactly()), between(&cube(), &options));
    assert_eq!((grouped.len(), whole.len()), (6, 6));
    assert!(grouped.elements >= 200);
    for i in 0..6 {
        assert_eq!(grouped.surfaces[i].name, format!("q{i}"));
        for j in 0..6 {
            let difference = grouped.get(i, j) - whole.get(i, j);
            assert!(difference.abs() < 1e-6, "F_{i}{j} differs by {difference}");
        }
    }
}

#[test]
fn an_open_scene_says_so_and_sums_to_less_than_one() {
    let found = between(&[FLOOR, level([0., 1.], [0., 1.], 1., false)], &exactly());
    let check = found.check();
    assert!(!found.is_closed() && check.max_row_sum_error == 0.0 && check.greatest_row_sum < 0.2);
    assert_eq!(check.nonzeros, 2);
}

/// A single square, as a file says it.
fn square() -> hatbox::scene::Scene {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").expect("writing a test file");
    read_scene(&path).expect("a valid scene").0
}

#[test]
fn too_many_elements_are_refused_before_any_work() {
    struct Nothing;
    impl Progress for Nothing {
        fn begin(&self, stage: &'static str, _: u64) {
            panic!("{stage} began");
        }
    }
    for refinement in [Refinement::Elements(300_000), Refinement::MaxEdge(0.002)] {
        let options = Options { refinement, memory: Some(16_000_000_000), ..Options::default() };
        let estimate = Estimate::of(&square(), &options).expect("a possible mesh");
        assert!(estimate.bytes > 8 * (estimate.elements as u64).pow(2) / 2, "{estimate:?}");
        let error = ViewFactors::new(&square(), &options, &Nothing).expect_err("180 GB");
        assert!(matches!(error, Error::Memory { .. }) && error.to_string().contains("fewer"), "{error}");
    }
    let whole = Estimate::of(&square(), &Options::default()).expect("a possible mesh");
    let options = Options { memory: Some(whole.bytes), ..Options::default() };
    assert!(ViewFactors::new(&square(), &options, &Silent).is_ok());
    let options = Options { memory: Some(whole.bytes - 1), ..Options::default() };
    assert!(matches!(ViewFactors::new(&square(), &options, &Silent), Err(Error::Memory { elements: 1, .. })));
}

#[test]
fn integrals_agree_with_those_the_other_way_round() {
    // An oblong and a strip, so that the two ways are different sums.
    let quads = [level([0., 2.], [0., 1.], 0., true), level([1., 1.5], [0., 3.], 0.3, false)];
    for tolerance in [1e-2, 1e-6] {
        let found = between(&quads, &Options { tolerance, ..Options::default() });
        assert!(found.reversed_error < 2.0 * tolerance, "{}", found.reversed_error);
    }
    let sheet = level([0.5, 1.2], [0.2, 0.9], 0.15, true);
    let tolerance = 1e-3;
    let found = between(&[quads[0], quads[1], sheet], &Options { tolerance, ..Options::default() });
    assert!(found.statistics.clear_pairs < found.statistics.pairs);
    assert!(found.reversed_error < 5.0 * tolerance, "{}", found.reversed_error);
}

#[test]
fn the_files_hold_the_matrix() {
    let found = between(&cube(), &Options::default());
    let folder = tempfile::tempdir().expect("a temporary folder");
    for output in &factors::OUTPUTS {
        let path = folder.path().join(format!("factors.{}", output.extension));
        factors::write(&found, &path, &Silent).expect("written");
    }
    let table = std::fs::read_to_string(folder.path().join("factors.csv")).expect("a table");
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows[0], ["from", "area", "q0", "q1", "q2", "q3", "q4", "q5", "environment"]);
    assert_eq!((rows.len(), rows[3][0]), (7, "q2"));
    assert_eq!(rows[3][2].parse(), Ok(found.get(2, 0)));
    let matrix = std::fs::read_to_string(folder.path().join("factors.mtx")).expect("a matrix");
    let mut lines = matrix.lines().filter(|line| !line.starts_with('%'));
    assert_eq!(lines.next(), Some("6 6 30"));
    let first: Vec<&str> = lines.next().expect("an entry").split(' ').collect();
    assert_eq!((first[0], first[1], first[2].parse()), ("1", "2", Ok(found.get(0, 1))));
    let archive = std::fs::File::open(folder.path().join("factors.npz")).expect("an archive");
    let mut archive = zip::ZipArchive::new(archive).expect("an archive");
    let mut array = |key: &str| {
        let mut bytes = Vec::new();
        archive.by_name(key).expect("the key").read_to_end(&mut bytes).expect("the array");
        npy::Array::parse(&bytes).expect("an array")
    };
    assert_eq!(array("indptr.npy").integers(0), Ok(vec![0, 5, 10, 15, 20, 25, 30]));
    assert_eq!(array("shape.npy").integers(0), Ok(vec![6, 6]));
    assert_eq!(array("indices.npy").integers(0).expect("integers")[..5], [1, 2, 3, 4, 5]);
    assert_eq!(array("data.npy").f64s().expect("numbers")[5].to_bits(), found.get(1, 0).to_bits());
    let row = &found.check().rows[2];
    for (key, value) in [
        ("areas", found.surfaces[2].area),
        ("emittances", found.surfaces[2].emittance),
        ("escape", found.surfaces[2].escape),
        ("environment", 1.0 - row.sum),
        ("row_sum_error", row.closure_error),
        ("reciprocity_error", row.reciprocity_error),
    ] {
        let values = array(&format!("{key}.npy")).f64s().expect("numbers");
        assert_eq!((values.len(), values[2].to_bits()), (6, value.to_bits()), "{key}");
    }
}

#[test]
fn writing_can_be_interrupted() {
    struct Stop;
    impl Progress for Stop {
        fn interrupted(&self) -> bool {
            true
        }
    }
    let found = between(&cube(), &Options::default());
    let folder = tempfile::tempdir().expect("a temporary folder");
    for output in &factors::OUTPUTS {
        let result = factors::write(&found, &folder.path().join(format!("f.{}", output.extension)), &Stop);
        assert!(matches!(result, Err(WriteError::Interrupted(_))), "{}", output.extension);
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 0);
}

#[test]
fn integration_tells_how_far_it_is_and_can_be_interrupted() {
    /// Counts the steps of a stage, and stops after some.
    struct Counter {
        total: AtomicU64,
        done: AtomicU64,
        most: u64,
    }
    impl Progress for Counter {
        fn begin(&self, stage: &'static str, total: u64) {
            if stage == "form factors" {
                self.total.store(total, Ordering::Relaxed);
            }
        }
        fn advance(&self, steps: u64) {
            self.done.fetch_add(steps, Ordering::Relaxed);
        }
        fn interrupted(&self) -> bool {
            self.total.load(Ordering::Relaxed) > 0 && self.done.load(Ordering::Relaxed) >= self.most
        }
    }
    let counter = |most: u64| Counter { total: AtomicU64::new(0), done: AtomicU64::new(0), most };
    let scene = meshes::rooms::divided(&meshes::rooms::cuboid(glam::DVec3::ZERO, glam::DVec3::ONE), 6);
    let whole = counter(u64::MAX);
    assert!(ViewFactors::new(&scene, &Options::default(), &whole).is_ok());
    let total = whole.total.into_inner();
    assert_eq!((total, whole.done.into_inner()), (216 * 215 / 2, total));
    let stopped = counter(total / 2);
    let result = ViewFactors::new(&scene, &Options::default(), &stopped);
    assert!(matches!(result, Err(Error::Exchange(ExchangeError::Interrupted(_)))), "{result:?}");
    assert!(stopped.done.into_inner() < total);
}

#[test]
fn what_escapes_is_what_the_rows_lack() {
    let tolerance = 1e-3;
    // A cube without its lid.
    let mut open = cube();
    open.remove(1);
    let found = between(&open, &Options { tolerance, ..Options::default() });
    for (surface, row) in found.surfaces.iter().zip(&found.check().rows) {
        assert!((surface.escape - row.environment()).abs() < 5e-3, "{surface:?} {row:?}");
        let noise = row.environment() - surface.escape;
        assert!((row.closure_error + noise).abs() < 1e-12);
    }
    assert!((found.surfaces[0].escape - 0.199_824_895_698_387).abs() < 2e-3);
}
