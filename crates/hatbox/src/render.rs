//! A view of the solution: camera rays to the cells, and the value where they land.
//!
//! A ray shows the nearest cell that faces the camera; backs are see-through, so that a closed room can be looked into
//! from outside. Where a material varies over the surface the radiosity is put together at the point, B = B⁰ + R E, and
//! the texture is crisp however coarse the elements are; elsewhere the expansion is shown, [limited].
//!
//! Functions on elements do not follow the edges of shadows. With [`RenderOptions::direct`] the light of lamps is made afresh
//! for every pixel and surface in it ([`Direct`]), exactly, and put in the place of what functions have of it: shadows are as
//! sharp as they are, and what elements are left with is reflected light, which is smooth.

use crate::bake::{limited, rgb};
use crate::element::MAX_DOFS;
use crate::linalg::MultiVector;
use crate::mesh::Mesh;
use crate::progress::{Interrupted, Progress, Stage};
use crate::radiosity::{Direct, Projected, Shown, Solution};
use crate::scene::Camera;
use crate::visibility::Bvh;
use glam::DVec3;
use rayon::prelude::*;

/// What a picture shows and how finely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderOptions {
    /// Where from; the scene's own camera if not given, or else [`fitting_camera`] with y up.
    pub camera: Option<Camera>,
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Rays along each side of a pixel: a pixel is the mean of this number squared.
    pub samples: usize,
    /// B or E.
    pub shown: Shown,
    /// Whether the light of lamps is made afresh for every pixel.
    pub direct: bool,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self { camera: None, width: 960, height: 720, samples: 4, shown: Shown::Radiosity, direct: false }
    }
}

/// A picture of physical values.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Rows from top to bottom: linear red, green and blue in lm/m² (lx, W/m²), and the fraction of the pixel that the
    /// scene covers, with which the colours are already multiplied.
    pub pixels: Vec<[f32; 4]>,
}

/// Renders a view. The result depends on nothing but the arguments.
///
/// # Errors
/// [`Interrupted`] if `progress` says so.
pub fn render(solution: &Solution, options: &RenderOptions, progress: &dyn Progress) -> Result<Image, Interrupted> {
    let &RenderOptions { width, height, samples, shown, .. } = options;
    let lit = options.direct.then(|| Lit::new(solution, progress)).transpose()?;
    // What is limited is no projection any more, and light could not be taken out of it.
    let limited = lit.is_none().then(|| limited(solution));
    let solution = limited.as_ref().unwrap_or(solution);
    let aspect = width as f64 / height.max(1) as f64;
    let camera = options.camera.or(solution.scene.camera);
    let camera = camera.unwrap_or_else(|| fitting_camera(&solution.scene.mesh, DVec3::Y, aspect));
    let view = View { solution, shown, lit, frame: Frame::new(&camera), cells: cells(&solution.scene.mesh) };
    let stage = Stage::begin(progress, "render", height as u64);
    let mut pixels = vec![[0.0; 4]; width * height];
    let rows = pixels.par_chunks_mut(width.max(1)).enumerate();
    let rows = rows.try_for_each(|(y, row)| {
        if progress.interrupted() {
            return Err(Interrupted);
        }
        for (x, pixel) in row.iter_mut().enumerate() {
            *pixel = view.pixel([x, y], [width, height], samples.max(1));
        }
        progress.advance(1);
        Ok(())
    });
    drop(stage);
    rows.map(|()| Image { width, height, pixels })
}

/// A camera that sees the whole mesh, from the diagonal and a little above; it looks into a closed room through the
/// walls that face away from it. `aspect` is width / height.
pub fn fitting_camera(mesh: &Mesh, up: DVec3, aspect: f64) -> Camera {
    let fov_y = 40_f64.to_radians();
    let (low, high) = mesh.bounds();
    let (low, high) = if low.cmple(high).all() { (low, high) } else { (DVec3::ZERO, DVec3::ZERO) };
    let (center, up) = (0.5 * (low + high), up.normalize_or(DVec3::Y));
    // A room is mostly looked at along its depth: less from the side, and less still from above.
    let level = |v: DVec3| (v - v.dot(up) * up).normalize_or_zero();
    let depth = if up.z.abs() > 0.9 { -DVec3::Y } else { DVec3::Z };
    let back = (level(depth) + 0.5 * level(DVec3::X) + 0.35 * up).normalize_or(DVec3::Z);
    let frame = Frame::new(&Camera { eye: center + back, target: center, up, fov_y });
    let corner = |k: usize| DVec3::from_array([0, 1, 2].map(|a| if k >> a & 1 == 0 { low[a] } else { high[a] }));
    let distance = |p: DVec3| {
        let p = p - center;
        let across = (p.dot(frame.right).abs() / aspect).max(p.dot(frame.up).abs());
        across / (0.5 * fov_y).tan() - p.dot(frame.forward)
    };
    let distance = (0..8).map(|k| distance(corner(k))).fold(0.0, f64::max);
    let distance = if distance > 0.0 { 1.05 * distance } else { 1.0 };
    Camera { eye: center + distance * back, target: center, up, fov_y }
}

