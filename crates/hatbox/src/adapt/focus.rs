//! A region of interest, and how much the rest of the scene matters to it.
//!
//! The dual equation ψ = 1_focus + K R ψ has the same S: ψ(y) is the expected number of times that light leaving y meets
//! the focus. The residual r that is left at y reaches the focus as ∫ r ψ, and since Galerkin's residual is orthogonal to
//! the space, as ∫ r (ψ − ψ_h): what a cell of a smooth ψ has too much in one corner and too little in another meets the
//! mean of the focus as nothing (R. Becker, R. Rannacher, "An optimal control approach to a posteriori error estimation", Acta
//! Numerica 10, 2001). So indicators outside are multiplied with what a cell cannot represent of ψ, and with a part of ψ
//! itself, because r is orthogonal to joined functions only, and no better than quadrature is, and because what is estimated is
//! the norm within the focus and not its mean. How large a part is a guess that hardly matters: with a tenth of it the dark one
//! of two rooms took nearly as many unknowns. ψ alone as the weight was
//! tried: it refines where the focus has no use for it.

use crate::linalg::MultiVector;
use crate::progress::Progress;
use crate::radiosity::{Solution, System, roughness};
use crate::scene::Scene;
use crate::solve::SolveError;
use glam::DVec3;
use std::collections::BTreeSet;

/// The part of ψ that an error is taken to reach the focus with wherever it is: a guess.
const CAUTION: f64 = 0.3;

/// Where the error counts.
#[derive(Debug, Clone, PartialEq)]
pub enum Focus {
    /// The cells of a material or of a group (object, node) of that name.
    Name(String),
    /// The cells whose middle lies in the box with these opposite corners, in metres.
    Box(DVec3, DVec3),
}

impl Focus {
    /// Which cells it means.
    pub fn cells(&self, scene: &Scene) -> Vec<bool> {
        let mesh = &scene.mesh;
        let named = |cell: usize, name: &str| {
            scene.material(cell).name == name || mesh.groups[mesh.cells[cell].group as usize] == name
        };
        let inside = |cell: usize, a: DVec3, b: DVec3| {
            let p = mesh.patch(cell).center();
            p.cmpge(a.min(b)).all() && p.cmple(a.max(b)).all()
        };
        let of = |cell| match self {
            Self::Name(name) => named(cell, name),
            &Self::Box(a, b) => inside(cell, a, b),
        };
        (0..mesh.cells.len()).map(of).collect()
    }
}

/// A focus that no cell lies in that reflects light.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("--focus: {}", missing(.focus, *.black))]
pub struct NothingInFocus {
    /// What was asked for.
    pub focus: Focus,
    /// Whether there is something there, but nothing that reflects.
    pub black: bool,
    /// The names of what gives or takes light.
    pub names: BTreeSet<String>,
    /// Corners of the box around the scene.
    pub bounds: Box<[DVec3; 2]>,
}

fn missing(focus: &Focus, black: bool) -> String {
    match focus {
        Focus::Name(name) if black => format!("nothing of `{name}` reflects light"),
        Focus::Box(a, b) if black => format!("nothing between {a} and {b} (metres) reflects light"),
        Focus::Name(name) => format!("no material and no object with a lit surface is named `{name}`"),
        Focus::Box(a, b) => format!("no surface lies between {a} and {b} (metres)"),
    }
}

impl NothingInFocus {
    pub(super) fn of(focus: &Focus, scene: &Scene, black: bool) -> Self {
        let mesh = &scene.mesh;
        let of = |cell: usize| [&scene.material(cell).name, &mesh.groups[mesh.cells[cell].group as usize]];
        let names = (0..mesh.cells.len()).flat_map(of).cloned().collect();
        Self { focus: focus.clone(), black, names, bounds: Box::new(mesh.bounds().into()) }
    }
}

