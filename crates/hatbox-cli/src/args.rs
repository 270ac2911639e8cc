//! The words of the command line, as they are typed. What they mean is said in [`crate::options`].
//!
//! Choices and their help come from the library's lists, so that a new basis or format needs no word here.

use crate::options::{self, CameraArgument};
use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Args, Parser, Subcommand, ValueEnum, ValueHint};
use clap_complete::Shell;
use hatbox::{element, exchange, io, solve, space, view_factors};
use std::fmt::Write as _;
use std::path::PathBuf;

/// How diffuse light (or radiant heat) settles in a scene, by the finite-element method.
#[derive(Debug, Parser)]
#[command(name = "hatbox", version, after_help = EXAMPLES, after_long_help = EXAMPLES)]
pub(crate) struct Cli {
    /// Say nothing but what is wrong
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    #[command(subcommand)]
    pub(crate) command: Command,
}

const EXAMPLES: &str = "\
Examples:
  hatbox check room.glb
  hatbox solve room.glb -o room-lit.glb -o room.png
  hatbox factors enclosure.obj --groups -o factors.csv

`hatbox help COMMAND` says more. Exit status: 0 done, 1 the input is wrong, 2 usage, 130 interrupted.";

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Compute the radiosity of a scene
    Solve(Box<SolveArgs>),
    /// Compute view factors between elements or named parts
    Factors(FactorsArgs),
    /// Evaluate a solution at points
    Probe(ProbeArgs),
    /// Make pictures (or other files) of a solution
    Render(RenderArgs),
    /// Look for mistakes in a scene
    Check(CheckArgs),
    /// Print the completion script of a shell
    #[command(after_help = "Example:\n  hatbox completions bash > ~/.local/share/bash-completion/completions/hatbox")]
    Completions {
        /// The shell
        shell: Shell,
    },
}

#[derive(Debug, Args)]
#[command(after_help = SOLVE_EXAMPLES)]
pub(crate) struct SolveArgs {
    #[command(flatten)]
    pub(crate) scene: SceneArgument,
    /// File to write; the format follows the extension. May be given several times
    #[arg(short, long, value_name = "FILE", long_help = outputs_help(), value_hint = ValueHint::FilePath)]
    pub(crate) output: Vec<PathBuf>,
    /// Functions that the radiosity is expressed in
    #[arg(long, default_value = options::defaults().basis.name, value_parser = bases())]
    pub(crate) basis: String,
    /// Where the functions are joined
    ///
    /// The computation and the output use the same functions. The default joins them: fewer unknowns, no jumps
    /// except at creases and where the material changes. `broken` keeps every element on its own.
    #[arg(long, default_value = options::defaults().continuity.name(), value_parser = continuities())]
    pub(crate) continuity: String,
    /// Relative error of the reflected light (in L2, estimated) to refine the mesh to, such as 1% or 0.01
    ///
    /// The mesh is refined where the light needs it until the estimated error is no greater. With --max-edge or
    /// --elements the mesh is as they say, and the estimate tells what was reached. Quadrature and shadow rays follow:
    /// they may have half of the error.
    #[arg(long, value_name = "T", default_value = "2%", value_parser = options::tolerance)]
    pub(crate) tolerance: f64,
    /// Stop refining before a band has more coefficients (3 for a linear element) [default: 20000 with --operator dense,
    /// which takes 4 N² bytes, else 1000000 or twice those of the first mesh]
    #[arg(long, value_name = "N", value_parser = options::count)]
    pub(crate) max_unknowns: Option<usize>,
    /// Where the error counts: a material, an object, or a box X,Y,Z;X,Y,Z. Elsewhere only as far as it matters there
    #[arg(long, value_name = "NAME|BOX", conflicts_with_all = ["max_edge", "elements"], allow_hyphen_values = true)]
    pub(crate) focus: Option<String>,
    /// Also prove what the error is at most: far more than the estimate, and many times the work
    ///
    /// The residual is bounded all over each element, with proven visibility, and divided by 1 less the greatest reflectance.
    /// Materials must be uniform.
    #[arg(long)]
    pub(crate) certify: bool,
    /// Gather the light once more at the vertices of the output: half an order more accurate there, with sharper shadows; between
    /// them it is interpolated, and may be less accurate than without
    #[arg(long)]
    pub(crate) gather: bool,
    /// Put vertices of the subdivision at t^Q from the edges of faces: finer there, where light varies most
    ///
    /// 2 suits linear and 3 quadratic functions. Faces that are triangles are graded towards all of their edges.
    #[arg(long, value_name = "Q", default_value_t = 1.0, value_parser = options::grading)]
    pub(crate) grading: f64,
    /// How the exchange of light between elements is kept
    #[arg(long, default_value = options::AUTO, value_parser = operators())]
    pub(crate) operator: String,
    /// Most memory that the exchange operator may store, such as 4G or 500M
    ///
    /// Rays that do not fit are cast again for each product, which takes much longer (`sampled`, `hierarchical`; light of
    /// lamps, links and geometry are stored in any case); `dense` is refused. Scene and solution come on top.
    #[arg(long, value_name = "BYTES", default_value = options::MEMORY, value_parser = options::size)]
    pub(crate) memory: u64,
    /// Keep finished work in FILE, and go on from there if it exists: after a crash, an interrupt or a kill
    ///
    /// The result is the same, to the last bit. Rays are kept, which are most of the work of a large scene; the dense
    /// operator's integrals are not. The file is as large as what all operators on the way store. It goes on with the same
    /// scene and options, but for outputs, threads and memory, and is removed when the outputs are written.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub(crate) checkpoint: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) mesh: MeshArgs,
    /// How the equations are solved
    #[arg(long, default_value = options::AUTO, value_parser = solvers())]
    pub(crate) solver: String,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    #[command(flatten)]
    pub(crate) view: ViewArgs,
}

