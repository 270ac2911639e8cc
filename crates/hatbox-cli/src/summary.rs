//! Reports as text: a few aligned lines, most important first.

use crate::commands::Written;
use crate::commands::check::Done as Checked;
use crate::commands::factors::{Closure, Done as Factors};
use crate::commands::solve::Done;
use crate::style::Style;
use hatbox::exchange::GREATEST_DEFICIT;
use hatbox::io::checkpoint::Earlier;
use hatbox::report::{Report, RoundReport};
use hatbox::view_factors::{Estimate, RowCheck, ViewFactors};
use std::fmt::Write as _;
use std::path::Path;

/// The greatest number of surfaces whose factors are shown.
const SHOWN_SURFACES: usize = 8;
/// The column of what arrives nowhere.
const ENVIRONMENT: &str = "environment";

/// Row sums that are off by no more are so by rounding.
const EXACT: f64 = 1e-12;

/// What a closed scene may lose of its power without a word: a digit less than is shown.
const SMALL_LOSS: f64 = 5e-4;

/// Nine tenths of the square of the norm on less than this part of the area are worth a word.
const LITTLE: f64 = 1e-2;

/// Lines, each with a name in a column of its own.
struct Lines {
    style: Style,
    text: String,
}

impl Lines {
    fn new(style: Style) -> Self {
        Self { style, text: String::new() }
    }

    fn line(&mut self, label: &str, text: &str) {
        // Padded before it is coloured: colour codes have no width.
        // Writing to a String cannot fail, here and below.
        let _ = writeln!(self.text, "{} {text}", self.style.label(&format!("{label:<9}")));
    }

    fn more(&mut self, text: &str) {
        let _ = writeln!(self.text, "{:<9} {text}", "");
    }
}

/// What `solve` did.
pub(crate) fn solve(path: &Path, done: &Done, style: Style) -> String {
    let report = &done.report;
    let mut lines = Lines::new(style);
    scene(&mut lines, path, report);
    light(&mut lines, report);
    operator(&mut lines, report);
    let solver = &report.solver;
    lines.line(
        "Solver",
        &format!(
            "{}, {} iterations, residual {:.0e}, {}",
            solver.kind,
            solver.iterations,
            solver.residual,
            seconds(solver.seconds)
        ),
    );
    error(&mut lines, report);
    certificate(&mut lines, report);
    written(&mut lines, &done.outputs);
    if done.outputs.is_empty() {
        lines.line("Written", &style.faint("nothing; name files with -o, such as -o lit.glb or -o picture.png"));
    }
    lines.line("Total", &total(done.seconds, done.peak_bytes));
    lines.text
}

fn scene(lines: &mut Lines, path: &Path, report: &Report) {
    let [x, y, z] = report.scene.size;
    let bands = if report.bands == 1 { "1 band".to_owned() } else { format!("{} bands", report.bands) };
    lines.line(
        "Scene",
        &format!(
            "{}: {} faces, {} m², {} × {} × {} m, {bands}",
            path.display(),
            count(report.scene.faces as u64),
            digits(report.scene.area),
            digits(x),
            digits(y),
            digits(z)
        ),
    );
    lines.line(
        "Mesh",
        &format!(
            "{} elements, {} unknowns a band, {} {}",
            count(report.elements as u64),
            count(report.dofs as u64),
            report.continuity,
            report.basis
        ),
    );
}

