//! Links between clusters for the light that passes freely, rays for the rest.
//!
//! Most light in a room passes between parts of walls, floors and ceilings that see each other fully and are well
//! apart. There G is smooth and of low rank: the cells of each plane stand in a tree (`tree`), clusters that are proven
//! to see each other are linked (`links`), and G between them is interpolated from p × p points of each (`basis`), as in
//! the H² matrices of W. Hackbusch and S. Börm (Computing 69, 2002). p and what a link may err follow from the
//! tolerance; the functions of a cell enter through their moments alone, so that every basis and continuity is served.
//!
//! What links do not carry (near, weak and partly hidden pairs) is the rays' of the [`Sampled`](super::Sampled) operator. A ray that ends
//! on a cell that a link covers is not counted, and the others share what the links leave:
//!
//! ```text
//! e = D b + Σ_lamps f_l · mean_l(b) + (1 − D 1 − Σ f_l) ē + …
//! ```
//!
//! with D the links' part, so constants come back exactly as they do with rays alone. Since links are never made under
//! partial visibility, their number does not grow with shadows; what shadows cost are rays.

mod basis;
mod links;
mod tree;

use super::dense::{Between, Views};
use super::sampled::Cells;
use super::{Geometry, Params};
use crate::linalg::MultiVector;
use crate::progress::{Interrupted, Progress, Stage};
use crate::quadrature::rule;
use crate::visibility::Occluders;
use basis::{Basis, MOST};
use links::{Demands, Link, Search, probes};
use rayon::prelude::*;
use std::ops::Range;
use tree::{NOWHERE, Tree};

/// The largest planes meet each other: those that together have so much of the area.
const MOST_AREA: f64 = 0.9;
/// But so many at the least, for a room on a wide ground, and so many at the most. Of thousands of pieces of furniture hardly a pair
/// is clear and carries light that is worth a link, and all pairs have to be looked at.
const PLANES: [usize; 2] = [256, 2048];
/// Tolerances from which on so many points of an axis do.
const ORDERS: [(f64, usize); 2] = [(0.02, 3), (0.003, 4)];
/// Of the tolerance, what a link may err.
const LINK_SHARE: f64 = 0.5;
/// Of the tolerance, the share of the light below which a pair is left to the rays, and its bounds.
const WEAKEST: f64 = 0.25;
const WEAKEST_BOUNDS: [f64; 2] = [5e-4, 1e-2];

/// The kind of operator; [`Sampled::linked`](super::Sampled::linked) builds it.
#[derive(Debug)]
pub struct Hierarchical;

impl Hierarchical {
    /// The word that selects it.
    pub const NAME: &'static str = "hierarchical";
}

/// The links of a scene: D, a symmetric part of S.
#[derive(Debug)]
pub(super) struct Links {
    tree: Tree,
    basis: Basis,
    error: f64,
    all: Vec<Link>,
    /// For each cluster where its entries of `list` begin: twice a link, and 1 more for the second of its clusters.
    first: Vec<u32>,
    list: Vec<u32>,
    /// For each place, where the moments of its cell begin: ∫N_k L_a for each k and a.
    moment: Vec<u32>,
    moments: Vec<f32>,
    /// The leaf of each place, and for each leaf the places that its cells are linked with.
    leaf: Vec<u32>,
    covered_first: Vec<u32>,
    covered: Vec<[u32; 2]>,
}

impl Links {
    /// Between all cells that `take` accepts.
    pub(super) fn new(
        geometry: &Geometry<'_>,
        cells: &Cells,
        take: &dyn Fn(usize) -> bool,
        params: &Params,
        progress: &dyn Progress,
    ) -> Result<Self, Interrupted> {
        let tree = Tree::new(cells.len(), &|cell| cells.patch(cell), take);
        let order = ORDERS.iter().find(|(least, _)| params.tolerance >= *least).map_or(MOST, |&(_, p)| p);
        let basis = Basis::new(order);
        let [least, most] = WEAKEST_BOUNDS;
        let demands =
            Demands { error: LINK_SHARE * params.tolerance, weakest: (WEAKEST * params.tolerance).clamp(least, most) };
        let views = Views { occluders: &Occluders::new(geometry.surfaces), blockers: geometry.blockers };
        let search = Search { tree: &tree, basis: &basis, views, demands, probes: probes(&basis) };
        let links = all_links(&search, progress)?;
        let (first, list) = by_cluster(tree.clusters.len(), &links);
        let (leaf, covered_first, covered) = coverage(&tree, &links, &first, &list);
        let (moment, moments) = moments(&tree, &basis, cells);
        Ok(Self {
            tree,
            basis,
            error: demands.error,
            all: links,
            first,
            list,
            moment,
            moments,
            leaf,
            covered_first,
            covered,
        })
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.all.len()
    }

