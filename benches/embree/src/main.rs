//! Rays per second of Hatbox's tree beside those of Embree 4, in one process and by turns: `benches/embree/run`.

use embree::{Embree, Ray, Ray16, Scene};
use glam::DVec3;
use hatbox::visibility::{Bvh, InstructionSet, Visibility};
use scenes::{Pair, Triangles};
use std::error::Error;
use std::hint::black_box;
use std::sync::Barrier;
use std::time::Instant;

mod embree;
mod scenes;

const ROUNDS: usize = 9;
/// Segments and pairs of a chunk.
const SEGMENTS: usize = 1024;
const PAIRS: usize = 128;
const NOTHING: [u32; 2] = [u32::MAX; 2];

/// Seconds and hits.
type Score = (f64, usize);
/// Runs chunk k of its work and counts hits.
type Contestant<'a> = &'a mut dyn FnMut(usize) -> usize;

/// The sum over all chunks of the time that each took in its best round. Chunks take a millisecond or two, so that on a
/// busy machine most are undisturbed in some round.
fn contest<const N: usize>(chunks: usize, barrier: &Barrier, contestants: [Contestant; N]) -> [Score; N] {
    let mut contestants = contestants;
    let mut best = vec![[(f64::INFINITY, 0); N]; chunks];
    for _ in 0..ROUNDS {
        for (which, contestant) in contestants.iter_mut().enumerate() {
            barrier.wait();
            for (chunk, best) in best.iter_mut().enumerate() {
                let start = Instant::now();
                best[which].1 = black_box(contestant(chunk));
                best[which].0 = best[which].0.min(start.elapsed().as_secs_f64());
            }
        }
    }
    std::array::from_fn(|which| best.iter().fold((0.0, 0), |sum, best| (sum.0 + best[which].0, sum.1 + best[which].1)))
}

/// Gives each thread its share of the items and adds up the scores: the time is that of the slowest.
fn on_threads<T: Sync, const N: usize>(
    threads: usize,
    items: &[T],
    work: impl Fn(&[T], &Barrier) -> [Score; N] + Sync,
) -> [Score; N] {
    let barrier = Barrier::new(threads);
    let share = items.len() / threads;
    std::thread::scope(|scope| {
        let parts = items.chunks_exact(share).map(|part| scope.spawn(|| work(part, &barrier)));
        let parts = parts.collect::<Vec<_>>().into_iter().filter_map(|part| part.join().ok());
        parts.fold([(0.0_f64, 0); N], |sum, part| {
            std::array::from_fn(|k| (sum[k].0.max(part[k].0), sum[k].1 + part[k].1))
        })
    })
}

/// The items of a chunk.
fn part<T>(items: &[T], size: usize, chunk: usize) -> &[T] {
    &items[chunk * size..(chunk + 1) * size]
}

fn part_mut<T>(items: &mut [T], size: usize, chunk: usize) -> &mut [T] {
    &mut items[chunk * size..(chunk + 1) * size]
}

fn mask_of(tree: &Bvh, pair: &Pair) -> usize {
    tree.occluded_packet(&pair.from, &pair.to, pair.ids).count_ones() as usize
}

fn any(tree: &Bvh, [from, to]: [DVec3; 2]) -> bool {
    tree.occluded(from, to, NOTHING)
}

fn closest(tree: &Bvh, [from, to]: [DVec3; 2]) -> bool {
    tree.closest_hit(from, to - from, f64::INFINITY, |_, _| true).is_some()
}

fn rays(segments: &[[DVec3; 2]]) -> Vec<Ray> {
    segments.iter().map(|&ends| Ray::new(ends)).collect()
}

/// One scene in all forms.
struct Ring {
    name: &'static str,
    tree: Bvh,
    /// Of the corners before they were rounded to single precision.
    wide: Bvh,
    /// Robust, then as it is by default.
    scenes: [Scene; 2],
    segments: Vec<[DVec3; 2]>,
    pairs: Vec<Pair>,
}

impl Ring {
    /// Prints a line: ours, Embree's in two ways, the ratios, and the share of rays that hit, by ours and by Embree.
    fn line(&self, kind: &str, threads: usize, count: usize, results: &[(f64, usize)]) {
        let rate = |k: usize| count as f64 / results[k].0 / 1e6;
        let share = |k: usize| 100.0 * results[k].1 as f64 / count as f64;
        println!(
            "{:<12} {kind:<14} {threads} {:8.2} {:8.2} {:6.2} {:8.2} {:6.2}   {:5.1} % {:5.1} %",
            self.name,
            rate(0),
            rate(1),
            rate(0) / rate(1),
            rate(2),
            rate(0) / rate(2),
            share(0),
            share(1)
        );
    }