fn light(lines: &mut Lines, report: &Report) {
    let (label, power, density) =
        if report.scene.physics == "heat" { ("Heat", "W", "W/m²") } else { ("Light", "lm", "lx") };
    let energy = &report.energy;
    let emitted: f64 = energy.emitted.iter().sum();
    if emitted <= 0.0 {
        lines.line(label, "nothing emits; everything is dark");
        return;
    }
    let share = |part: &[f64]| percent(part.iter().sum::<f64>() / emitted);
    let escaped = energy.escaped.iter().sum::<f64>() / emitted;
    let escaped = match report.closure.escape {
        0.0 if escaped.abs() < SMALL_LOSS => String::new(),
        0.0 if report.closure.covered > 0.0 => format!(", {} lost under what covers it", percent(escaped)),
        0.0 if escaped < 0.0 => format!(", {} gained by errors of the operator", percent(-escaped)),
        0.0 => format!(", {} lost by errors of the operator", percent(escaped)),
        // It is what is left of the other two.
        _ if escaped < 0.0 => format!(", {} escaped, as far as errors of the operator let see", percent(escaped)),
        _ => format!(", {} escaped", percent(escaped)),
    };
    lines.line(
        label,
        &format!("{} {power} emitted: {} absorbed{escaped}", per_band(&energy.emitted), share(&energy.absorbed)),
    );
    lines.more(&format!("{} {density} mean irradiance", per_band(&energy.mean_irradiance)));
}

fn operator(lines: &mut Lines, report: &Report) {
    let operator = &report.operator;
    let pairs = if operator.pairs > 0 {
        let clear = operator.clear_pairs as f64 / operator.pairs as f64;
        format!("{} ({} proven clear), ", several(operator.pairs, "pair"), percent(clear))
    } else {
        String::new()
    };
    lines.line(
        "Operator",
        &format!(
            "{}, {pairs}{} rays, {}, {}, norm {:.4}",
            operator.kind,
            count(operator.rays),
            bytes(operator.bytes as u64),
            seconds(operator.seconds),
            operator.norm
        ),
    );
    if operator.recast > 0.0 {
        let share = percent(operator.recast);
        lines.more(&format!(
            "memory does not hold the rays of {share} of the elements: they are cast again for each product"
        ));
    }
    if let Some(reason) = &operator.reason {
        lines.more(&format!("chosen because {reason}"));
    }
    let closure = &report.closure;
    if closure.enclosed > 0.0 {
        let off = format!("off by up to {}", percent(closure.deficit));
        let sums = match (closure.deficit > EXACT, closure.balanced) {
            (false, _) => "exact".to_owned(),
            (true, true) => format!("{off}, balanced away"),
            (true, false) => off,
        };
        let closed = match closure.escape {
            0.0 => "closed scene".to_owned(),
            _ => format!("{} of the area in closed rooms", percent(closure.enclosed)),
        };
        lines.more(&format!("{closed}; row sums were {sums}"));
        if closure.deficit > GREATEST_DEFICIT && !closure.balanced {
            lines.more("if that is not noise of rays, faces may lie on each other: `hatbox check` says so");
        }
    }
}

fn certificate(lines: &mut Lines, report: &Report) {
    let Some(found) = &report.certificate else { return };
    lines.line(
        "Certified",
        &format!(
            "at most {} (residual at most {}, greatest reflectance {:.3}), on {} parts of elements, {}",
            percent(found.bound),
            percent(found.residual),
            found.reflectance,
            count(found.receivers as u64),
            seconds(found.seconds)
        ),
    );
}

fn error(lines: &mut Lines, report: &Report) {
    let Some(error) = &report.error else { return };
    lines.line(
        "Error",
        &format!(
            "about {} of the reflected light (estimated: residual {}, its reflections {})",
            percent(error.estimate),
            percent(error.residual),
            percent(error.propagated)
        ),
    );
    lines.more(&format!(
        "from data {}, discretisation {}, computation {} (solver {:.0e}), {}",
        percent(error.data),
        percent(error.discretisation),
        percent(error.operator),
        error.solver,
        seconds(error.seconds)
    ));
    let [half, most] = error.pointwise.map(percent);
    lines
        .more(&format!("point by point: at most {half} of the light there on half of the area, {most} on nine tenths"));
    let Some(adaptivity) = &report.adaptivity else { return };
    if let Some(bright) = report.bright.as_ref().filter(|bright| bright.area < LITTLE) {
        let (area, objects) = (percent(bright.area), bright.objects.join("`, `"));
        lines.more(&format!(
            "relative to the light on {area} of the area (`{objects}`); the rest may err by more: see --focus"
        ));
    }
    let asked = percent(adaptivity.tolerance);
    if adaptivity.reached {
        lines.more(&format!("asked: {asked}, reached in {}", several(adaptivity.rounds.len() as u64, "round")));
    } else {
        let most = adaptivity.most_coefficients;
        let elements = |round: Option<&RoundReport>| round.map(|round| round.elements);
        let is_first = elements(adaptivity.rounds.first()) == elements(adaptivity.rounds.last());
        let mesh = if is_first { "the mesh was not refined, since it" } else { "the next mesh" };
        lines.more(&format!(
            "asked: {asked}, NOT reached: {mesh} would have more than {most} coefficients, joined or not (--max-unknowns)"
        ));
        // More than half of its square.
        if error.bends.powi(2) > 0.5 * error.discretisation.powi(2) {
            let bends = percent(error.bends);
            lines.more(&format!(
                "joining takes {bends} from elements that are joined where faces bend: try `--continuity broken`"
            ));
        }
    }
}

