"""Light scattered once on a terrain of craters: Hatbox beside the midpoint matrices of planetary thermal models.

*python-flux* cannot be had from PyPI. What stands here is **its published form, written anew, not the package**:
S. F. Potter, S. Bertone, N. Schörghofer, E. Mazarico, "Fast hierarchical low-rank view factor matrices for thermal
irradiance on planetary surfaces", J. Comput. Phys. 2023. With p the centroids, n the normals and A the areas of facets

    F_ij = V_ij max(0, n_i·(p_j − p_i)) max(0, n_j·(p_i − p_j)) A_j / (π |p_i − p_j|⁴),

where V_ij is one ray, here Embree's. The *full* form is a sparse matrix. The *compressed* one has a quadtree over x and
y; the block of two nodes is nothing, sparse, two thin factors, or divided, whatever takes the fewest bytes.

The rest was chosen here, in doubt for the peer: numbers of 4 bytes; one ray for both directions of a pair and one
compression for both of its blocks, which count as two; no ray where facets do not face each other; rays lifted by a
thousandth of an edge; nodes of 256 facets at the most; ‖B − UV‖ ≤ ε ‖B‖ in the Frobenius norm. BLAS has one
thread, since small products and factorisations take longer on several.

All get the same facets, a constant on each, and the same sunlight B. E = F B is known from cosine rays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.stats import qmc

import hatbox

from .measure import Row, relative_l2, timed

# The terrain of `examples/generate`: metres along a side, and craters on it; towards a sun 19° above the horizon.
SIDE, CRATERS = 200.0, 60
SUN = np.array([-430.0, 0.0, 150.0]) / math.hypot(430.0, 150.0)
# Facets whose irradiance is known and pairs whose view factor is known, with rays of each.
FACETS, FACET_RAYS, PAIRS, PAIR_RAYS = 800, 1 << 14, 100, 1 << 17
# Most facets of a node that is not divided; entries of a matrix that are looked at together.
LEAF, AT_ONCE = 256, 1 << 21
EDGES, MEMORY = "shared edges", "MB"

# Rows, columns, and one sparse matrix or two thin ones that are multiplied; the product with F, and its bytes.
Piece = tuple[slice, slice, list[Any]]
Built = tuple[Callable[[np.ndarray], np.ndarray], Callable[[], int]]


class Facets(NamedTuple):
    """What the midpoint form knows of facets; rays start and end at `lifted`."""

    center: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    lifted: np.ndarray

    @classmethod
    def of(cls, corners: np.ndarray) -> Facets:
        """Those of triangles, shape (n, 3, 3)."""
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length, center = np.linalg.norm(cross, axis=1), corners.mean(axis=1)
        normal, lift = cross / length[:, None], 1e-3 * math.sqrt(length.mean())
        return cls(center, normal, length / 2, (center + lift * normal).astype(np.float32))

    def some(self, chosen: Any) -> Facets:
        """A part of them."""
        return Facets(*(array[chosen] for array in self))


class Node(NamedTuple):
    """A node of the quadtree: facets that follow each other in its order."""

    span: slice
    children: list[Node]


class Job:
    """A terrain of so many squares along a side, two facets each, the sunlight on it, and the truth of some facets."""

    def __init__(self, per_side: int) -> None:
        self.vertices, self.faces = ground(per_side)
        self.corners, random = self.vertices[self.faces], np.random.default_rng(7)
        facets, embree = Facets.of(self.corners), _embree(self.corners)
        free = _free(embree, facets.lifted, facets.lifted + 2 * SIDE * SUN)
        self.sunlight = np.maximum(facets.normal @ SUN, 0.0) * free
        self.chosen, pairs = random.choice(len(self.faces), FACETS, replace=False), _neighbours(self.faces, facets)
        self.pairs = pairs[:, random.choice(pairs.shape[1], PAIRS, replace=False)]
        hits = (_cosine_hits(embree, self.corners[i], FACET_RAYS, random) for i in self.chosen)
        self.irradiance = np.array([np.append(self.sunlight, 0.0)[hit].mean() for hit in hits])
        counts = ((_cosine_hits(embree, self.corners[i], PAIR_RAYS, random) == j).mean() for i, j in self.pairs.T)
        self.factors = np.array(list(counts))

    def errors(self, built: Built) -> dict[str, float]:
        """Of E in L2, and relative where it is a tenth of its root mean square or more; of F of neighbours in L2."""
        (times, size), truth = built, self.irradiance
        found, lit = times(self.sunlight)[self.chosen], truth > 0.1 * np.sqrt((truth**2).mean())
        relative, units = np.abs(found[lit] / truth[lit] - 1), np.zeros((len(self.faces), PAIRS))
        units[self.pairs[1], range(PAIRS)] = 1.0
        edges = relative_l2(times(units)[self.pairs[0], range(PAIRS)], self.factors)
        median, most = map(float, np.percentile(relative, [50, 95]))
        return {"L2": relative_l2(found, truth), "median": median, "95 %": most, EDGES: edges, MEMORY: size() / 1e6}


def measure(quick: bool, absent: dict[str, str]) -> Iterator[Row]:
    """Every form of F on terrains of 2450, 10 082 and 39 762 facets, the last for some ten minutes."""
    try:
        for per_side in (35,) if quick else (35, 71, 141):
            job = Job(per_side)
            for tool, series, setting, build in _tools(job, quick):
                built, seconds, cpu = timed(build)
                yield Row(f"terrain, {len(job.faces)} facets", tool, series, setting, seconds, cpu, job.errors(built))
    except ImportError as error:
        absent["embree"] = str(error)


def _tools(job: Job, quick: bool) -> Iterator[tuple[str, str, str, Callable[[], Built]]]:
    yield "midpoint", "full", "", partial(_on_one_thread, full, job.corners)
    for epsilon in (1e-2,) if quick else (1e-1, 1e-2):
        yield "midpoint", "compressed", f"ε = {epsilon:g}", partial(_on_one_thread, compressed, job.corners, epsilon)
    yield "hatbox", "sampled, one thread", "0.02", partial(_hatbox, job, "sampled", 0.02, threads=1)
    for tolerance in (0.02, 0.005) if quick else (0.03, 0.02, 0.015, 0.01, 0.005, 0.0025):
        yield "hatbox", "sampled", f"{tolerance:g}", partial(_hatbox, job, "sampled", tolerance)
    if not quick:
        yield "hatbox", "auto", "0.02", partial(_hatbox, job, "auto", 0.02)


def _on_one_thread(build: Callable[..., Built], *arguments: Any) -> Built:
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return build(*arguments)


def _hatbox(job: Job, operator: str, tolerance: float, threads: int | None = None) -> Built:
    scene = hatbox.Scene(job.vertices, job.faces, exitance=0.0)
    options = {"continuity": "broken", "max_edge": math.inf, "tolerance": tolerance, "operator": operator}
    system = hatbox.System(scene, "constant", threads=threads, **options)  # type: ignore[arg-type]
    exchange, area = system.exchange, system.mass.diagonal()
    return lambda x: ((exchange @ x).T / area).T, lambda: system.solve(error_points=0).report["operator"]["bytes"]


def ground(per_side: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of bowls with raised rims, the large ones first."""
    x, y = np.meshgrid(*2 * [np.linspace(0.0, SIDE, per_side + 1)], indexing="ij")
    z = np.zeros_like(x)
    for k in range(CRATERS):
        radius = 30.0 / (1.0 + 0.3 * k)
        r = np.hypot(x - SIDE * _chance(11, k), y - SIDE * _chance(12, k)) / radius
        z += 0.45 * radius * (0.52 * np.exp(-8.0 * (r - 1.0) ** 2) - np.exp(-2.5 * r**4))
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.stack([x, y, z], axis=2).reshape(-1, 3), np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3)