/// A camera's directions; `right` and `up` are as long as half the picture is high at distance 1.
struct Frame {
    eye: DVec3,
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    /// Half the height of the picture at distance 1.
    half: f64,
}

impl Frame {
    fn new(camera: &Camera) -> Self {
        let forward = (camera.target - camera.eye).normalize_or(-DVec3::Z);
        let right = forward.cross(camera.up).normalize_or(forward.any_orthonormal_vector());
        let half = (0.5 * camera.fov_y).tan();
        Self { eye: camera.eye, forward, right, up: right.cross(forward), half }
    }

    /// The direction to a point of the picture plane: x to the right from −aspect to aspect, y up from −1 to 1.
    fn direction(&self, x: f64, y: f64) -> DVec3 {
        self.forward + self.half * (x * self.right + y * self.up)
    }
}

/// Everything that a pixel needs.
struct View<'a> {
    solution: &'a Solution,
    shown: Shown,
    lit: Option<Lit<'a>>,
    frame: Frame,
    cells: Bvh,
}

impl View<'_> {
    fn pixel(&self, [x, y]: [usize; 2], [width, height]: [usize; 2], samples: usize) -> [f32; 4] {
        let step = 1.0 / samples as f64;
        let (mut sum, mut lights) = ([0.0; 4], Lights::new());
        for k in 0..samples * samples {
            let (dx, dy) = ((k % samples) as f64 + 0.5, (k / samples) as f64 + 0.5);
            let (px, py) = (x as f64 + dx * step, y as f64 + dy * step);
            let half_height = 0.5 * height as f64;
            let direction = self.frame.direction((px - 0.5 * width as f64) / half_height, 1.0 - py / half_height);
            if let Some([r, g, b]) = self.color(direction, &mut lights) {
                sum = [sum[0] + r, sum[1] + g, sum[2] + b, sum[3] + 1.0];
            }
        }
        sum.map(|total| (total * step * step) as f32)
    }

    /// What is seen in a direction.
    fn color(&self, direction: DVec3, lights: &mut Lights) -> Option<[f64; 3]> {
        let hit = self.cells.closest_hit(self.frame.eye, direction, f64::INFINITY, |_, front| front)?;
        let cell = hit.id as usize;
        let at = self.solution.scene.mesh.patch(cell).locate(self.frame.eye + hit.t * direction);
        let bands = 0..self.solution.bands();
        let values: Vec<f64> = match &self.lit {
            Some(lit) => lit.values(self.shown, cell, at, lights),
            None => bands.map(|band| value(self.solution, self.shown, cell, at, band)).collect(),
        };
        Some(rgb(&values))
    }
}

/// The light of lamps on the surfaces in a pixel, per band.
type Lights = Vec<(u32, Vec<f64>)>;

/// A solution whose lamps send their light anew.
struct Lit<'a> {
    solution: &'a Solution,
    direct: Direct<'a>,
    /// The rest of the irradiance, joined where the solution is.
    reflected: MultiVector,
}

impl<'a> Lit<'a> {
    fn new(solution: &'a Solution, progress: &dyn Progress) -> Result<Self, Interrupted> {
        let (direct, space) = (Direct::new(solution), &solution.space);
        let stage = Stage::begin(progress, "direct light", space.cells() as u64);
        let project = |cell: usize| {
            progress.advance(1);
            if progress.interrupted() { Err(Interrupted) } else { Ok(direct.projected(cell)) }
        };
        let projected: Vec<Projected> = (0..space.cells()).into_par_iter().map(project).collect::<Result<_, _>>()?;
        drop(stage);
        let mut reflected = solution.irradiance.clone();
        for (cell, projected) in projected.iter().enumerate() {
            for band in 0..solution.bands() {
                let rest = reflected.band_mut(band)[space.range(cell)].iter_mut();
                rest.zip(projected.band(band, space.element(cell))).for_each(|(rest, light)| *rest -= light);
            }
        }
        Ok(Self { solution, direct, reflected: joined(solution, &reflected) })
    }