/// What `factors` did.
pub(crate) fn factors(path: &Path, found: &ViewFactors, done: &Factors, style: Style) -> String {
    let mut lines = Lines::new(style);
    let groups = if found.len() == found.elements { String::new() } else { format!(" in {} groups", found.len()) };
    lines.line("Scene", &format!("{}: {} elements{groups}", path.display(), count(found.elements as u64)));
    let clear = done.clear_pairs as f64 / done.pairs.max(1) as f64;
    lines.line(
        "Factors",
        &format!(
            "{} not zero, {} of elements ({} proven clear), {} rays, {}",
            count(done.nonzeros as u64),
            several(done.pairs, "pair"),
            percent(clear),
            count(done.rays),
            bytes(done.bytes as u64)
        ),
    );
    row_sums(&mut lines, done);
    lines.line(
        "Error",
        &format!("estimated: quadrature {}, visibility {}", small(done.quadrature_error), small(done.visibility_error)),
    );
    if !done.reached {
        let shadows = done.visibility_error > done.tolerance;
        let advice = if shadows { "; smaller elements have less between them (--elements)" } else { "" };
        lines.more(&format!("more than the {} that was asked for{advice}", small(done.tolerance)));
    }
    lines.more(&format!(
        "found: reciprocity {} in the matrix, {} of pairs integrated the other way round",
        small(done.max_reciprocity_error),
        small(done.reversed_error)
    ));
    written(&mut lines, &done.outputs);
    lines.line("Total", &total(done.seconds, done.peak_bytes));
    if found.len() <= SHOWN_SURFACES {
        lines.text += &matrix(found, style);
    }
    lines.text
}

/// The sums of the rows, and what was done about them.
fn row_sums(lines: &mut Lines, done: &Factors) {
    let [least, greatest] = done.row_sums;
    let median = done.row_sum_errors.median;
    let sums = match &done.environment {
        None => format!("1 ± {} (median error {})", small(done.max_row_sum_error), small(median)),
        Some(environment) => format!(
            "{least:.6} … {greatest:.6}, the rest goes to the environment (median {})",
            percent(environment.median)
        ),
    };
    lines.line("Row sums", &sums);
    if let Some(closure) = &done.closure {
        lines.line("Closure", &closed(closure));
    }
    if let Some(threshold) = &done.threshold {
        let (dropped, kept) = (count(threshold.dropped as u64), count(threshold.kept as u64));
        lines.line(
            "Threshold",
            &format!(
                "{dropped} factors left out, {kept} kept; a row lost at most {}",
                percent(threshold.largest_row_loss)
            ),
        );
        if threshold.kept == 0 {
            lines.more("nothing is left: no factor reaches the threshold");
        } else {
            lines.more(&format!("made up for by {}", closed(&threshold.rebalancing)));
        }
    }
}