    fn single(&self, threads: usize) {
        let (tree, wide, [robust, plain]) = (&self.tree, &self.wide, &self.scenes);
        let any = on_threads(threads, &self.segments, |all, barrier| {
            let (mut a, mut b) = (rays(all), rays(all));
            contest(
                all.len() / SEGMENTS,
                barrier,
                [
                    &mut |k| part(all, SEGMENTS, k).iter().filter(|&&ends| any(tree, ends)).count(),
                    &mut |k| {
                        part_mut(&mut a, SEGMENTS, k).iter_mut().map(|ray| usize::from(robust.occluded(ray))).sum()
                    },
                    &mut |k| part_mut(&mut b, SEGMENTS, k).iter_mut().map(|ray| usize::from(plain.occluded(ray))).sum(),
                ],
            )
        });
        self.line("any", threads, self.segments.len(), &any);
        let closest = on_threads(threads, &self.segments, |all, barrier| {
            let (mut a, mut b) = (rays(all), rays(all));
            contest(
                all.len() / SEGMENTS,
                barrier,
                [
                    &mut |k| part(all, SEGMENTS, k).iter().filter(|&&ends| closest(tree, ends)).count(),
                    &mut |k| {
                        part_mut(&mut a, SEGMENTS, k).iter_mut().map(|ray| usize::from(robust.intersect(ray))).sum()
                    },
                    &mut |k| {
                        part_mut(&mut b, SEGMENTS, k).iter_mut().map(|ray| usize::from(plain.intersect(ray))).sum()
                    },
                    &mut |k| part(all, SEGMENTS, k).iter().filter(|&&ends| closest(wide, ends)).count(),
                ],
            )
        });
        let [ours, embree @ .., of_wide] = closest;
        self.line("closest", threads, self.segments.len(), &[&[ours], &embree[..]].concat());
        self.line("closest in f64", threads, self.segments.len(), &[&[of_wide], &embree[..]].concat());
    }

    /// Batches of sixteen; Embree's with the flag for coherent rays and without, whichever is faster.
    fn batches(&self, threads: usize) {
        let (tree, [robust, plain]) = (&self.tree, &self.scenes);
        let results = on_threads(threads, &self.pairs, |all, barrier| {
            let mut rays = all.iter().map(|pair| Ray16::new(&pair.from, &pair.to)).collect::<Vec<_>>();
            let mut two = rays.clone();
            let count = |rays: &mut [Ray16], scene: &Scene, coherent: bool| {
                rays.iter_mut().map(|rays| scene.occluded16(rays, coherent) as usize).sum()
            };
            let (mut three, mut four) = (rays.clone(), rays.clone());
            contest(
                all.len() / PAIRS,
                barrier,
                [
                    &mut |k| part(all, PAIRS, k).iter().map(|pair| mask_of(tree, pair)).sum(),
                    &mut |k| count(part_mut(&mut rays, PAIRS, k), robust, false),
                    &mut |k| count(part_mut(&mut two, PAIRS, k), robust, true),
                    &mut |k| count(part_mut(&mut three, PAIRS, k), plain, false),
                    &mut |k| count(part_mut(&mut four, PAIRS, k), plain, true),
                ],
            )
        });
        let [ours, a, b, c, d] = results;
        let faster = |x: Score, y: Score| if x.0 < y.0 { x } else { y };
        self.line("pairs of 16", threads, 16 * self.pairs.len(), &[ours, faster(a, b), faster(c, d)]);
    }

