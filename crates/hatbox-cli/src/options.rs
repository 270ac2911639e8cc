//! What the words of the command line mean: raw arguments become the library's options here, and nowhere else.

use crate::args::{FactorsArgs, GroupKind, MeshArgs, RunArgs, Shown, SolveArgs, ViewArgs};
use crate::failure::Failure;
use crate::memory;
use glam::DVec3;
use hatbox::adapt::{self, Focus};
use hatbox::bake::Exposure;
use hatbox::element::Basis;
use hatbox::io::{WriteOptions, unit};
use hatbox::mesh::Refinement;
use hatbox::progress::Progress;
use hatbox::radiosity::{self, Options, Solution};
use hatbox::render::RenderOptions;
use hatbox::scene::Camera;
use hatbox::space::Continuity;
use hatbox::view_factors::{self, Between, ClosureMethodKind};
use hatbox::{exchange, solve};

/// The word that leaves a choice to the library.
pub(crate) const AUTO: &str = exchange::AUTO.name;

/// [`exchange::MEMORY`], as it is typed.
pub(crate) const MEMORY: &str = "16GiB";

/// Vertical field of view of a camera that does not say, in degrees.
const FIELD_OF_VIEW: f64 = 40.0;

/// The linear display value that the exposure's value is shown as.
const BRIGHT: f64 = 0.8;

/// What the library does when it is not told otherwise.
pub(crate) fn defaults() -> Options {
    Options::default()
}

/// What to solve and how.
pub(crate) fn solve(args: &SolveArgs) -> Options {
    let defaults = defaults();
    // The parser has accepted names of the library's lists only, so that the defaults here are never reached.
    Options {
        basis: Basis::named(&args.basis).unwrap_or(defaults.basis),
        continuity: Continuity::named(&args.continuity).unwrap_or(defaults.continuity),
        refinement: refinement(&args.mesh).unwrap_or(defaults.refinement),
        grading: args.grading,
        tolerance: 0.5 * args.tolerance,
        operator: exchange::kind(&args.operator).unwrap_or(defaults.operator),
        solver: solve::ALL.iter().find(|solver| solver.name == args.solver).map(|solver| solver.kind),
        seed: args.run.seed,
        memory: args.memory as usize,
        error_points: defaults.error_points,
    }
}

/// The closure of view factors if none is asked for.
pub(crate) fn default_closure() -> &'static str {
    ClosureMethodKind::default().name()
}

/// What refinement does when it is not told otherwise.
pub(crate) fn adaptive_defaults() -> adapt::Options {
    adapt::Options::default()
}

/// What to refine to; `None` if the mesh is given.
pub(crate) fn adaptive(args: &SolveArgs) -> Option<adapt::Options> {
    if refinement(&args.mesh).is_some() {
        return None;
    }
    let defaults = adaptive_defaults();
    Some(adapt::Options {
        solve: Options { refinement: defaults.solve.refinement, ..solve(args) },
        tolerance: args.tolerance,
        most_coefficients: args.max_unknowns,
        focus: args.focus.as_deref().map(focus),
    })
}

/// A box if it looks like one, else a name.
fn focus(text: &str) -> Focus {
    let corners: Vec<DVec3> = text.split(';').filter_map(|corner| vector(corner.trim()).ok()).collect();
    match corners[..] {
        [a, b] => Focus::Box(a, b),
        _ => Focus::Name(text.to_owned()),
    }
}

/// What view factors to compute and how.
pub(crate) fn factors(args: &FactorsArgs) -> view_factors::Options {
    let closure = view_factors::CLOSURES.iter().find(|method| method.name == args.closure);
    let mesh = MeshArgs { max_edge: args.mesh.max_edge, elements: args.mesh.elements };
    view_factors::Options {
        between: match args.groups {
            None => Between::Elements,
            Some(GroupKind::Object) => Between::Groups,
            Some(GroupKind::Material) => Between::Materials,
        },
        refinement: refinement(&mesh).unwrap_or_default(),
        tolerance: args.accuracy.tolerance,
        seed: args.run.seed,
        closure: closure.map(|method| method.kind).unwrap_or_default(),
        threshold: args.threshold,
        memory: args.memory.or_else(memory::available),
    }
}

fn refinement(args: &MeshArgs) -> Option<Refinement> {
    args.max_edge.map(Refinement::MaxEdge).or(args.elements.map(Refinement::Elements))
}

