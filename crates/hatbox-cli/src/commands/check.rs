//! `hatbox check`: mistakes in a scene, all of them at once.

use crate::args::CheckArgs;
use crate::failure::Failure;
use crate::style::Style;
use crate::summary::several;
use crate::{output, summary};
use hatbox::check::{Check, Lighting};
use hatbox::io::{self, RawScene, ReadError};
use hatbox::mesh::{Finding, Severity};
use hatbox::report::SceneReport;
use serde::Serialize;
use std::process::ExitCode;

/// What `--json` prints.
#[derive(Debug, Serialize)]
pub(crate) struct Done {
    /// Whether it can be solved.
    pub(crate) ok: bool,
    /// Something that was found, worst first.
    pub(crate) findings: Vec<Found>,
    /// The scene; `null` if nothing can be computed.
    pub(crate) scene: Option<SceneReport>,
    /// Where light goes; `null` if nothing can be computed.
    pub(crate) lighting: Option<Lighting>,
}

/// Something that was found.
#[derive(Debug, Serialize)]
pub(crate) struct Found {
    /// `error`, `warning` or `note`.
    pub(crate) severity: &'static str,
    /// A short name that does not change.
    pub(crate) kind: &'static str,
    /// How often.
    pub(crate) count: usize,
    /// All about it in a sentence.
    pub(crate) message: String,
    /// Some places, in metres.
    pub(crate) positions: Vec<[f64; 3]>,
}

pub(super) fn run(args: &CheckArgs) -> Result<ExitCode, Failure> {
    let path = &args.scene.path;
    let done = match io::read_raw(path) {
        Ok(raw) => checked(raw),
        Err(error) if args.json => unreadable(&error),
        Err(error) => return Err(error.into()),
    };
    if args.json {
        output::print_json(&done)?;
    } else {
        output::print(&summary::check(path, &done, Style::stdout()))?;
    }
    Ok(if done.ok { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn unreadable(error: &ReadError) -> Done {
    let found = Found::new(Severity::Error, "unreadable", 1, error.to_string());
    Done { ok: false, findings: vec![found], scene: None, lighting: None }
}

fn checked(raw: RawScene) -> Done {
    let check = Check::new(raw.mesh, raw.materials, raw.physics);
    let mut findings: Vec<(Severity, Found)> = Vec::new();
    let mut add =
        |severity, kind, count, message| findings.push((severity, Found::new(severity, kind, count, message)));
    if let Some(error) = &check.error {
        add(Severity::Error, "impossible", 1, error.to_string());
    }
    if let Some(error) = &check.unbounded {
        add(Severity::Error, "lossless", 1, error.to_string());
    }
    for warning in raw.warnings {
        add(Severity::Warning, "reader", 1, warning);
    }
    for repair in &check.repairs {
        add(Severity::Note, "repaired", 1, repair.to_string());
    }
    if let Some(lighting) = &check.lighting {
        findings.extend(darkness(lighting));
    }
    findings.extend(check.findings.iter().map(|finding| (finding.kind.severity(), Found::of(finding))));
    // Stable, so that findings of one severity keep their order.
    findings.sort_by_key(|(severity, _)| std::cmp::Reverse(*severity));
    Done {
        ok: !check.has_errors(),
        findings: findings.into_iter().map(|(_, found)| found).collect(),
        scene: check.scene.as_ref().map(SceneReport::new),
        lighting: check.lighting,
    }
}

fn darkness(lighting: &Lighting) -> Option<(Severity, Found)> {
    if lighting.emitters == 0 {
        let message = "nothing emits light: everything will be black; give a material an emission";
        return Some((Severity::Warning, Found::new(Severity::Warning, "no-emitter", 1, message.to_owned())));
    }
    let first = lighting.examples.first()?;
    let [x, y, z] = first.position;
    let message = format!(
        "no light reaches {} ({:.1} % of the area; first: in `{}`, at {x:.4} {y:.4} {z:.4} m): black in every picture; \
         check that fronts face the room, or leave out what nobody sees",
        several(lighting.dark as u64, "face"),
        100.0 * lighting.dark_area,
        first.group
    );
    let mut found = Found::new(Severity::Warning, "unlit", lighting.dark, message);
    found.positions = lighting.examples.iter().map(|face| face.position).collect();
    Some((Severity::Warning, found))
}

impl Found {
    fn new(severity: Severity, kind: &'static str, count: usize, message: String) -> Self {
        let severity = match severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Note => "note",
        };
        Self { severity, kind, count, message, positions: Vec::new() }
    }

    fn of(finding: &Finding) -> Self {
        let mut found = Self::new(finding.kind.severity(), finding.kind.name(), finding.count, finding.to_string());
        found.positions = finding.examples.iter().map(|example| example.position.to_array()).collect();
        found
    }
}