/// What a closure did.
fn closed(closure: &Closure) -> String {
    let capped = match closure.capped_pairs {
        0 => String::new(),
        pairs => format!("; {} kept at their unobstructed value", several(pairs as u64, "pair")),
    };
    format!(
        "{}: row sums were off by up to {}, now {}; no factor changed by more than {}{capped}",
        closure.method,
        small(closure.row_sum_error_before),
        small(closure.row_sum_error_after),
        percent(closure.largest_relative_change)
    )
}

/// What a checkpoint had from an earlier run, if it had anything.
pub(crate) fn earlier(found: Earlier) -> Option<String> {
    let rest = match found.cut {
        0 => String::new(),
        cut => format!("; {} after it were not whole and are cut off", bytes(cut)),
    };
    let goes_on = format!("going on from {} of finished work in the checkpoint{rest}", bytes(found.bytes));
    (found != Earlier::default()).then_some(goes_on)
}

/// What is about to be taken.
pub(crate) fn estimate(estimate: &Estimate, limit: Option<u64>) -> String {
    let limit = limit.map_or(String::new(), |limit| format!(" of {}", bytes(limit)));
    format!("about {} elements, {}{limit} of memory", count(estimate.elements as u64), bytes(estimate.bytes))
}

/// The factors of few surfaces, as a table.
fn matrix(found: &ViewFactors, style: Style) -> String {
    let heads = found.surfaces.iter().map(|surface| &*surface.name).chain([ENVIRONMENT]);
    let width = heads.map(|name| name.chars().count()).max().unwrap_or(0);
    let name = |name: &str| style.faint(&format!("{name:>width$}"));
    let names: Vec<String> = found.surfaces.iter().map(|surface| name(&surface.name)).collect();
    // What does not arrive anywhere, if there may be any.
    let open = if found.is_closed() { Vec::new() } else { found.check().rows };
    let heads = names.iter().cloned().chain(open.first().map(|_| name(ENVIRONMENT))).collect::<Vec<_>>();
    let mut text = format!("\n{} {}\n", name("from \\ to"), heads.join("  "));
    for (row, name) in names.iter().enumerate() {
        let numbers = found.row(row).chain(open.get(row).map(RowCheck::environment));
        let factors: Vec<String> = numbers.map(|factor| format!("{factor:>width$.6}")).collect();
        let _ = writeln!(text, "{name} {}", factors.join("  "));
    }
    text
}

/// What `check` found.
pub(crate) fn check(path: &Path, done: &Checked, style: Style) -> String {
    let mut lines = Lines::new(style);
    if let Some(scene) = &done.scene {
        let [x, y, z] = scene.size.map(digits);
        let (faces, area) = (count(scene.faces as u64), digits(scene.area));
        lines.line("Scene", &format!("{}: {faces} faces, {area} m², {x} × {y} × {z} m", path.display()));
    } else {
        lines.line("Scene", &path.display().to_string());
    }
    if let Some(lighting) = &done.lighting {
        let escape = match lighting.escape {
            0.0 => "closed".to_owned(),
            escape => format!("open: {} of the directions lead out or to unlit backs", percent(escape)),
        };
        lines.line("Light", &format!("{} of {} sides emit; {escape}", lighting.emitters, lighting.faces));
    }
    for found in &done.findings {
        let label = format!("{:<9}", found.severity);
        let label = match found.severity {
            "error" => style.error(&label),
            "warning" => style.warning(&label),
            _ => style.faint(&label),
        };
        let _ = writeln!(lines.text, "{label} {}", found.message);
    }
    let verdict = match (done.ok, done.findings.is_empty()) {
        (true, true) => "nothing suspicious",
        (true, false) => "it can be solved",
        (false, _) => "it cannot be solved",
    };
    lines.line("Verdict", verdict);
    lines.text
}

/// Only the files.
pub(crate) fn outputs(outputs: &[Written], style: Style) -> String {
    let mut lines = Lines::new(style);
    written(&mut lines, outputs);
    lines.text
}