/// What of a solution is written: itself, or where it is wrong.
pub(crate) fn shown(solution: Solution, args: &ViewArgs) -> Solution {
    if args.quantity == Shown::Error { radiosity::error_of(&solution) } else { solution }
}

/// How solutions are written; `scene` is the camera of the scene.
pub(crate) fn write<'a>(args: &ViewArgs, scene: Option<Camera>, progress: &'a dyn Progress) -> WriteOptions<'a> {
    let shown = match args.quantity {
        Shown::Radiosity | Shown::Error => radiosity::Shown::Radiosity,
        Shown::Irradiance => radiosity::Shown::Irradiance,
    };
    WriteOptions {
        view: RenderOptions {
            camera: args.camera.map(|camera| camera.placed(scene)),
            width: args.width as usize,
            height: args.height as usize,
            samples: args.samples as usize,
            shown,
            // An error is no light.
            direct: args.direct && args.quantity != Shown::Error,
        },
        exposure: args.exposure.map(|value| Exposure { scale: BRIGHT / value }),
        // Errors span decades and have no colour of their own.
        false_color: args.false_color || args.quantity == Shown::Error,
        false_color_top: args.exposure,
        progress,
    }
}

/// Makes the library use that many threads.
pub(crate) fn set_threads(args: &RunArgs) -> Result<(), Failure> {
    let Some(threads) = args.threads else { return Ok(()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    pool.map_err(|error| Failure::with_help(format!("cannot use {threads} threads: {error}"), "ask for fewer"))
}

/// A camera as it is typed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CameraArgument {
    eye: DVec3,
    target: DVec3,
    up: Option<DVec3>,
    fov_y: f64,
}

impl CameraArgument {
    /// The camera; up is as typed, or else as in the scene's own camera, or else y.
    fn placed(self, scene: Option<Camera>) -> Camera {
        let up = self.up.or(scene.map(|camera| camera.up)).unwrap_or(DVec3::Y);
        Camera { eye: self.eye, target: self.target, up, fov_y: self.fov_y }
    }
}

/// Parses EYE;TARGET[;UP[;DEGREES]].
pub(crate) fn camera(text: &str) -> Result<CameraArgument, String> {
    let parts: Vec<&str> = text.split(';').map(str::trim).collect();
    let (&[eye, target], rest) = parts.split_first_chunk().ok_or("expected EYE;TARGET, such as 2,1.6,3;0,1,0")?;
    let (up, degrees) = match *rest {
        [] => (None, None),
        [up] => (Some(up), None),
        [up, degrees] => (Some(up), Some(degrees)),
        _ => return Err("expected no more than EYE;TARGET;UP;DEGREES".to_owned()),
    };
    let (eye, target) = (vector(eye)?, vector(target)?);
    let up = up.filter(|up| !up.is_empty()).map(vector).transpose()?;
    let degrees = degrees.map_or(Ok(FIELD_OF_VIEW), number)?;
    if !(degrees > 0.0 && degrees < 180.0) {
        return Err(format!("a field of view of {degrees}° is not between 0 and 180"));
    }
    if eye == target || up.is_some_and(|up| up.cross(target - eye) == DVec3::ZERO) {
        return Err("the camera looks along its up direction, or nowhere".to_owned());
    }
    Ok(CameraArgument { eye, target, up, fov_y: degrees.to_radians() })
}

fn vector(text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').map(|part| number(part.trim())).collect::<Result<_, _>>()?;
    let [x, y, z] = numbers[..] else { return Err(format!("`{text}` is not x,y,z")) };
    Ok(DVec3::new(x, y, z))
}

fn number(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| format!("`{text}` is not a number"))
}

/// Parses a number greater than 0.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 { Ok(value) } else { Err("it must be greater than 0".to_owned()) }
}

/// Parses an exponent of grading.
pub(crate) fn grading(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if (1.0..=8.0).contains(&value) { Ok(value) } else { Err("it must lie between 1 and 8".to_owned()) }
}

/// Parses a whole number greater than 0.
pub(crate) fn count(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n > 0).ok_or_else(|| "it must be a whole number greater than 0".to_owned())
}

/// A number, or a percentage.
fn ratio(text: &str) -> Result<f64, String> {
    match text.strip_suffix('%') {
        Some(percent) => Ok(number(percent.trim())? / 100.0),
        None => number(text),
    }
}

/// Parses a part of a whole: 0.01% or 1e-4; it may be 0.
pub(crate) fn fraction(text: &str) -> Result<f64, String> {
    let value = ratio(text)?;
    let right = (0.0..1.0).contains(&value);
    if right { Ok(value) } else { Err("it must be at least 0 and less than 1, such as 1e-4 or 0.01%".to_owned()) }
}

