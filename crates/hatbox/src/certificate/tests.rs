//! Whether what is enclosed is what arrives, at points of random receivers in random scenes with random light.

use super::*;
use crate::element::{ALL, Shape};
use crate::kernel::Plane;
use crate::linalg::MultiVector;
use crate::mesh::{Cell, Mesh, Refinement};
use crate::quadrature::sequence::{hash, unit};
use crate::radiosity::Sources;
use crate::scene::Physics;
use crate::space::{Continuity, FunctionSpace};
use glam::DVec3;

struct Random(u64, u64);

impl Random {
    fn number(&mut self) -> f64 {
        self.1 += 1;
        unit(hash(self.0, self.1))
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.number(), self.number(), self.number())
    }
}

fn face(mesh: &mut Mesh, corners: [DVec3; 4], material: u32) {
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(corners);
    let vertices = [0, 1, 2, 3].map(|k| first + k);
    mesh.cells.push(Cell { shape: Shape::Quad, vertices, material, group: 0, surface: 0 });
}

/// The faces of the box between two corners, seen from inside or from outside.
fn cuboid(mesh: &mut Mesh, [from, to]: [DVec3; 2], inside: bool) {
    for axis in 0..3 {
        for high in [false, true] {
            let corner = |u: bool, v: bool| {
                let mut upper = [high; 3];
                (upper[(axis + 1) % 3], upper[(axis + 2) % 3]) = (u, v);
                DVec3::from_array(std::array::from_fn(|k| if upper[k] { to[k] } else { from[k] }))
            };
            let mut corners = [corner(false, false), corner(true, false), corner(true, true), corner(false, true)];
            if high == inside {
                corners.reverse();
            }
            face(mesh, corners, 0);
        }
    }
}

/// A room with a box and a sheet in it; one in three lacks a wall.
fn random_solution(random: &mut Random, seed: u64) -> Solution {
    let mut mesh = Mesh { groups: vec!["part".to_owned()], ..Mesh::default() };
    cuboid(&mut mesh, [DVec3::ZERO, DVec3::ONE], true);
    if seed.is_multiple_of(3) {
        mesh.cells.remove(5);
    }
    let from = 0.1 + 0.4 * random.vector();
    let from = if seed.is_multiple_of(2) { DVec3::new(from.x, from.y, 0.0) } else { from };
    cuboid(&mut mesh, [from, from + 0.1 + 0.25 * random.vector()], false);
    let (at, a, b) = (0.2 + 0.5 * random.vector(), 0.3 * random.vector(), 0.3 * (random.vector() - 0.5));
    face(&mut mesh, [at, at + a, at + a + b, at + b], 1);
    let sheet = Material { two_sided: true, ..Material::diffuse("sheet", 0.5) };
    let scene = Scene::new(mesh, vec![Material::diffuse("room", 0.5), sheet], Physics::Light, None).expect("valid");
    let basis = [&ALL[0], &ALL[1], &ALL[3]][seed as usize % 3];
    let elements = 20 + (200.0 * random.number()) as usize;
    let scene = scene.refined(Refinement::Elements(elements), basis).expect("refined");
    let space = FunctionSpace::new(&scene, basis, Continuity::Broken).expect("elements");
    let value = |random: &mut Random| 2.0 * random.number() - 0.5;
    let values = (0..space.broken_dofs()).map(|_| value(random)).collect();
    let radiosity = MultiVector::from_bands(1, values).expect("one band");
    Solution { irradiance: MultiVector::zeros(radiosity.rows(), 1), radiosity, scene, space }
}