    /// The relative error that a link may have.
    pub(super) fn error(&self) -> f64 {
        self.error
    }

    pub(super) fn bytes(&self) -> usize {
        let kernels = self.all.len() * (size_of::<Link>() + 4 * self.basis.len() * self.basis.len());
        let numbers = [&self.first, &self.list, &self.moment, &self.leaf, &self.covered_first];
        let lists = numbers.iter().map(|list| size_of_val(&***list)).sum::<usize>();
        kernels + lists + size_of_val(&*self.moments) + size_of_val(&*self.covered) + self.tree.bytes()
    }

    /// What the cells of a leaf are linked with: [`Linked::contains`].
    pub(super) fn linked_with(&self, cell: usize) -> Linked<'_> {
        let place = self.tree.place[cell];
        if place == NOWHERE {
            return Linked { ranges: &[], place: &self.tree.place };
        }
        let leaf = self.leaf[place as usize] as usize;
        let range = self.covered_first[leaf] as usize..self.covered_first[leaf + 1] as usize;
        Linked { ranges: &self.covered[range], place: &self.tree.place }
    }

    /// D x.
    pub(super) fn apply(&self, cells: &Cells, x: &MultiVector) -> MultiVector {
        let bands = x.bands();
        let width = self.basis.len() * bands;
        let up = |plane: &Range<u32>| self.gather(cells, x, plane);
        let sent: Vec<f64> = self.tree.planes.par_iter().map(up).collect::<Vec<_>>().concat();
        let mut arrived = vec![0.0; sent.len()];
        arrived.par_chunks_mut(width.max(1)).enumerate().for_each(|(cluster, out)| self.cross(cluster, &sent, out));
        let down = |plane: &Range<u32>| {
            let field = arrived[plane.start as usize * width..plane.end as usize * width].to_vec();
            self.spread(cells, bands, plane, field)
        };
        let values: Vec<Vec<f64>> = self.tree.planes.par_iter().map(down).collect();
        let mut y = MultiVector::zeros(x.rows(), bands);
        let mut values = values.iter().flatten();
        for &cell in &self.tree.order {
            for row in cells.range(cell as usize) {
                for band in 0..bands {
                    y.band_mut(band)[row] = values.next().copied().unwrap_or(0.0);
                }
            }
        }
        y
    }

    /// The moments ∫L_a x of the clusters of a plane.
    fn gather(&self, cells: &Cells, x: &MultiVector, plane: &Range<u32>) -> Vec<f64> {
        let (n, bands) = (self.basis.len(), x.bands());
        let width = n * bands;
        let mut all = vec![0.0; plane.len() * width];
        for k in plane.clone().rev() {
            let cluster = &self.tree.clusters[k as usize];
            let (here, below) = all.split_at_mut((k - plane.start + 1) as usize * width);
            let here = &mut here[(k - plane.start) as usize * width..];
            if cluster.children.is_empty() {
                for place in cluster.range.clone() {
                    self.add_moments(cells, x, place, here);
                }
            }
            for child in cluster.children.clone() {
                let start = (child - k - 1) as usize * width;
                self.raise(k, child, &below[start..start + width], bands, here);
            }
        }
        all
    }

    fn add_moments(&self, cells: &Cells, x: &MultiVector, place: u32, out: &mut [f64]) {
        let (n, bands) = (self.basis.len(), x.bands());
        let rows = cells.range(self.tree.order[place as usize] as usize);
        let moments = self.moments[self.moment[place as usize] as usize..].chunks_exact(n);
        for (row, moments) in rows.zip(moments) {
            for (out, &moment) in out.chunks_exact_mut(bands).zip(moments) {
                for (band, out) in out.iter_mut().enumerate() {
                    *out += f64::from(moment) * x.band(band)[row];
                }
            }
        }
    }

    fn transfer(&self, parent: u32, child: u32) -> [[[f64; MOST]; MOST]; 2] {
        let [outer, inner] = [parent, child].map(|k| &self.tree.clusters[k as usize].rectangle);
        let size = [0, 1].map(|axis| inner.half[axis].length() / outer.half[axis].length());
        self.basis.transfer(outer.locate(inner.center), size)
    }

    /// Adds the moments of a child to those of its parent.
    fn raise(&self, parent: u32, child: u32, from: &[f64], bands: usize, to: &mut [f64]) {
        let matrices = self.transfer(parent, child);
        let transposed = matrices.map(|m| std::array::from_fn(|a| std::array::from_fn(|c| m[c][a])));
        self.carry(&transposed, from, bands, to);
    }

    /// Adds the values of a parent at the points of a child to those of the child.
    fn lower(&self, parent: u32, child: u32, from: &[f64], bands: usize, to: &mut [f64]) {
        self.carry(&self.transfer(parent, child), from, bands, to);
    }

    /// Adds the product of two matrices, one for each direction, with values at the points of a grid.
    fn carry(&self, [first, second]: &[[[f64; MOST]; MOST]; 2], from: &[f64], bands: usize, to: &mut [f64]) {
        let p = self.basis.p();
        let mut half = vec![0.0; p * p * bands];
        for b in 0..p {
            for (c, a) in (0..p).flat_map(|c| (0..p).map(move |a| (c, a))) {
                add(&mut half[(c * p + b) * bands..][..bands], first[c][a], &from[(a * p + b) * bands..]);
            }
        }
        for a in 0..p {
            for (c, b) in (0..p).flat_map(|c| (0..p).map(move |b| (c, b))) {
                add(&mut to[(a * p + c) * bands..][..bands], second[c][b], &half[(a * p + b) * bands..]);
            }
        }
    }

    /// What arrives at the points of a cluster through its own links.
    fn cross(&self, cluster: usize, sent: &[f64], out: &mut [f64]) {
        let n = self.basis.len();
        let (width, bands) = (out.len(), out.len() / n);
        for &entry in &self.list[self.first[cluster] as usize..self.first[cluster + 1] as usize] {
            let link = &self.all[(entry / 2) as usize];
            let second = entry % 2 == 1;
            let from = link.clusters[usize::from(!second)] as usize;
            let from = &sent[from * width..(from + 1) * width];
            for i in 0..n {
                for j in 0..n {
                    let g = link.kernel[if second { j * n + i } else { i * n + j }];
                    add(&mut out[i * bands..(i + 1) * bands], f64::from(g), &from[j * bands..]);
                }
            }
        }
    }

    /// ∫N_k E for the cells of a plane, in the order of their places, the bands side by side.
    fn spread(&self, cells: &Cells, bands: usize, plane: &Range<u32>, mut field: Vec<f64>) -> Vec<f64> {
        let n = self.basis.len();
        let width = n * bands;
        let root = &self.tree.clusters[plane.start as usize].range;
        let rows = |place: u32| cells.range(self.tree.order[place as usize] as usize).len();
        let mut start = vec![0];
        for place in root.clone() {
            start.push(start[start.len() - 1] + rows(place) * bands);
        }
        let mut values = vec![0.0; start[start.len() - 1]];
        for k in plane.clone() {
            let cluster = &self.tree.clusters[k as usize];
            let (here, below) = field.split_at_mut((k - plane.start + 1) as usize * width);
            let here = &here[(k - plane.start) as usize * width..];
            for child in cluster.children.clone() {
                let at = (child - k - 1) as usize * width;
                self.lower(k, child, here, bands, &mut below[at..at + width]);
            }
            if cluster.children.is_empty() {
                for place in cluster.range.clone() {
                    let moments = self.moments[self.moment[place as usize] as usize..].chunks_exact(n);
                    let index = (place - root.start) as usize;
                    let out = &mut values[start[index]..start[index + 1]];
                    for (out, moments) in out.chunks_exact_mut(bands).zip(moments) {
                        for (here, &moment) in here.chunks_exact(bands).zip(moments) {
                            add(out, f64::from(moment), here);
                        }
                    }
                }
            }
        }
        values
    }
}