/// For each cell what an error there does to the focus, relative to one within. The dual solution is that of a scene whose
/// focus glows: S is symmetric.
pub(super) fn importance(
    system: &System,
    solution: &Solution,
    focus: &[bool],
    progress: &dyn Progress,
) -> Result<Vec<f64>, SolveError> {
    let space = &solution.space;
    let mut glow = MultiVector::zeros(space.broken_dofs(), solution.bands());
    for cell in (0..space.cells()).filter(|&cell| focus[cell]) {
        for band in 0..solution.bands() {
            glow.band_mut(band)[space.range(cell)].fill(1.0);
        }
    }
    let reflected = system.reflections(&glow, progress)?;
    let dual = Solution { radiosity: reflected, ..solution.clone() };
    let rough = roughness(&dual);
    let mean = |cell: usize, band: usize| {
        let range = space.range(cell);
        dual.radiosity.band(band)[range.clone()].iter().sum::<f64>() / range.len() as f64
    };
    let of = |cell: usize| {
        let weight = |band: usize| CAUTION * mean(cell, band) + rough.band(band)[cell];
        let greatest = (0..solution.bands()).map(weight).fold(0.0, f64::max);
        if focus[cell] { 1.0 } else { greatest.min(1.0) }
    };
    Ok((0..space.cells()).map(of).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapt;
    use crate::element::Shape;
    use crate::mesh::{Cell, Mesh, Refinement};
    use crate::progress::Silent;
    use crate::radiosity::Options;
    use crate::scene::{Material, Physics, Quantity};

    /// Two squares that face each other; the first glows.
    fn plates(distance: f64) -> Scene {
        let square = |z: f64| [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z));
        let cell = |vertices, surface| Cell { shape: Shape::Quad, vertices, material: surface, group: 0, surface };
        let mesh = Mesh {
            vertices: [square(0.0), square(distance)].concat(),
            cells: vec![cell([0, 1, 2, 3], 0), cell([4, 7, 6, 5], 1)],
            groups: vec![String::new()],
            ..Mesh::default()
        };
        let glowing = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("floor", 0.5) };
        Scene::new(mesh, vec![glowing, Material::diffuse("ceiling", 0.5)], Physics::Light, None).expect("valid")
    }

    /// For each cell: whether it is in focus, its weight, and the mean of ψ.
    fn weighted(scene: &Scene, focus: &Focus) -> Vec<(bool, f64, f64)> {
        let options = Options { refinement: Refinement::Elements(128), error_points: 0, ..Options::default() };
        let system = System::build(scene, &options, &Silent).expect("built");
        let solution = system.solved(&options, &Silent).expect("solved").solution;
        let focus = focus.cells(&solution.scene);
        let weights = importance(&system, &solution, &focus, &Silent).expect("solved");
        let glow = MultiVector::from_fn(solution.space.broken_dofs(), 1, |row, _| f64::from(u8::from(focus[row / 3])));
        let dual = system.reflections(&glow, &Silent).expect("solved");
        let psi = |cell| dual.band(0)[solution.space.range(cell)].iter().sum::<f64>() / 3.0;
        (0..focus.len()).map(|cell| (focus[cell], weights[cell], psi(cell))).collect()
    }

    /// The error is that of the reflected light: before, it was nothing on a black detector, and reached on the first mesh.
    #[test]
    fn what_reflects_nothing_is_no_focus() {
        let mut scene = plates(1.0);
        let options = |name: &str| adapt::Options { focus: Some(Focus::Name(name.to_owned())), ..Default::default() };
        assert_eq!(options("floor").check_focus(&scene), Ok(()));
        let black = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("floor", 0.0) };
        scene.set_materials(vec![black, Material::diffuse("ceiling", 0.5)]).expect("as many");
        let error = options("floor").check_focus(&scene).expect_err("black");
        assert_eq!(error.to_string(), "--focus: nothing of `floor` reflects light");
        assert_eq!(options("ceiling").check_focus(&scene), Ok(()));
        assert!(!options("roof").check_focus(&scene).expect_err("nowhere").black);
    }

    /// Before, a black face whose middle was in the box was all that was looked at.
    #[test]
    fn a_box_with_the_middle_of_something_black_may_hold_a_part_of_what_reflects() {
        let mut scene = plates(1.0);
        let moved = |p: &DVec3| if p.z > 0.5 { *p + 0.4 * DVec3::X } else { *p };
        scene.mesh = Mesh { vertices: scene.mesh.vertices.iter().map(moved).collect(), ..(*scene.mesh).clone() }.into();
        scene.set_materials(vec![Material::diffuse("floor", 0.0), Material::diffuse("ceiling", 0.5)]).expect("as many");
        let options = |above: f64| {
            let focus = Focus::Box(DVec3::new(0.45, 0.3, -0.1), DVec3::new(0.75, 0.7, above));
            adapt::Options { focus: Some(focus), ..Default::default() }
        };
        assert_eq!(options(1.1).check_focus(&scene), Ok(()));
        assert!(options(0.5).check_focus(&scene).expect_err("the black floor alone").black);
    }

    #[test]
    fn where_the_dual_is_smooth_an_error_hardly_matters() {
        for (inside, weight, psi) in weighted(&plates(1.0), &Focus::Name("floor".to_owned())) {
            if inside {
                assert!((weight - 1.0).abs() < 1e-12);
            } else {
                assert!(psi > 0.05 && weight > CAUTION * psi && weight < 0.6 * psi, "{psi} {weight}");
            }
        }
    }

    /// Right above the border of a focus the dual falls within an element, which does not represent it.
    #[test]
    fn where_the_dual_is_rough_an_error_matters() {
        let half = Focus::Box(DVec3::new(0.0, 0.0, -0.01), DVec3::new(0.5, 1.0, 0.01));
        let outside: Vec<_> = weighted(&plates(0.05), &half).into_iter().filter(|(inside, ..)| !inside).collect();
        let most = outside.iter().map(|(_, _, psi)| *psi).fold(0.0, f64::max);
        let beyond: Vec<f64> = outside.iter().map(|(_, weight, psi)| (weight - CAUTION * psi) / most).collect();
        let count = |matches: &dyn Fn(f64) -> bool| beyond.iter().filter(|&&share| matches(share)).count();
        assert!(count(&|share| share > 0.01) > 10, "at the border: {beyond:?}");
        assert!(count(&|share| share < 0.001) > 10, "far from it: {beyond:?}");
    }
}
