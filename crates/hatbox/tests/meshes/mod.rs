//! Meshes to test on, as a file might hold them: every face with vertices of its own.

#[allow(dead_code, reason = "not every test is about bodies")]
pub(crate) mod bodies;
#[allow(dead_code, reason = "not every test is about rooms")]
pub(crate) mod rooms;
#[allow(dead_code, reason = "not every test is about shadows")]
pub(crate) mod shadow;

use glam::DVec3;
use hatbox::element::Shape;
use hatbox::mesh::{Cell, Mesh};

/// Adds a face with vertices of its own.
pub(crate) fn face(mesh: &mut Mesh, corners: &[DVec3], material: u32) {
    if mesh.groups.is_empty() {
        mesh.groups.push("part".to_owned());
    }
    let first = mesh.vertices.len() as u32;
    let last = corners.len() as u32 - 1;
    mesh.vertices.extend(corners);
    let shape = if corners.len() == 3 { Shape::Triangle } else { Shape::Quad };
    let vertices = [0, 1, 2, 3].map(|k: u32| first + k.min(last));
    mesh.cells.push(Cell { shape, vertices, material, group: 0, surface: 0 });
}

/// The faces of the unit cube, seen from inside.
pub(crate) const CUBE: [[[f64; 3]; 4]; 6] = [
    [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]],
    [[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]],
    [[0., 0., 0.], [0., 0., 1.], [1., 0., 1.], [1., 0., 0.]],
    [[0., 1., 0.], [1., 1., 0.], [1., 1., 1.], [0., 1., 1.]],
    [[0., 0., 0.], [0., 1., 0.], [0., 1., 1.], [0., 0., 1.]],
    [[1., 0., 0.], [1., 0., 1.], [1., 1., 1.], [1., 1., 0.]],
];

/// A room of quads seen from inside, every face with vertices of its own; `split(k)` cuts face k into triangles.
pub(crate) fn room(size: DVec3, split: impl Fn(usize) -> bool) -> Mesh {
    let mut mesh = Mesh::default();
    for (k, corners) in CUBE.iter().enumerate() {
        let [a, b, c, d] = corners.map(|p| DVec3::from(p) * size);
        if split(k) {
            face(&mut mesh, &[a, b, c], 0);
            face(&mut mesh, &[a, c, d], 0);
        } else {
            face(&mut mesh, &[a, b, c, d], 0);
        }
    }
    mesh
}

/// An icosahedron subdivided `times` times and pushed out to the unit sphere.
pub(crate) fn icosphere(times: u32) -> Mesh {
    let g = f64::midpoint(1.0, 5.0_f64.sqrt());
    let corners: Vec<DVec3> = [(1.0, g), (1.0, -g), (-1.0, g), (-1.0, -g)]
        .into_iter()
        .flat_map(|(s, t)| [DVec3::new(0.0, s, t), DVec3::new(s, t, 0.0), DVec3::new(t, 0.0, s)])
        .map(DVec3::normalize)
        .collect();
    let near = |a: &DVec3, b: &DVec3| a.distance(*b) < 1.1;
    let mut triangles = Vec::new();
    for (i, a) in corners.iter().enumerate() {
        for (j, b) in corners[..i].iter().enumerate() {
            for c in corners[..j].iter().filter(|c| near(a, b) && near(b, c) && near(c, a)) {
                let outwards = (b - a).cross(c - a).dot(*a) > 0.0;
                triangles.push(if outwards { [*a, *b, *c] } else { [*a, *c, *b] });
            }
        }
    }
    for _ in 0..times {
        let quarter = |[a, b, c]: [DVec3; 3]| {
            let [p, q, r] = [a + b, b + c, c + a].map(DVec3::normalize);
            [[a, p, r], [p, b, q], [r, q, c], [p, q, r]]
        };
        triangles = triangles.into_iter().flat_map(quarter).collect();
    }
    let mut mesh = Mesh::default();
    for triangle in &triangles {
        face(&mut mesh, triangle, 0);
    }
    mesh
}

/// The Cornell box in metres, of one material.
pub(crate) fn cornell() -> Mesh {
    let text = include_str!("../data/cornell.obj");
    let mut points = Vec::new();
    let mut mesh = Mesh::default();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let kind = words.next();
        let numbers: Vec<f64> = words.filter_map(|w| w.parse().ok()).collect();
        match kind {
            Some("v") => points.push(DVec3::new(numbers[0], numbers[1], numbers[2]) * 0.001),
            Some("f") => face(&mut mesh, &[0, 1, 2].map(|k| points[numbers[k] as usize - 1]), 0),
            _ => {}
        }
    }
    mesh
}