    /// E or B⁰ + R E at a point of a cell, in each band, with the light of lamps as it falls in the pixel.
    fn values(&self, shown: Shown, cell: usize, at: [f64; 2], lights: &mut Lights) -> Vec<f64> {
        let Self { solution, direct, reflected } = self;
        let (scene, space) = (&solution.scene, &solution.space);
        let surface = scene.mesh.cells[cell].surface;
        let known = lights.iter().position(|(of, _)| *of == surface);
        let known = known.unwrap_or_else(|| {
            lights.push((surface, direct.light(cell, at, 0)));
            lights.len() - 1
        });
        let functions: [f64; MAX_DOFS] = space.element(cell).values(at);
        let (material, site) = (scene.material(cell), scene.site(cell, at));
        let value = |(band, light): (usize, &f64)| {
            let coefficients = reflected.band(band)[space.range(cell)].iter();
            let rest: f64 = coefficients.zip(functions).map(|(c, n)| c * n).sum();
            let irradiance = (rest + light).max(0.0);
            match shown {
                Shown::Irradiance => irradiance,
                Shown::Radiosity => material.leaving(&site, band, irradiance),
            }
        };
        lights[known].1.iter().enumerate().map(value).collect()
    }
}

/// A broken function with the values at joined nodes replaced by their means, each weighted by the area of its cell.
fn joined(solution: &Solution, broken: &MultiVector) -> MultiVector {
    let (mesh, space) = (&solution.scene.mesh, &solution.space);
    let Some(continuity) = space.continuity() else { return broken.clone() };
    let mut joined = broken.clone();
    for band in 0..broken.bands() {
        let sums = space.sums(continuity, broken.band(band), |cell, _| mesh.patch(cell).area());
        let mean = |[sum, area]: [f64; 2]| if area > 0.0 { sum / area } else { 0.0 };
        for (dof, value) in joined.band_mut(band).iter_mut().enumerate() {
            *value = continuity.row(dof).map(|(unknown, share)| share * mean(sums[unknown])).sum();
        }
    }
    joined
}

/// The value at a point of a cell, with the material's detail where it varies over the cell.
fn value(solution: &Solution, shown: Shown, cell: usize, at: [f64; 2], band: usize) -> f64 {
    let material = solution.scene.material(cell);
    let uniform = [&material.reflectance, &material.exitance].iter().all(|q| q.uniform(band).is_some());
    if shown == Shown::Irradiance || uniform {
        return solution.evaluate(shown, cell, at, band);
    }
    let site = solution.scene.site(cell, at);
    let irradiance = solution.evaluate(Shown::Irradiance, cell, at, band);
    material.leaving(&site, band, irradiance)
}

/// The cells as triangles to hit.
fn cells(mesh: &Mesh) -> Bvh {
    let (mut triangles, mut ids) = (Vec::new(), Vec::new());
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        for &corners in patch.triangles() {
            triangles.push(corners.map(|k| patch.corners()[k]));
            ids.push(cell as u32);
        }
    }
    Bvh::new(&triangles, &ids)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fitting_camera_sees_every_corner_and_no_more_than_needed() {
        let mut mesh = Mesh::default();
        mesh.vertices.extend([DVec3::new(-1.0, 0.0, -4.0), DVec3::new(3.0, 2.0, 1.0)]);
        for (up, aspect) in [(DVec3::Y, 1.5), (DVec3::Z, 0.5), (-DVec3::Y, 1.0)] {
            let camera = fitting_camera(&mesh, up, aspect);
            let frame = Frame::new(&camera);
            let (low, high) = mesh.bounds();
            let reach = (0..8).map(|k| {
                let p = DVec3::from_array([0, 1, 2].map(|a| if k >> a & 1 == 0 { low[a] } else { high[a] }));
                let p = p - frame.eye;
                let scale = p.dot(frame.forward) * frame.half;
                (p.dot(frame.right).abs() / aspect).max(p.dot(frame.up).abs()) / scale
            });
            let reach = reach.fold(0.0, f64::max);
            assert!(reach < 1.0 && reach > 0.8, "up {up}: the box reaches {reach} of the frame");
        }
    }
}