const SOLVE_EXAMPLES: &str = "\
Examples:
  hatbox solve room.glb -o room-lit.glb
  hatbox solve room.obj --tolerance 0.5% -o room.npz -o room.vtu
  hatbox solve room.glb --tolerance 1% --focus desk -o room.npz
  hatbox solve room.toml --basis quadratic --elements 2000 -o room.png --camera '2,1.6,3;0,1,0'
  hatbox solve room.glb --json | jq .energy.mean_irradiance";

#[derive(Debug, Args)]
#[command(after_help = FACTORS_EXAMPLES)]
pub(crate) struct FactorsArgs {
    #[command(flatten)]
    pub(crate) scene: SceneArgument,
    /// File to write; the format follows the extension
    #[arg(short, long, value_name = "FILE", long_help = factor_outputs_help(), value_hint = ValueHint::FilePath)]
    pub(crate) output: Vec<PathBuf>,
    /// Between named parts instead of elements: objects of the file, or materials
    #[arg(long, value_name = "KIND", num_args = 0..=1, require_equals = true, default_missing_value = "object")]
    pub(crate) groups: Option<GroupKind>,
    #[command(flatten)]
    pub(crate) accuracy: Accuracy,
    #[command(flatten)]
    pub(crate) mesh: FactorMeshArgs,
    /// How the sums of the rows are made right
    ///
    /// In a closed scene each becomes 1; in an open one it may differ from what rays do not see escape by no more than they may
    /// be wrong. Reciprocity stays,
    /// zeros stay zero, and what is hidden in part stays below what it would be if nothing stood in the way. What changed
    /// is reported.
    #[arg(long, value_name = "METHOD", default_value = options::default_closure(), value_parser = closures())]
    pub(crate) closure: String,
    /// Leave out pairs whose factors are both below this, such as 1e-4 or 0.01%
    ///
    /// The others make up for them by the method of --closure (by scaling, if it is none), so that the rows sum to what
    /// they did. What was left out is reported.
    #[arg(long, value_name = "F", default_value_t = 0.0, value_parser = options::fraction)]
    pub(crate) threshold: f64,
    /// Memory that may be used, such as 4G or 500M [default: what is free]
    ///
    /// Needs are estimated before the work begins; what does not fit is refused.
    #[arg(long, value_name = "SIZE", value_parser = options::size)]
    pub(crate) memory: Option<u64>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

const FACTORS_EXAMPLES: &str = "\
Examples:
  hatbox factors enclosure.obj --groups
  hatbox factors enclosure.obj --elements 5000 -o factors.npz    (scipy.sparse.load_npz reads it)
  hatbox factors satellite.glb --groups=material --tolerance 1e-4 -o factors.csv
  hatbox factors room.vs3 --groups --closure scaling -o room.vf  (View3D's formats)
  hatbox factors hall.glb --elements 5000 --closure least-squares --threshold 1e-5 -o hall.npz";

/// What makes elements one group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum GroupKind {
    /// The object (node, part) of the file
    #[value(alias = "node")]
    Object,
    /// The material
    Material,
}

#[derive(Debug, Args)]
#[command(after_help = PROBE_EXAMPLES)]
pub(crate) struct ProbeArgs {
    /// A solution that `hatbox solve -o FILE.npz` wrote
    #[arg(value_name = "SOLUTION.npz", value_hint = ValueHint::FilePath)]
    pub(crate) solution: PathBuf,
    /// Where to evaluate: a table (.csv) or array (.npy) with the columns x y z nx ny nz
    ///
    /// In metres, with the normal of the surface that is meant, of any length. A header may name the columns.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub(crate) points: PathBuf,
    /// Take the light of lamps as it falls on each point, with shadows as sharp as they are
    ///
    /// Without, values are those of the functions that were solved for, which blur the edges of shadows within an element.
    #[arg(long, group = "afresh")]
    pub(crate) direct: bool,
    /// Gather all light afresh at each point: the most accurate, at the price of a visit of every surface for every point
    ///
    /// Points in the air, as on a work plane, get what arrives there (E) instead of the value of a surface.
    #[arg(long, group = "afresh")]
    pub(crate) gather: bool,
    /// Seed of the rays of `--direct` and `--gather`, where so much stands between that rays are needed
    #[arg(long, value_name = "N", default_value_t = 0, requires = "afresh")]
    pub(crate) seed: u64,
    /// Table (.csv) or array (.npy) to write; standard output if not given
    ///
    /// The six columns of each point, then `E_0 …` and `B_0 …`, one per band. A point takes the value of the nearest
    /// surface whose normal agrees; it is NaN where no surface at all looks that way.
    #[arg(short, long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub(crate) output: Option<PathBuf>,
}

const PROBE_EXAMPLES: &str = "\
Example:
  hatbox probe room.npz --points grid.csv -o lux.csv
  hatbox probe room.npz --points desk.csv --direct -o desk.csv
  hatbox probe room.npz --points workplane.csv --gather -o lux.csv";

#[derive(Debug, Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub(crate) struct RenderArgs {
    /// A solution that `hatbox solve -o FILE.npz` wrote
    #[arg(value_name = "SOLUTION.npz", value_hint = ValueHint::FilePath)]
    pub(crate) solution: PathBuf,
    /// File to write: a picture, or any other format of `hatbox solve`. May be given several times
    #[arg(short, long, value_name = "FILE", required = true, long_help = outputs_help(), value_hint = ValueHint::FilePath)]
    pub(crate) output: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) view: ViewArgs,
}