fn written(lines: &mut Lines, outputs: &[Written]) {
    for (k, output) in outputs.iter().enumerate() {
        let text = format!("{} ({})", output.file.display(), bytes(output.bytes));
        if k == 0 { lines.line("Written", &text) } else { lines.more(&text) }
    }
}

fn total(time: f64, peak: Option<u64>) -> String {
    let peak = peak.map_or(String::new(), |peak| format!(", at most {} of memory", bytes(peak)));
    seconds(time) + &peak
}

/// A value per band, the same number once.
fn per_band(values: &[f64]) -> String {
    let shown: Vec<String> = values.iter().map(|&value| digits(value)).collect();
    match &shown[..] {
        [first, rest @ ..] if rest.iter().all(|other| other == first) => first.clone(),
        _ => shown.join(" · "),
    }
}

/// Three digits, or all of those before the point.
fn digits(value: f64) -> String {
    let magnitude = value.abs();
    match magnitude {
        0.0 => "0".to_owned(),
        m if m < 1e-3 => format!("{value:.2e}"),
        m if m < 1e6 => {
            let decimals = (2 - m.log10().floor() as i32).clamp(0, 5) as usize;
            let text = format!("{value:.decimals$}");
            if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
        }
        _ => format!("{value:.3e}"),
    }
}

/// A small number in powers of ten, or nothing at all.
fn small(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.1e}") }
}

fn percent(fraction: f64) -> String {
    // What is left of zero after rounding is zero.
    let percent = if fraction.abs() < 1e-12 { 0.0 } else { 100.0 * fraction };
    if percent.abs() < 0.01 && percent != 0.0 { format!("{percent:.0e} %") } else { digits(percent) + " %" }
}

/// So many of something.
pub(crate) fn several(n: u64, what: &str) -> String {
    format!("{} {what}{}", count(n), if n == 1 { "" } else { "s" })
}

/// A count, short where it is large.
fn count(n: u64) -> String {
    match n {
        0..100_000 => n.to_string(),
        100_000..10_000_000 => format!("{:.2} M", n as f64 / 1e6),
        10_000_000..10_000_000_000 => format!("{:.0} M", n as f64 / 1e6),
        _ => format!("{:.1} G", n as f64 / 1e9),
    }
}

fn bytes(n: u64) -> String {
    match n {
        0..1000 => format!("{n} B"),
        1000..1_000_000 => format!("{:.0} kB", n as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", n as f64 / 1e6),
        _ => format!("{:.2} GB", n as f64 / 1e9),
    }
}

fn seconds(time: f64) -> String {
    match time {
        t if t < 0.1 => format!("{:.0} ms", 1e3 * t),
        t if t < 10.0 => format!("{t:.2} s"),
        t if t < 120.0 => format!("{t:.1} s"),
        t if t < 7200.0 => format!("{:.0} min {:.0} s", (t / 60.0).floor(), t % 60.0),
        t => format!("{:.0} h {:.0} min", (t / 3600.0).floor(), (t % 3600.0) / 60.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.0, 1.0, 12.345, 1234.5, 0.012_34].map(digits), ["0", "1", "12.3", "1234", "0.0123"]);
        assert_eq!(digits(999.7), "1000");
        assert_eq!([0.5, 0.000_01].map(percent), ["50 %", "1e-3 %"]);
        assert_eq!([12, 1_234_567, 45_000_000].map(count), ["12", "1.23 M", "45 M"]);
        assert_eq!([1, 2].map(|n| several(n, "pair")), ["1 pair", "2 pairs"]);
        assert_eq!([999, 12_345, 1_500_000].map(bytes), ["999 B", "12 kB", "1.5 MB"]);
        assert_eq!(
            [0.012, 3.0, 61.0, 130.0, 7260.0].map(seconds),
            ["12 ms", "3.00 s", "61.0 s", "2 min 10 s", "2 h 1 min"]
        );
    }

    #[test]
    fn equal_bands_are_one_number() {
        assert_eq!(per_band(&[2.0, 2.0, 2.0]), "2");
        assert_eq!(per_band(&[1.0, 2.0]), "1 · 2");
    }
}