/// For random parts of random cells: what may be wrong, and how wrong it is at a point.
fn tried(seed: u64) -> Vec<[f64; 2]> {
    let mut random = Random(seed, 0);
    let solution = random_solution(&mut random, seed);
    let scene = &solution.scene;
    let blockers = Arc::new(Bvh::of_surfaces(&scene.surfaces));
    let (occluders, cells) = (Occluders::new(&scene.surfaces), OnceLock::new());
    let geometry = Geometry::new(scene, &solution.space, &blockers, &cells);
    let (panels, views) = (geometry.panels(), Views { occluders: &occluders, blockers: &blockers });
    let light = Light::new(&solution, 0).expect("uniform");
    let bounding = Bounding::new(&light, &geometry, views).expect("polynomials");
    let (sources, mut found) = (Sources::all(&solution), Vec::new());
    for _ in 0..40 {
        let cell = (random.number() * panels.len() as f64) as usize;
        let (mut patch, mut known) = (panels[cell].patch, None);
        for _ in 0..=(6.0 * random.number()) as usize {
            let fine = [10_f64.powf(-1.0 - 3.0 * random.number()); LANES];
            let (enclosed, sight) = bounding.arriving(&panels[cell], &patch, known.as_ref(), fine);
            // Near a corner, where a linear function is farthest off, but not on an edge.
            let corner = patch.corners()[(random.number() * patch.corners().len() as f64) as usize];
            let x = patch.center().lerp(corner, 0.99 * random.number().sqrt());
            let exact = sources.irradiance(cell, panels[cell].patch.locate(x), 1)[0];
            let value = enclosed.value[0] + enclosed.gradient[0].dot(x - patch.center());
            found.push([enclosed.rest[0], (value - exact).abs()]);
            known = Some(sight);
            patch = quarters(&patch)[(4.0 * random.number()) as usize];
        }
    }
    found
}

#[test]
fn what_arrives_is_within_what_is_enclosed() {
    let all: Vec<[f64; 2]> = (0..24).into_par_iter().flat_map_iter(tried).collect();
    for [rest, error] in &all {
        assert!(*error <= rest + 1e-6, "{error} > {rest}");
    }
    // Where little is known, nothing can be wrong; and what is known is used up, here and there.
    let close = all.iter().filter(|[rest, _]| *rest < 0.1).count();
    assert!(close > all.len() / 10, "{close} of {}", all.len());
    let used = all.iter().map(|[rest, error]| error / rest).fold(0.0, f64::max);
    assert!(used > 0.5, "{used}");
}

/// One piece alone, against a fine rule: the part of the light that is not its mean.
#[test]
fn the_slope_of_a_piece_sends_what_is_expected_of_it() {
    let at = |x: f64, y: f64| DVec3::new(x, y, 1.0);
    let last = at(0.4, 0.1);
    let patch = Patch::new(Shape::Triangle, [at(0.0, 0.0), at(0.2, 0.5), last, last]);
    let plane = Plane::new(patch.corners()[0], patch.normal());
    let functions = [[0.2, 1.5, -2.0, 0.4, 0.3, -0.6]; LANES];
    let piece = piece::Piece::new(patch, &plane, &functions);
    let arriving = |x: DVec3| {
        let mean = |y: DVec3| evaluate(&functions[0], &plane, y) - piece.mean[0];
        let parts = quarters(&patch).into_iter().flat_map(|part| quarters(&part));
        parts
            .map(|part| integral(&part, |y| mean(y) * crate::kernel::geometric(x, DVec3::Z, y, DVec3::NEG_Z)))
            .sum::<f64>()
    };
    for radius in [0.0, 0.1, 0.2] {
        let center = DVec3::new(0.7, 0.6, 0.0);
        let nearest = piece.center.distance(center) - piece.radius - radius;
        let normals = [DVec3::Z, DVec3::NEG_Z];
        let [value, rest] = enclosure::uneven(&piece, normals, center, radius, nearest, 1.0).map(|lanes| lanes[0]);
        for k in 0..20 {
            let (sin, cos) = f64::from(k).sin_cos();
            let error = (arriving(center + radius * DVec3::new(cos, sin, 0.0)) - value).abs();
            assert!(error <= rest && rest < 0.3, "{radius}: {error} > {rest}");
        }
    }
}