def _chance(seed: int, index: int) -> float:
    """A number from 0 to 1 that follows from what is numbered, as in `examples/generate`."""
    z = ((seed << 32) + index + 1) * 0x9E3779B97F4A7C15
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1)):
        z %= 1 << 64
        z = (z ^ z >> shift) * factor
    return (z >> 11) / 2.0**53


def _neighbours(faces: np.ndarray, facets: Facets) -> np.ndarray:
    """Pairs of facets with a common edge that face each other."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    first = np.flatnonzero((edges[order][1:] == edges[order][:-1]).all(axis=1))
    i, j = pairs = np.stack([order[first], order[first + 1]]) // 3
    return pairs[:, np.einsum("nk,nk->n", facets.normal[i], facets.center[j] - facets.center[i]) > 1e-6]


def _embree(corners: np.ndarray) -> Any:
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, corners.astype(np.float32))
    return scene


def _free(embree: Any, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Whether nothing stands between two points."""
    direction = (end - start).astype(np.float32)
    return np.asarray(embree.run(start, direction, np.ones(len(start), np.float32), query="OCCLUDED") < 0)


def _cosine_hits(embree: Any, corners: np.ndarray, rays: int, random: np.random.Generator) -> np.ndarray:
    """What light that a triangle sends meets: indices of triangles, or −1."""
    u, v, s, t = qmc.Sobol(4, rng=random).random(rays).T
    weights = np.stack([1 - np.sqrt(u), np.sqrt(u) * (1 - v), np.sqrt(u) * v], axis=1)
    edge, normal = corners[1] - corners[0], Facets.of(corners[None]).normal[0]
    frame = np.stack([edge / np.linalg.norm(edge), np.cross(normal, edge / np.linalg.norm(edge)), normal])
    disc = [np.sqrt(s) * np.cos(2 * np.pi * t), np.sqrt(s) * np.sin(2 * np.pi * t), np.sqrt(1 - s)]
    starts = weights @ corners + 1e-4 * np.linalg.norm(edge) * normal
    return np.asarray(embree.run(starts.astype(np.float32), (np.stack(disc, axis=1) @ frame).astype(np.float32)))


