//! Hatbox computes how diffuse light, or radiant heat, settles in a scene, by the finite-element method.
//!
//! The radiosity B is what leaves a surface, in lm/m² or W/m². It obeys
//!
//! > B(x) = B⁰(x) + R(x) ∫ B(y) G(x,y) V(x,y) dA(y),  G(x,y) = cosθ_x cosθ_y / (π |x − y|²)
//!
//! with the exitance B⁰ of the lamps, the reflectance R and the visibility V. Hatbox looks for B in the span of shape
//! functions N_k on the cells of a mesh and asks the residual to be orthogonal to all of them (Galerkin's method). The
//! result is a *function on the surfaces*, constant, linear or quadratic on each cell, from which everything else is
//! made: values at points, baked vertices, pictures, balances of power.
//!
//! # From a file to a file
//!
//! [`io::read_scene`] reads glTF, OBJ or a scene file, [`radiosity::solve`] does the rest, [`io::write()`] chooses the format
//! by the extension.
//!
//! ```
//! use hatbox::io::{WriteOptions, read_scene, write};
//! use hatbox::mesh::Refinement;
//! use hatbox::progress::Silent;
//! use hatbox::radiosity::{Options, Shown, solve};
//! use std::path::Path;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/cornell-box.glb"));
//! let (scene, warnings) = read_scene(file)?;
//! for warning in &warnings {
//!     eprintln!("{warning}");
//! }
//!
//! // Few elements, to be quick here; the default is 3000. The basis is "linear": hats at the vertices of triangles.
//! let options = Options { refinement: Refinement::Elements(250), tolerance: 0.02, ..Options::default() };
//! let solved = solve(&scene, &options, &Silent)?;
//!
//! // The solution is a function. Its value in the middle of the first cell, in the first band (red), two ways: B from the
//! // joined hats, and B⁰ + R E with E in the broken space. They differ by what a mesh this coarse cannot resolve.
//! let (solution, middle) = (&solved.solution, [1.0 / 3.0, 1.0 / 3.0]);
//! let b = solution.evaluate(Shown::Radiosity, 0, middle, 0);
//! let e = solution.evaluate(Shown::Irradiance, 0, middle, 0);
//! let material = solution.scene.material(0);
//! let r = material.reflectance.uniform(0).ok_or("the Cornell box has no textures")?;
//! let b0 = material.exitance.uniform(0).ok_or("the Cornell box has no textures")?;
//! assert!((b - (b0 + r * e)).abs() < 0.1 * b, "{b} {}", b0 + r * e);
//!
//! // The power that the lamp emits is absorbed or escapes through the open front: Galerkin's method loses none.
//! assert!(solved.energy.defect() < 1e-9);
//! assert!(solved.energy.escaped.iter().all(|&lumens| lumens > 0.0));
//!
//! // Radiosity at the vertices, for any program that draws glTF.
//! let folder = tempfile::tempdir()?;
//! let baked = folder.path().join("cornell.glb");
//! write(solution, &baked, &WriteOptions::default())?;
//! assert!(baked.exists());
//! # Ok(())
//! # }
//! ```
//!
//! # A scene in code, and what the classical method is
//!
//! Two unit squares face each other at distance 1. How much of what leaves one reaches the other is known exactly
//! (Howell's catalogue of view factors, C-11).
//!
//! ```
//! use glam::DVec3;
//! use hatbox::assemble::{Accuracy, Panel, Sight, pair_block};
//! use hatbox::element::Basis;
//! use hatbox::mesh::{Cell, Mesh};
//! use hatbox::element::Shape;
//! use hatbox::scene::{Material, Physics, Quantity, Scene};
//! use hatbox::space::{Continuity, FunctionSpace};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
//! let mesh = Mesh {
//!     vertices: vec![
//!         // The floor, counter-clockwise when seen from above ...
//!         corner(0.0, 0.0, 0.0), corner(1.0, 0.0, 0.0), corner(1.0, 1.0, 0.0), corner(0.0, 1.0, 0.0),
//!         // ... and the ceiling, counter-clockwise when seen from below: the sides that they light.
//!         corner(0.0, 0.0, 1.0), corner(0.0, 1.0, 1.0), corner(1.0, 1.0, 1.0), corner(1.0, 0.0, 1.0),
//!     ],
//!     cells: vec![
//!         Cell { shape: Shape::Quad, vertices: [0, 1, 2, 3], material: 0, group: 0, surface: 0 },
//!         Cell { shape: Shape::Quad, vertices: [4, 5, 6, 7], material: 1, group: 0, surface: 0 },
//!     ],
//!     groups: vec!["squares".into()],
//!     ..Mesh::default()
//! };
//! let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
//! let scene = Scene::new(mesh, vec![Material::diffuse("paint", 0.5), lamp], Physics::Light, None)?;
//!
//! // S_ij = ∬ N_i N_j G for the one pair of cells, with a basis of one function and of four per cell.
//! let exact = 0.199_824_895_698_387;
//! for name in ["constant", "bilinear"] {
//!     let basis = Basis::named(name).ok_or("no such basis")?;
//!     let space = FunctionSpace::new(&scene, basis, Continuity::Broken)?;
//!     let panels = Panel::of(&scene.mesh, &space);
//!     let accuracy = Accuracy::new(1e-7, scene.mesh.area());
//!     let block = pair_block(&panels[0], &panels[1], Sight::Clear, [1.0, 1.0], &accuracy);
//!     // Shape functions sum to 1, so the entries of any basis sum to ∬ G = A₁ F₁₂.
//!     let view_factor = block.sum() / panels[0].area();
//!     assert!((view_factor - exact).abs() < 1e-7, "{name}: {view_factor}");
//! }
//! # Ok(())
//! # }
//! ```
//!
//! With one constant function per cell the system Δ b = b⁰ + F̂ b is classical radiosity: Δ holds the areas, F̂_ij is
//! R_i A_i F_ij. Here nothing comes back from the lamp, and the floor's radiosity is R F₁₂ times that of the lamp:
//!
//! ```
//! # use glam::DVec3;
//! # use hatbox::element::{Basis, Shape};
//! # use hatbox::mesh::{Cell, Mesh, Refinement};
//! # use hatbox::progress::Silent;
//! # use hatbox::radiosity::{Options, solve};
//! # use hatbox::scene::{Material, Physics, Quantity, Scene};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]];
//! # let vertices = vertices.map(|v| DVec3::from_array(v.map(f64::from))).to_vec();
//! # let cell = |vertices, material| Cell { shape: Shape::Quad, vertices, material, group: 0, surface: 0 };
//! # let cells = vec![cell([0, 1, 2, 3], 0), cell([4, 5, 6, 7], 1)];
//! # let mesh = Mesh { vertices, cells, groups: vec!["squares".into()], ..Mesh::default() };
//! # let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
//! # let scene = Scene::new(mesh, vec![Material::diffuse("paint", 0.5), lamp], Physics::Light, None)?;
//! let options = Options {
//!     basis: Basis::named("constant").ok_or("no such basis")?,
//!     refinement: Refinement::None,
//!     tolerance: 1e-7,
//!     ..Options::default()
//! };
//! let solved = solve(&scene, &options, &Silent)?;
//! let [floor, lamp] = [0, 1].map(|cell| solved.solution.radiosity.band(0)[cell]);
//! assert!((lamp - 1.0).abs() < 1e-12);
//! assert!((floor - 0.5 * 0.199_824_895_698_387).abs() < 1e-7);
//! # Ok(())
//! # }
//! ```
//!
//! # Where things are
//!
//! From the bottom up; each module uses only those above it in this list (`ARCHITECTURE.md` has the exact order, and a
//! test reads it).
//!
//! - [`linalg`], [`solve`](mod@solve), [`progress`]: vectors with several bands, operators, Krylov methods. No light.
//! - [`element`], [`quadrature`], [`mesh`], [`kernel`], [`scene`]: shape functions, rules, cells, G, materials.
//! - [`visibility`], [`space`]: what blocks a ray; how cells are joined.
//! - [`assemble`], [`exchange`]: the integrals, and the operator S that they make.
//! - [`radiosity`]: the equation put together and solved.
//! - [`adapt`]: meshes refined until the error is what was asked for.
//! - [`view_factors`], [`check`]: what can be said before there is light.
//! - [`bake`], [`probe`], [`report`], [`render`], [`io`]: what a solution becomes.
//! - [`failure`]: what is said when something is wrong.

#![warn(unsafe_code, clippy::print_stdout, clippy::print_stderr, clippy::exit)]
#![cfg_attr(test, allow(clippy::float_cmp, reason = "tests say `==` where they mean exactly equal"))]

pub mod adapt;
pub mod assemble;
pub mod bake;
pub mod certificate;
pub mod check;
pub mod element;
pub mod exchange;
pub mod failure;
pub mod io;
pub mod kernel;
pub mod linalg;
pub mod mesh;
pub mod probe;
pub mod progress;
pub mod quadrature;
pub mod radiosity;
pub mod render;
pub mod report;
pub mod scene;
pub mod solve;
pub mod space;
pub mod view_factors;
pub mod visibility;
