//! Integrals over one panel at a time.
//!
//! Data that are the same all over a cell are integrated exactly. Data that vary (textures, given functions) may have
//! edges of their own, so their cells are cut into quarters until two rules agree.

use crate::element::{Element, MAX_DOFS, Shape};
use crate::linalg::{BlockDiagonal, DiagonalBlock, MultiVector};
use crate::mesh::Patch;
use crate::quadrature::rule;
use crate::scene::{Quantity, Scene, Site};
use crate::space::FunctionSpace;
use rayon::prelude::*;

/// Degrees of the rule for data that vary over an element, and of the one that checks it.
const VARYING_DEGREES: [usize; 2] = [8, 5];
/// Relative error up to which integrals of such data are refined.
const VARYING_TOLERANCE: f64 = 1e-6;
/// Rounds of quartering of a given function at the most.
const MAX_DEPTH: u32 = 3;
/// Texels along a part at the most: a texture's cells are cut at least so finely, or two rules that both miss a lamp of a
/// few texels would agree that it is dark.
const TEXELS: f64 = 2.0;
/// Rounds of quartering for texels at the most: 4096 parts.
const MAX_TEXEL_DEPTH: u32 = 6;

/// Maps that are affine to so little of their size are so to rounding.
const EXACTLY: f64 = 1e-12;

/// The most numbers that one integral has.
const MAX_SIZE: usize = MAX_DOFS * MAX_DOFS;
type Values = [f64; MAX_SIZE];

/// Δ_ij = ∫ N_i N_j, in m²: one block per cell.
pub fn mass(scene: &Scene, space: &FunctionSpace) -> BlockDiagonal {
    weighted_blocks(scene, space, 1, |_, _| Weight::Uniform(1.0))
}

/// (M_R)_ij = ∫ R N_i N_j, in m², for each band.
pub fn weighted_mass(scene: &Scene, space: &FunctionSpace) -> BlockDiagonal {
    weighted_blocks(scene, space, scene.bands, |cell, band| Weight::of(&scene.material(cell).reflectance, band))
}

/// (M_ε)_ij = ∫ ε N_i N_j for a function ε of the broken space, given by its coefficients.
pub fn function_weighted_mass(scene: &Scene, space: &FunctionSpace, epsilon: &[f64]) -> BlockDiagonal {
    weighted_blocks(scene, space, 1, |cell, _| Weight::Expansion(&epsilon[space.range(cell)]))
}

/// b⁰_i = ∫ B⁰ N_i, in lm or W, for each band.
pub fn load(scene: &Scene, space: &FunctionSpace) -> MultiVector {
    let entry = |cell: usize, band: usize| {
        let exitance = &scene.material(cell).exitance;
        let element = space.element(cell);
        let form = |w: f64, functions: &[f64; MAX_DOFS], out: &mut Values| {
            for (out, n) in out.iter_mut().zip(functions) {
                *out += w * n;
            }
        };
        Integral { scene, space, cell, band, degree: element.degree }.of(&Weight::of(exitance, band), form)
    };
    let mut result = MultiVector::zeros(space.broken_dofs(), scene.bands);
    for band in 0..scene.bands {
        let mut rest = result.band_mut(band);
        let mut places = Vec::with_capacity(space.cells());
        for cell in 0..space.cells() {
            let (place, after) = rest.split_at_mut(space.range(cell).len());
            places.push(place);
            rest = after;
        }
        places.into_par_iter().enumerate().for_each(|(cell, place)| {
            let values = entry(cell, band);
            place.copy_from_slice(&values[..place.len()]);
        });
    }
    result
}

/// ∫ w N_i N_j for each cell and band.
fn weighted_blocks<'a>(
    scene: &Scene,
    space: &FunctionSpace,
    bands: usize,
    weight: impl Fn(usize, usize) -> Weight<'a> + Sync,
) -> BlockDiagonal {
    let mut elements: Vec<&'static Element> = Vec::new();
    for element in (0..space.cells()).map(|cell| space.element(cell)) {
        if !elements.iter().any(|known| std::ptr::eq(*known, element)) {
            elements.push(element);
        }
    }
    let matrices: Vec<Vec<f64>> = elements.iter().map(|element| reference_mass(element)).collect();
    BlockDiagonal::new(space.offsets(), bands, matrices, |band, cell| {
        let (element, patch, weight) = (space.element(cell), scene.mesh.patch(cell), weight(cell, band));
        let kind = elements.iter().position(|known| std::ptr::eq(*known, element)).unwrap_or(0);
        match weight {
            Weight::Uniform(w) if w == 0.0 || patch.is_affine_to(EXACTLY) => {
                DiagonalBlock::Multiple(kind, w * patch.area())
            }
            _ => {
                let n = element.dofs();
                let form = |w: f64, functions: &[f64; MAX_DOFS], out: &mut Values| add_products(w, functions, n, out);
                let integral = Integral { scene, space, cell, band, degree: 2 * element.degree }.of(&weight, form);
                DiagonalBlock::Own(integral[..n * n].to_vec())
            }
        }
    })
}