def full(corners: np.ndarray) -> Built:
    """The midpoint form as a sparse matrix; what stands in it is F_ij / A_j."""
    embree, facets = _embree(corners), Facets.of(corners)
    upper = _kernel(embree, facets, facets, same=True)
    matrix = upper + upper.T.tocsr()
    return lambda x: matrix @ (facets.area * x.T).T, lambda: _bytes([(slice(0), slice(0), [matrix])])


def compressed(corners: np.ndarray, epsilon: float) -> Built:
    """The midpoint form as blocks of a quadtree, F_ij / A_j likewise."""
    embree, (root, order) = _embree(corners), _quadtree(corners.mean(axis=1))
    facets, pieces = Facets.of(corners).some(order), []
    for one, two in _blocks(root, root):
        block = _kernel(embree, facets.some(one.span), facets.some(two.span), same=one is two)
        for rows, columns, factors in _packed(block, one, two, epsilon):
            pieces += [(rows, columns, factors), (columns, rows, [factor.T for factor in factors[::-1]])]

    def times(x: np.ndarray) -> np.ndarray:
        sent, y = (facets.area * x[order].T).T, np.zeros(x.shape)
        for rows, columns, factors in pieces:
            y[rows] += factors[0] @ (factors[-1] @ sent[columns] if len(factors) > 1 else sent[columns])
        return y[np.argsort(order)]

    return times, lambda: _bytes(pieces)