/// The places that a cell's light comes from through links.
#[derive(Debug, Clone, Copy)]
pub(super) struct Linked<'a> {
    ranges: &'a [[u32; 2]],
    place: &'a [u32],
}

impl Linked<'_> {
    /// Where there are no links.
    pub(super) const NONE: Self = Linked { ranges: &[], place: &[] };

    pub(super) fn contains(&self, cell: usize) -> bool {
        if self.ranges.is_empty() {
            return false;
        }
        let place = self.place[cell];
        let next = self.ranges.partition_point(|&[start, _]| start <= place);
        next > 0 && place < self.ranges[next - 1][1]
    }
}

/// y += a x.
fn add(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// The links between each two planes, in their order.
fn all_links(search: &Search<'_>, progress: &dyn Progress) -> Result<Vec<Link>, Interrupted> {
    let clusters = &search.tree.clusters;
    let mut roots: Vec<u32> = search.tree.planes.iter().map(|plane| plane.start).collect();
    let area = |root: u32| clusters[root as usize].area;
    roots.sort_by(|&a, &b| area(b).total_cmp(&area(a)).then(a.cmp(&b)));
    let (all, mut larger) = (roots.iter().map(|&root| area(root)).sum::<f64>(), 0.0);
    let needed = roots.iter().take_while(|&&root| {
        let before = larger;
        larger += area(root);
        before < MOST_AREA * all
    });
    let [least, most] = PLANES;
    let needed = needed.count().clamp(least, most);
    roots.truncate(needed);
    let stage = Stage::begin(progress, "linking", roots.len() as u64);
    let of = |k: usize| {
        if progress.interrupted() {
            return Err(Interrupted);
        }
        let mut found = Vec::new();
        for &other in &roots[k + 1..] {
            search.meet([roots[k], other], Between::Many, &mut found);
        }
        progress.advance(1);
        Ok(found)
    };
    let found: Vec<Vec<Link>> = (0..roots.len()).into_par_iter().with_max_len(1).map(of).collect::<Result<_, _>>()?;
    drop(stage);
    Ok(found.into_iter().flatten().collect())
}

/// The links of each cluster.
fn by_cluster(clusters: usize, links: &[Link]) -> (Vec<u32>, Vec<u32>) {
    let ends = |k: usize| links[k].clusters.into_iter().zip([2 * k as u32, 2 * k as u32 + 1]);
    let mut entries: Vec<(u32, u32)> = (0..links.len()).flat_map(ends).collect();
    entries.sort_unstable();
    let mut first = vec![0; clusters + 1];
    for &(cluster, _) in &entries {
        first[cluster as usize + 1] += 1;
    }
    for k in 0..clusters {
        first[k + 1] += first[k];
    }
    (first, entries.into_iter().map(|(_, entry)| entry).collect())
}

/// The leaf of each place; for each leaf, the places linked with it or with what it is a part of, as ranges.
fn coverage(tree: &Tree, links: &[Link], first: &[u32], list: &[u32]) -> (Vec<u32>, Vec<u32>, Vec<[u32; 2]>) {
    let (mut leaf, mut leaves) = (vec![0; tree.order.len()], vec![0]);
    let mut covered: Vec<[u32; 2]> = Vec::new();
    let mut stack: Vec<(u32, Vec<[u32; 2]>)> = tree.planes.iter().map(|plane| (plane.start, Vec::new())).collect();
    while let Some((k, mut ranges)) = stack.pop() {
        for &entry in &list[first[k as usize] as usize..first[k as usize + 1] as usize] {
            let other = links[(entry / 2) as usize].clusters[usize::from(entry % 2 == 0)];
            let range = &tree.clusters[other as usize].range;
            ranges.push([range.start, range.end]);
        }
        let cluster = &tree.clusters[k as usize];
        if cluster.children.is_empty() {
            ranges.sort_unstable();
            leaf[cluster.range.start as usize..cluster.range.end as usize].fill(leaves.len() as u32 - 1);
            let start = covered.len();
            for range in ranges {
                match covered[start..].last_mut() {
                    Some([_, end]) if *end == range[0] => *end = range[1],
                    _ => covered.push(range),
                }
            }
            leaves.push(covered.len() as u32);
        } else {
            stack.extend(cluster.children.clone().map(|child| (child, ranges.clone())));
        }
    }
    (leaf, leaves, covered)
}

/// ∫N_k L_a over each cell, L_a being the functions of its leaf.
fn moments(tree: &Tree, basis: &Basis, cells: &Cells) -> (Vec<u32>, Vec<f32>) {
    let n = basis.len();
    let leaves = tree.clusters.par_iter().filter(|cluster| cluster.children.is_empty());
    let found: Vec<(u32, Vec<f32>)> = leaves
        .flat_map_iter(|cluster| {
            cluster.range.clone().map(|place| {
                let cell = tree.order[place as usize] as usize;
                let (patch, element) = (cells.patch(cell), cells.element(cell));
                let rule = rule(patch.shape(), 2 * (basis.p() - 1) + element.degree + 1);
                let mut moments = vec![0.0; element.dofs() * n];
                for (&at, weight) in rule.points.iter().zip(&rule.weights) {
                    let weight = weight * patch.shape().reference_area() * patch.jacobian(at);
                    let values = basis.values(cluster.rectangle.locate(patch.point(at)));
                    for (row, function) in moments.chunks_exact_mut(n).zip(element.values(at)) {
                        add(row, weight * function, &values[..n]);
                    }
                }
                (place, moments.into_iter().map(|x| x as f32).collect())
            })
        })
        .collect();
    let mut start = vec![0; tree.order.len()];
    let mut all = Vec::with_capacity(found.iter().map(|(_, moments)| moments.len()).sum());
    for (place, moments) in found {
        start[place as usize] = all.len() as u32;
        all.extend(moments);
    }
    (start, all)
}