const RENDER_EXAMPLES: &str = "\
Examples:
  hatbox render room.npz -o room.png
  hatbox render room.npz -o room.png --direct
  hatbox render room.npz -o lux.png --quantity irradiance --false-color --exposure 500
  hatbox render room.npz -o room.exr --camera '2,1.6,3;0,1,0' --width 1920 --height 1080";

#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    #[command(flatten)]
    pub(crate) scene: SceneArgument,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct SceneArgument {
    /// The scene
    #[arg(value_name = "SCENE", help = scenes_short(), long_help = scenes_help(), value_hint = ValueHint::FilePath)]
    pub(crate) path: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct Accuracy {
    /// Relative error that form factors and visibility may have, such as 1% or 0.01
    ///
    /// Quadrature and shadow rays follow from it.
    #[arg(long, value_name = "T", default_value = "1%", value_parser = options::tolerance)]
    pub(crate) tolerance: f64,
}

#[derive(Debug, Args)]
#[group(multiple = false)]
pub(crate) struct MeshArgs {
    /// Subdivide until no edge is longer, such as 0.1 (metres) or 10cm
    #[arg(long, value_name = "LENGTH", value_parser = options::length)]
    pub(crate) max_edge: Option<f64>,
    /// Subdivide to about this many elements
    #[arg(long, value_name = "N", value_parser = options::count)]
    pub(crate) elements: Option<usize>,
}

#[derive(Debug, Args)]
#[group(multiple = false)]
pub(crate) struct FactorMeshArgs {
    /// Subdivide until no edge is longer, such as 0.1 (metres) or 10cm
    #[arg(long, value_name = "LENGTH", value_parser = options::length)]
    pub(crate) max_edge: Option<f64>,
    /// Subdivide to about this many elements; by default every face is one
    #[arg(long, value_name = "N", value_parser = options::count)]
    pub(crate) elements: Option<usize>,
}

#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// Processor threads to use [default: all]
    ///
    /// The result does not depend on it.
    #[arg(long, value_name = "N", value_parser = options::count)]
    pub(crate) threads: Option<usize>,
    /// Seed of everything that is sampled
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Print one JSON object; everything else goes to standard error
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Pictures")]
pub(crate) struct ViewArgs {
    /// Where to look from: EYE;TARGET[;UP[;DEGREES]], each of the first three as x,y,z
    ///
    /// In metres; DEGREES is the vertical field of view. By default the scene's own camera, or one from which
    /// everything is seen.
    #[arg(long, value_name = "CAMERA", value_parser = options::camera, allow_hyphen_values = true)]
    pub(crate) camera: Option<CameraArgument>,
    /// What is shown
    #[arg(long, value_enum, default_value_t = Shown::Radiosity)]
    pub(crate) quantity: Shown,
    /// Make the light of lamps afresh for every pixel: sharp shadows, however coarse the elements are
    ///
    /// It takes a visit of every lamp for every pixel and every element. Errors, which are no light, are shown as they are.
    #[arg(long)]
    pub(crate) direct: bool,
    /// Show luminance (lx, W/m²) in false colours with a scale, in .png; errors always are
    #[arg(long)]
    pub(crate) false_color: bool,
    /// The value that is shown bright (in false colours, where the scale ends), in lm/m², lx or W/m²
    ///
    /// By default it is chosen so that surfaces that do not emit are well exposed.
    #[arg(long, value_name = "VALUE", value_parser = options::positive, allow_negative_numbers = true)]
    pub(crate) exposure: Option<f64>,
    /// Pixels in a row
    #[arg(long, value_name = "PIXELS", default_value_t = 960, value_parser = clap::value_parser!(u32).range(1..=32768))]
    pub(crate) width: u32,
    /// Rows of pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 720, value_parser = clap::value_parser!(u32).range(1..=32768))]
    pub(crate) height: u32,
    /// Rays along each side of a pixel
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(crate) samples: u32,
}

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Shown {
    /// What leaves the surfaces
    Radiosity,
    /// What arrives at them
    Irradiance,
    /// The indicated error of what leaves them, element by element
    Error,
}

/// A parser of names with a line of help each.
fn names(entries: impl IntoIterator<Item = (&'static str, &'static str)>) -> PossibleValuesParser {
    let value = |(name, help): (&'static str, &'static str)| PossibleValue::new(name).help(help);
    PossibleValuesParser::new(entries.into_iter().map(value))
}

fn bases() -> PossibleValuesParser {
    names(element::ALL.iter().map(|basis| (basis.name, basis.summary)))
}

fn continuities() -> PossibleValuesParser {
    names(space::Continuity::NAMES)
}

fn operators() -> PossibleValuesParser {
    let auto = (exchange::AUTO.name, exchange::AUTO.summary);
    names([auto].into_iter().chain(exchange::ALL.iter().map(|kind| (kind.name, kind.summary))))
}

fn solvers() -> PossibleValuesParser {
    let auto = (options::AUTO, "cg where the reflectance is constant on every element, else gmres");
    names([auto].into_iter().chain(solve::ALL.iter().map(|solver| (solver.name, solver.summary))))
}

fn closures() -> PossibleValuesParser {
    names(view_factors::CLOSURES.iter().map(|method| (method.name, method.summary)))
}

fn scenes_short() -> String {
    let extensions = io::FORMATS.iter().flat_map(|format| format.extensions);
    format!("The scene: {}", extensions.map(|e| format!(".{e}")).collect::<Vec<_>>().join(", "))
}

fn scenes_help() -> String {
    let rows = io::FORMATS.iter().map(|format| {
        let extensions: Vec<String> = format.extensions.iter().map(|e| format!(".{e}")).collect();
        (extensions.join(" "), format.summary)
    });
    table("The scene. Formats:", rows)
}

fn outputs_help() -> String {
    let rows = io::OUTPUTS.iter().map(|output| (format!(".{}", output.extension), output.summary));
    table("File to write, whole or not at all; the format follows the extension. May be given several times.", rows)
}

fn factor_outputs_help() -> String {
    let rows = io::factors::OUTPUTS.iter().map(|output| (format!(".{}", output.extension), output.summary));
    table("File to write, whole or not at all; the format follows the extension. May be given several times.", rows)
}

/// A sentence and an aligned list.
fn table<'a>(head: &str, rows: impl Iterator<Item = (String, &'a str)>) -> String {
    rows.fold(head.to_owned() + "\n", |mut text, (name, summary)| {
        // Writing to a String cannot fail.
        let _ = write!(text, "\n  {name:<12} {summary}");
        text
    })
}
