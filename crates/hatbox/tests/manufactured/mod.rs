//! The manufactured solution: B is chosen, smooth on the whole cube, and B⁰ := B − R∫BG by quadrature that shares nothing
//! with the assembly but the closed form of a polynomial's irradiance.

use super::meshes;
use glam::{DVec2, DVec3};
use hatbox::element::Shape;
use hatbox::kernel::{Moments, Plane, geometric};
use hatbox::mesh::{Mesh, Patch};
use hatbox::quadrature::{gauss_legendre, rule};
use hatbox::radiosity::Solution;
use hatbox::scene::{Material, Physics, Quantity, Scene, Site};

/// The reflectance.
pub(crate) const RHO: f64 = 0.5;

/// The closed cube whose radiosity is the chosen one.
pub(crate) fn scene() -> Scene {
    let b0 = |site: &Site, _| chosen(site.position) - RHO * chosen_irradiance(site.position);
    let material = Material { exitance: Quantity::function(b0), ..Material::diffuse("all", RHO) };
    Scene::new(meshes::room(DVec3::ONE, |_| false), vec![material], Physics::Light, None).expect("a valid scene")
}

/// The radiosity that is to be found.
pub(crate) fn chosen(p: DVec3) -> f64 {
    1.5 + (1.3 * p.x + 0.4).sin() * (0.9 * p.y - 0.2).cos() * (0.5 * p.z).exp()
}

/// ∫BG over the cube's other faces at a point inside a face: on each face B's quadratic Taylor polynomial about the point
/// nearest to x is integrated in closed form; the rest is O(r³) against the kernel's r⁻² and a Gauss rule does it.
pub(crate) fn chosen_irradiance(x: DVec3) -> f64 {
    let own = |k: usize| meshes::CUBE[k].iter().all(|c| on_plane(c, k, x));
    let n = (0..6).find(|&k| own(k)).map_or(DVec3::ZERO, |k| face(k).normal());
    (0..6).filter(|&k| !own(k)).map(|k| from_face(&face(k), x, n)).sum()
}

fn face(k: usize) -> Patch {
    Patch::new(Shape::Quad, meshes::CUBE[k].map(DVec3::from))
}

/// Whether x lies in the plane of face k (which the corner spans with its normal).
fn on_plane(corner: &[f64; 3], k: usize, x: DVec3) -> bool {
    (x - DVec3::from(*corner)).dot(face(k).normal()).abs() < 1e-12
}

fn from_face(face: &Patch, x: DVec3, n: DVec3) -> f64 {
    let plane = Plane::new(face.corners()[0], face.normal());
    let [e1, e2, _] = plane.axes;
    let foot = x - face.normal() * face.normal().dot(x - face.corners()[0]);
    let step = 1e-3;
    let b = |i: f64, j: f64| chosen(foot + (e1 * i + e2 * j) * step);
    let slope = DVec2::new(b(1.0, 0.0) - b(-1.0, 0.0), b(0.0, 1.0) - b(0.0, -1.0)) / (2.0 * step);
    let curve = [
        (b(1.0, 0.0) - 2.0 * b(0.0, 0.0) + b(-1.0, 0.0)) / (2.0 * step * step),
        (b(1.0, 1.0) - b(1.0, -1.0) - b(-1.0, 1.0) + b(-1.0, -1.0)) / (4.0 * step * step),
        (b(0.0, 1.0) - 2.0 * b(0.0, 0.0) + b(0.0, -1.0)) / (2.0 * step * step),
    ];
    let outline = [0, 1, 2, 3].map(|k| plane.project(face.corners()[k]));
    let moments = Moments::new(&plane, &outline, x, n, 2);
    let m = moments.values;
    let polynomial =
        b(0.0, 0.0) * m[0] + slope.dot(DVec2::new(m[1], m[2])) + curve[0] * m[3] + curve[1] * m[4] + curve[2] * m[5];
    let mut rest = 0.0;
    let gauss = gauss_legendre(8);
    for (&(s, ws), &(t, wt)) in gauss.iter().flat_map(|s| gauss.iter().map(move |t| (s, t))) {
        let y = face.point([s, t]);
        let rho = plane.project(y) - moments.foot;
        let taylor = b(0.0, 0.0)
            + slope.dot(rho)
            + curve[0] * rho.x * rho.x
            + curve[1] * rho.x * rho.y
            + curve[2] * rho.y * rho.y;
        rest += ws * wt * face.area() * (chosen(y) - taylor) * geometric(x, n, y, face.normal());
    }
    polynomial + rest
}

/// ‖B̃ − B‖ over the scene.
pub(crate) fn l2_error(solution: &Solution) -> f64 {
    let mesh: &Mesh = &solution.scene.mesh;
    let mut sum = 0.0;
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        let rule = rule(patch.shape(), 8);
        for (&at, weight) in rule.points.iter().zip(&rule.weights) {
            let found = solution.evaluate(hatbox::radiosity::Shown::Radiosity, cell, at, 0);
            sum += weight * patch.area() * (found - chosen(patch.point(at))).powi(2);
        }
    }
    sum.sqrt()
}
