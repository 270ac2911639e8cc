"""View factors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

from . import _native
from ._arrays import count, quads, subdivision
from ._arrays import tolerance as checked_tolerance
from ._progress import bar
from ._scene import Names, Scene, _labels


def view_factors(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    groups: npt.ArrayLike | Names | None = None,
    *,
    tolerance: float = 0.01,
    two_sided: bool = False,
    elements: int | None = None,
    max_edge: float | None = None,
    closure: str = "none",
    threshold: float = 0.0,
    memory: int | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: bool = False,
) -> sparse.csr_array:
    """View factors between faces, or between groups of faces: which fraction of what leaves one reaches the other.

    Args:
        vertices: Positions in metres, shape (V, 3).
        faces: Indices of vertices, shape (F, 3) or (F, 4), counter-clockwise when seen from the side that sends and
            receives; a triangle among quads repeats its last index. All of them block both ways.
        groups: The group of each face, shape (F,): indices, or names, which are numbered in the order in which they
            come. Every face is its own group if not given.
        tolerance: Relative error that the sum of a row may have, between 0 and 1.
        two_sided: Whether both sides of faces send and receive. A face is one row then, for both its sides.
        elements: Subdivide to about so many elements; the factors are still between faces or groups.
        max_edge: Subdivide until no edge is longer, in metres.
        closure: A name of `hatbox.CLOSURES`: how row sums are made right; by default not at all.
        threshold: Pairs of which neither factor reaches this are left out, and the others make up for it.
        memory: The most bytes that the work may take; what needs more is refused before it begins.
        seed: Seed of everything that is sampled.
        threads: Number of threads; as many as there are processors if not given. The result does not depend on it.
        progress: Whether a bar is drawn.

    Returns:
        F as a `scipy.sparse.csr_array` of the shape (F, F), or (G, G) for G groups. Reciprocity A_i F_ij = A_j F_ji
        holds to rounding; row sums are not forced to 1 without a closure, so that in a closed scene they measure the
        accuracy. What has no area has an empty row.

    Raises:
        HatboxError: As `Scene` does; too many elements, no such closure, a threshold that is no fraction.
        KeyboardInterrupt: Ctrl-C.
    """
    corners = quads(faces)
    label = np.arange(len(corners)) if groups is None else groups
    group, names = _labels("groups", label, len(corners))
    scene = Scene(vertices, corners, groups=group, two_sided=two_sided)
    elements, max_edge = subdivision(elements, max_edge)
    tolerance, threads = checked_tolerance(tolerance), count("threads", threads)
    # Where a face is one cell, the cells are the faces, and need not be added up.
    whole = elements is None and max_edge is None and np.array_equal(scene.group, np.arange(len(names)))
    with bar(progress) as reporter:
        starts, columns, values, _, found = _native.view_factors(
            scene._native,
            not whole,
            elements,
            max_edge,
            tolerance,
            closure,
            threshold,
            count("memory", memory),
            seed,
            threads,
            reporter,
        )
    factors = sparse.csr_array((values, columns, starts), shape=(len(found), len(found)))
    if len(found) == len(names):
        return factors
    number = {name: index for index, name in enumerate(names)}
    return _placed(factors, [number[name] for name in found], len(names))


def _placed(factors: sparse.csr_array, places: list[int], size: int) -> sparse.csr_array:
    """The factors of those groups that have any area, among all."""
    entries = factors.tocoo()
    place = np.array(places)
    return sparse.csr_array((entries.data, (place[entries.row], place[entries.col])), shape=(size, size))