    /// Ours for each instruction set.
    fn instruction_sets(&self) {
        print!("{:<12}", self.name);
        for set in InstructionSet::ALL {
            let tree = self.tree.clone().restricted_to(set);
            let [any, closest] = on_threads(1, &self.segments, |all, barrier| {
                contest(
                    all.len() / SEGMENTS,
                    barrier,
                    [&mut |k| part(all, SEGMENTS, k).iter().filter(|&&ends| any(&tree, ends)).count(), &mut |k| {
                        part(all, SEGMENTS, k).iter().filter(|&&ends| closest(&tree, ends)).count()
                    }],
                )
            });
            let [pairs] = on_threads(1, &self.pairs, |all, barrier| {
                contest(
                    all.len() / PAIRS,
                    barrier,
                    [&mut |k| part(all, PAIRS, k).iter().map(|pair| mask_of(&tree, pair)).sum()],
                )
            });
            let rates = [(any, self.segments.len()), (closest, self.segments.len()), (pairs, 16 * self.pairs.len())];
            let [any, closest, pairs] = rates.map(|(score, count)| count as f64 / score.0 / 1e6);
            print!("   {:?} {any:.2} {closest:.2} {pairs:.2}", tree.instruction_set());
        }
        println!();
    }
}

/// Prints the times of building on some threads.
fn build(path: &str, name: &str, triangles: &Triangles, threads: usize) -> Result<(), Box<dyn Error>> {
    let embree = Embree::load(path, threads)?;
    let ids: Vec<u32> = (0..triangles.len() as u32).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let mut best = [f64::INFINITY; 3];
    for _ in 0..if triangles.len() > 1_000_000 { 3 } else { ROUNDS } {
        for (k, best) in best.iter_mut().enumerate() {
            let scene = embree.scene(triangles, k == 1)?;
            let start = Instant::now();
            if k == 0 {
                black_box(pool.install(|| Bvh::new(triangles, &ids)));
            } else {
                embree.commit(&scene)?;
            }
            *best = best.min(start.elapsed().as_secs_f64() * 1e3);
            embree.release(&scene)?;
        }
    }
    let [ours, robust, plain] = best;
    println!(
        "{name:<12} build (ms)     {threads} {ours:8.2} {robust:8.2} {:6.2} {plain:8.2} {:6.2}",
        robust / ours,
        plain / ours
    );
    Ok(())
}

/// What single precision holds, as most files do, and Embree.
fn rounded(triangles: &Triangles) -> Triangles {
    triangles.iter().map(|triangle| triangle.map(|corner| corner.as_vec3().as_dvec3())).collect()
}

fn ring(path: &str, name: &'static str, triangles: &Triangles) -> Result<Ring, Box<dyn Error>> {
    let embree = Embree::load(path, 2)?;
    let ids: Vec<u32> = (0..triangles.len() as u32).collect();
    let wide = Bvh::new(triangles, &ids);
    let triangles = &rounded(triangles);
    let tree = Bvh::new(triangles, &ids);
    let scenes = [embree.scene(triangles, true)?, embree.scene(triangles, false)?];
    for scene in &scenes {
        embree.commit(scene)?;
    }
    let segments = scenes::segments(1 << 17);
    let pairs = scenes::pairs(triangles, 1 << 14, name.starts_with("soup"));
    Ok(Ring { name, tree, wide, scenes, segments, pairs })
}

type Make = fn() -> Triangles;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: embree-bench LIBEMBREE [--quick] [SCENE…]")?;
    let (flags, names): (Vec<_>, Vec<_>) = arguments.partition(|argument| argument.starts_with("--"));
    let quick = flags.iter().any(|flag| flag == "--quick");
    println!("                               M rays/s  robust         default          share of hits");
    println!("scene        kind      threads     ours   Embree  ratio   Embree  ratio   ours  Embree");
    let all: [(&'static str, Make); 5] = [
        ("box", scenes::cornell),
        ("spheres", || scenes::spheres(10)),
        ("soup", || scenes::soup(72_000, 0.03)),
        ("spheres-1.5M", || scenes::spheres(46)),
        ("soup-1.5M", || scenes::soup(1_500_000, 0.01)),
    ];
    let wanted = |name: &str| names.is_empty() || names.iter().any(|wanted| wanted == name);
    let counts = if quick { 1..2 } else { 1..3 };
    // Embree's devices share their threads, as many as the greatest has: so what is on one thread comes first.
    for threads in counts.clone() {
        for (name, make) in all.iter().filter(|(name, _)| wanted(name)) {
            build(&path, name, &rounded(&make()), threads)?;
        }
    }
    for (name, make) in all.into_iter().filter(|(name, _)| wanted(name)) {
        let triangles = make();
        let ring = ring(&path, name, &triangles)?;
        for threads in counts.clone() {
            ring.single(threads);
            ring.batches(threads);
        }
        if !quick {
            ring.instruction_sets();
        }
    }
    Ok(())
}