def _kernel(embree: Any, one: Facets, two: Facets, *, same: bool) -> sparse.csr_array:
    """F_ij / A_j; above the diagonal only, if facets of both sides are the same."""
    step = max(1, AT_ONCE // len(two.area))
    starts = range(0, len(one.area), step)
    return sparse.vstack([_rows(embree, one.some(slice(k, k + step)), two, k if same else -1) for k in starts], "csr")


def _rows(embree: Any, one: Facets, two: Facets, place: int) -> sparse.csr_array:
    """Some rows of that; the first of them has this place, if facets of both sides are the same."""
    left = max(place, 0)
    rest, shape = two.some(slice(left, None)), (len(one.area), len(two.area))
    here = one.normal @ rest.center.T - np.einsum("nk,nk->n", one.normal, one.center)[:, None]
    there = one.center @ rest.normal.T - np.einsum("nk,nk->n", rest.normal, rest.center)
    faces = (here > 1e-9) & (there > 1e-9)
    i, j = np.nonzero(faces if place < 0 else np.triu(faces, 1))
    free = _free(embree, one.lifted[i], rest.lifted[j])
    i, j = i[free], j[free]
    apart = rest.center[j] - one.center[i]
    values = here[i, j] * there[i, j] / (np.pi * np.einsum("nk,nk->n", apart, apart) ** 2)
    ends = np.searchsorted(i, np.arange(shape[0] + 1)).astype(np.int32)
    return sparse.csr_array((values.astype(np.float32), (j + left).astype(np.int32), ends), shape=shape)


def _quadtree(center: np.ndarray) -> tuple[Node, np.ndarray]:
    """A quadtree, and the order of facets by it."""
    order: list[int] = []

    def node(facets: np.ndarray) -> Node:
        first, children, x = len(order), [], center[facets, :2]
        if len(facets) <= LEAF:
            order.extend(facets)
        else:
            quarter = (x > (x.min(axis=0) + x.max(axis=0)) / 2) @ [2, 1]
            children = [node(part) for k in range(4) if len(part := facets[quarter == k])]
        return Node(slice(first, len(order)), children)

    return node(np.arange(len(center))), np.array(order)


def _blocks(one: Node, two: Node) -> Iterator[tuple[Node, Node]]:
    """The children's blocks, of a block on the diagonal those above."""
    for a in one.children or [one]:
        yield from ((a, b) for b in two.children or [two] if one is not two or a.span.start <= b.span.start)


def _packed(block: sparse.csr_array, one: Node, two: Node, epsilon: float) -> list[Piece]:
    """The form of a block that takes the fewest bytes."""
    if block.nnz == 0:
        return []
    best: list[Piece] = [(one.span, two.span, [block])]
    if one.children or two.children:
        divided: list[Piece] = []
        for a, b in _blocks(one, two):
            divided += _packed(block[_within(a, one), _within(b, two)], a, b, epsilon)
        best = min(best, divided, key=_bytes)
    most = 0 if one is two else (_bytes(best) - 1) // (4 * sum(block.shape))
    factors = _thin(block, most, epsilon)
    return [(one.span, two.span, factors)] if factors else best


def _within(child: Node, parent: Node) -> slice:
    return slice(child.span.start - parent.span.start, child.span.stop - parent.span.start)


def _thin(block: sparse.csr_array, most: int, epsilon: float) -> list[np.ndarray]:
    """Factors of at most such a rank, or none, by random projections: Halko et al., SIAM Review 53 (2011)."""
    random, limit = np.random.default_rng(0), min(*block.shape, most + 8)
    goal = (1 - epsilon**2) * np.square(block.data, dtype=float).sum()
    for width in sorted({min(width, limit) for width in (16, 64, limit)}) if most else ():
        sample = random.standard_normal((block.shape[1], width), np.float32)
        basis = np.linalg.qr(block @ (block.T @ (block @ sample)))[0]
        u, s, v = np.linalg.svd((block.T @ basis).T, full_matrices=False)
        rank = int(np.searchsorted(np.cumsum(np.square(s, dtype=float)), goal)) + 1
        if rank <= width:
            return [basis @ (u[:, :rank] * s[:rank]), v[:rank].copy()] if rank <= most else []
    return []


def _bytes(pieces: list[Piece]) -> int:
    matrices = [matrix for _, _, factors in pieces for matrix in factors]
    parts = [[m.data, m.indices, m.indptr] if sparse.issparse(m) else [m] for m in matrices]
    return sum(array.nbytes for part in parts for array in part)