/// ∫N_i N_j over the reference cell divided by its area, row by row.
fn reference_mass(element: &Element) -> Vec<f64> {
    let (n, mut mass) = (element.dofs(), [0.0; MAX_SIZE]);
    let rule = rule(element.shape, 2 * element.degree);
    for (&at, &weight) in rule.points.iter().zip(&rule.weights) {
        add_products(weight, &element.values(at), n, &mut mass);
    }
    mass[..n * n].to_vec()
}

/// Adds w N_i N_j, row by row, for the first n functions.
fn add_products(w: f64, functions: &[f64; MAX_DOFS], n: usize, out: &mut Values) {
    for (k, out) in out[..n * n].iter_mut().enumerate() {
        *out += w * functions[k / n] * functions[k % n];
    }
}

/// What is integrated against products of shape functions.
enum Weight<'a> {
    /// The same everywhere.
    Uniform(f64),
    /// Varies with the place.
    Varying(&'a Quantity),
    /// Σ ε_k N_k.
    Expansion(&'a [f64]),
}

impl<'a> Weight<'a> {
    fn of(quantity: &'a Quantity, band: usize) -> Self {
        quantity.uniform(band).map_or(Self::Varying(quantity), Self::Uniform)
    }
}

/// An integral over a cell.
struct Integral<'a> {
    scene: &'a Scene,
    space: &'a FunctionSpace,
    cell: usize,
    band: usize,
    /// Degree of the products of shape functions.
    degree: usize,
}

impl Integral<'_> {
    /// Σ_q form(w(x_q) dA_q, N(x_q)).
    fn of(&self, weight: &Weight<'_>, form: impl Fn(f64, &[f64; MAX_DOFS], &mut Values)) -> Values {
        let patch = self.scene.mesh.patch(self.cell);
        let whole = Part::whole();
        // A bilinear map adds up to two degrees through its Jacobian.
        match weight {
            Weight::Uniform(w) if *w == 0.0 => [0.0; MAX_SIZE],
            Weight::Uniform(w) => self.rule(&patch, &whole, self.degree + 2, &form, |_, _| *w),
            Weight::Expansion(epsilon) => {
                let w = |_, functions: &[f64; MAX_DOFS]| epsilon.iter().zip(functions).map(|(e, n)| e * n).sum();
                let degree = self.degree + self.space.element(self.cell).degree + 2;
                self.rule(&patch, &whole, degree, &form, w)
            }
            Weight::Varying(quantity) => {
                let w = |at: [f64; 2], _: &[f64; MAX_DOFS]| {
                    let uv = self.scene.mesh.uv(self.cell, at);
                    quantity.at(&Site { position: patch.point(at), uv }, self.band)
                };
                self.refined(&patch, self.texel_depth(quantity), &form, w)
            }
        }
    }

    /// Rounds of quartering after which a part covers only a few texels.
    fn texel_depth(&self, quantity: &Quantity) -> u32 {
        let Quantity::Textured { texture, .. } = quantity else { return 0 };
        let Some(corners) = self.scene.mesh.uvs.get(self.cell) else { return 0 };
        let (lo, hi) = corners.iter().fold((corners[0], corners[0]), |(lo, hi), uv| (lo.min(*uv), hi.max(*uv)));
        let texels = ((hi.x - lo.x) * texture.width() as f64).max((hi.y - lo.y) * texture.height() as f64);
        ((texels / TEXELS).log2().ceil().max(0.0) as u32).min(MAX_TEXEL_DEPTH)
    }

    /// Cuts into quarters, at least `least` times, until the two rules agree.
    fn refined(
        &self,
        patch: &Patch,
        least: u32,
        form: &impl Fn(f64, &[f64; MAX_DOFS], &mut Values),
        w: impl Fn([f64; 2], &[f64; MAX_DOFS]) -> f64,
    ) -> Values {
        let mut total = [0.0; MAX_SIZE];
        let mut scale = 0.0_f64;
        let most = least.max(MAX_DEPTH);
        let mut parts = vec![(Part::whole(), 0)];
        while let Some((part, depth)) = parts.pop() {
            if depth < least {
                parts.extend(part.quarters(patch.shape()).map(|quarter| (quarter, depth + 1)));
                continue;
            }
            let [fine, check] = VARYING_DEGREES.map(|degree| self.rule(patch, &part, degree, form, &w));
            let error = largest(fine.iter().zip(&check).map(|(a, b)| a - b));
            // A part may err by its share of the area.
            scale = scale.max(largest(fine.iter().copied()) / part.scale());
            if error <= VARYING_TOLERANCE * scale * part.scale() || depth == most {
                total = std::array::from_fn(|k| total[k] + fine[k]);
            } else {
                parts.extend(part.quarters(patch.shape()).map(|quarter| (quarter, depth + 1)));
            }
        }
        total
    }

    fn rule(
        &self,
        patch: &Patch,
        part: &Part,
        degree: usize,
        form: &impl Fn(f64, &[f64; MAX_DOFS], &mut Values),
        w: impl Fn([f64; 2], &[f64; MAX_DOFS]) -> f64,
    ) -> Values {
        let element = self.space.element(self.cell);
        let rule = rule(element.shape, degree);
        let mut values = [0.0; MAX_SIZE];
        for (&at, weight) in rule.points.iter().zip(&rule.weights) {
            let at = part.point(at);
            let area = weight * part.scale() * patch.shape().reference_area() * patch.jacobian(at);
            let functions = element.values(at);
            form(area * w(at, &functions), &functions, &mut values);
        }
        values
    }
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.map(f64::abs).fold(0.0, f64::max)
}