/// Parses a number of bytes: 4G, 500 MB, 2GiB.
pub(crate) fn size(text: &str) -> Result<u64, String> {
    let expected = || format!("`{text}` is no size; give bytes, or a number with k, M, G or T, such as 4G");
    let letters = text.find(|c: char| c.is_ascii_alphabetic() && c != 'e').unwrap_or(text.len());
    let (digits, unit) = text.split_at(letters);
    let unit = unit.to_ascii_lowercase();
    let (prefix, base) = match unit.strip_suffix("ib") {
        Some(prefix) => (prefix, 1024.0_f64),
        None => (unit.strip_suffix('b').unwrap_or(&unit), 1000.0),
    };
    let power = ["", "k", "m", "g", "t"].iter().position(|known| *known == prefix).ok_or_else(expected)?;
    let bytes = number(digits.trim()).map_err(|_| expected())? * base.powi(power as i32);
    if bytes >= 1.0 { Ok(bytes as u64) } else { Err("it must be greater than 0".to_owned()) }
}

/// Parses a relative error: 1% or 0.01.
pub(crate) fn tolerance(text: &str) -> Result<f64, String> {
    let value = ratio(text)?;
    if value > 0.0 && value < 1.0 {
        return Ok(value);
    }
    Err("it must lie between 0 and 1 (100%), such as 1% or 0.01".to_owned())
}

/// Parses a length: metres, or a number with a unit.
pub(crate) fn length(text: &str) -> Result<f64, String> {
    let with_unit = |unit: &unit::Unit| Some(number(text.strip_suffix(unit.name)?.trim()).ok()? * unit.metres);
    let metres = number(text).ok().or_else(|| unit::ALL.iter().find_map(with_unit));
    let metres =
        metres.ok_or_else(|| format!("it is not a length; give metres, or a number with {}", unit::names()))?;
    if metres > 0.0 { Ok(metres) } else { Err("it must be greater than 0".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        crate::args::Cli::command().debug_assert();
    }

    #[test]
    fn tolerances_are_fractions_or_percentages() {
        assert_eq!([tolerance("1%"), tolerance("0.01"), tolerance("1e-2"), tolerance("1 %")], [const { Ok(0.01) }; 4]);
        for wrong in ["0", "-1%", "100%", "2", "one", "nan", ""] {
            assert!(tolerance(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_have_prefixes() {
        assert_eq!([size("4G"), size("4e9"), size("4000 MB")], [const { Ok(4_000_000_000) }; 3]);
        assert_eq!([size("2GiB"), size("2097152KiB")], [const { Ok(1 << 31) }; 2]);
        assert_eq!(size(MEMORY), Ok(exchange::MEMORY as u64));
        for wrong in ["", "G", "4X", "-1G", "0", "nan", "4 GG"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn fractions_may_be_nothing_but_not_the_whole() {
        assert_eq!([fraction("0"), fraction("0.01%"), fraction("1e-4")], [Ok(0.0), Ok(1e-4), Ok(1e-4)]);
        for wrong in ["1", "-1e-4", "nan", "", "100%"] {
            assert!(fraction(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn lengths_have_units() {
        assert_eq!(length("0.5"), Ok(0.5));
        assert_eq!(length("1e-2"), Ok(0.01));
        assert!(length("5cm").is_ok_and(|l| (l - 0.05).abs() < 1e-15));
        assert!(length("12 in").is_ok_and(|l| (l - 0.3048).abs() < 1e-15));
        for wrong in ["", "m", "5 furlongs", "-1", "0", "inf"] {
            assert!(length(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn cameras_have_an_eye_and_a_target_at_least() {
        let plain = camera("2,1.6,3;0,1,0").expect("a camera");
        assert_eq!(plain.placed(None).up, DVec3::Y);
        let full = camera("-2, 1.6, 3; 0,1,0; 0,0,1; 90").expect("a camera").placed(None);
        assert_eq!((full.up, full.eye.x), (DVec3::Z, -2.0));
        assert!((full.fov_y - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        for wrong in ["", "1,2,3", "1,2;0,0,0", "1,2,3;1,2,3", "0,0,0;0,0,1;0,0,1", "0,0,0;0,0,1;;180", "a,b,c;0,0,0"] {
            assert!(camera(wrong).is_err(), "{wrong}");
        }
    }
}