/// An affine copy of the reference cell inside it: ξ ↦ origin + u ξ + v η.
#[derive(Clone, Copy)]
struct Part {
    origin: [f64; 2],
    u: [f64; 2],
    v: [f64; 2],
}

impl Part {
    fn whole() -> Self {
        Self { origin: [0.0; 2], u: [1.0, 0.0], v: [0.0, 1.0] }
    }

    fn point(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|k| self.origin[k] + self.u[k] * x + self.v[k] * y)
    }

    /// Its area relative to the reference cell's.
    fn scale(&self) -> f64 {
        (self.u[0] * self.v[1] - self.u[1] * self.v[0]).abs()
    }

    fn quarters(&self, shape: Shape) -> [Self; 4] {
        let half = |a: [f64; 2], sign: f64| a.map(|x| 0.5 * sign * x);
        let at = |x, y, sign| Self { origin: self.point([x, y]), u: half(self.u, sign), v: half(self.v, sign) };
        let last = match shape {
            // The middle triangle is upside down.
            Shape::Triangle => at(0.5, 0.5, -1.0),
            Shape::Quad => at(0.5, 0.5, 1.0),
        };
        [at(0.0, 0.0, 1.0), at(0.5, 0.0, 1.0), at(0.0, 0.5, 1.0), last]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::ALL;
    use crate::mesh::{Cell, Mesh};
    use crate::scene::{Material, Physics, Texture, Wrap};
    use glam::DVec3;

    fn scene(shape: Shape, exitance: Quantity) -> Scene {
        let vertices = [(0.0, 0.0), (2.0, 0.0), (1.5, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
        let last = if shape == Shape::Quad { 3 } else { 2 };
        let cell = Cell { shape, vertices: [0, 1, 2, last], material: 0, group: 0, surface: 0 };
        let mesh = Mesh { vertices, cells: vec![cell], groups: vec!["one".to_owned()], ..Mesh::default() };
        let material = Material { exitance, ..Material::diffuse("one", 0.5) };
        Scene::new(mesh, vec![material], Physics::Light, None).expect("valid")
    }

    #[test]
    fn masses_sum_to_the_area_in_every_element() {
        for basis in &ALL {
            for shape in Shape::ALL.into_iter().filter(|&shape| basis.element(shape).is_some()) {
                let scene = scene(shape, Quantity::gray(0.0));
                let space = FunctionSpace::broken(&scene.mesh, basis).expect("an element");
                let sum: f64 = mass(&scene, &space).block(0, 0).iter().sum();
                assert!((sum - scene.mesh.area()).abs() < 1e-14, "{} {shape:?}", basis.name);
            }
        }
    }

    #[test]
    fn a_lamp_of_a_few_texels_on_a_large_cell_keeps_its_power() {
        let (n, lamp) = (64, 4);
        let texel =
            |k: usize| if (20..20 + lamp).contains(&(k % n)) && (37..37 + lamp).contains(&(k / n)) { 1.0 } else { 0.0 };
        let texture = Texture::new(n, n, 1, (0..n * n).map(texel).collect(), [Wrap::Clamp; 2]).expect("fits");
        let mut mesh = (*scene(Shape::Quad, Quantity::gray(0.0)).mesh).clone();
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        mesh.vertices = square.map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
        mesh.uvs = vec![square.map(|(x, y)| glam::DVec2::new(x, y))];
        let exitance = Quantity::Textured { factor: vec![1.0], texture: std::sync::Arc::new(texture) };
        let material = Material { exitance, ..Material::diffuse("lamp", 0.5) };
        let scene = Scene::new(mesh, vec![material], Physics::Light, None).expect("valid");
        let space = FunctionSpace::broken(&scene.mesh, &ALL[2]).expect("an element");
        let power: f64 = load(&scene, &space).band(0).iter().sum();
        let exact = (lamp * lamp) as f64 / (n * n) as f64;
        assert!((power - exact).abs() < 0.02 * exact, "{power} {exact}");
    }

    #[test]
    fn a_load_with_a_kink_is_refined_to_its_tolerance() {
        // ∫|x − 1| over the trapezium (0,0) (2,0) (1.5,1) (0,1): left of x = 1 ½; right of it ∫₀¹ ½(1 − y/2)² dy = 7/24.
        let scene = scene(Shape::Quad, Quantity::function(|site, _| (site.position.x - 1.0).abs()));
        let space = FunctionSpace::broken(&scene.mesh, &ALL[2]).expect("an element");
        let sum: f64 = load(&scene, &space).band(0).iter().sum();
        let exact = 0.5 + 7.0 / 24.0;
        assert!((sum - exact).abs() < 1e-4 * exact, "{sum} {exact}");
    }
}
