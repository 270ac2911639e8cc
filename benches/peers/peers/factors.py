"""View factors: all of a closed enclosure, and single pairs with a blocker between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

import hatbox

from .exact import box_factors
from .measure import AbsentError, Row, relative_l2, timed
from .scenes import Quads, cube, l_room, occluded

Matrix = Callable[[Quads], np.ndarray]
# Name, setting, what it does, and up to how many faces.
Tool = tuple[str, str, Matrix, float]


def measure(quick: bool, absent: dict[str, str]) -> Iterator[Row]:
    """Every tool on every job; tools that are not here go into `absent`."""
    for tool, setting, matrix, most in _present(quick, absent):
        for per_side in (7,) if quick else (7, 13, 29):
            if len((job := cube(per_side)).faces) <= most:
                yield _enclosure(tool, setting, matrix, job)
        for per_side in (4,) if quick else (4, 9):
            if len((job := l_room(per_side)).faces) <= most:
                yield _enclosure(tool, setting, matrix, job)
        yield from _pairs(tool, setting, matrix)


def _present(quick: bool, absent: dict[str, str]) -> Iterator[Tool]:
    for tools in (_hatbox, _pyviewfactor, _raystrack):
        try:
            yield from tools(quick)
        except AbsentError as error:
            absent[tools.__name__.strip("_")] = str(error)


def _enclosure(tool: str, setting: str, matrix: Matrix, job: Quads) -> Row:
    """The error of all pairs that have a closed form, and of row sums, which count the others too."""
    truth = box_factors(job.vertices, job.faces)
    known = job.in_one_box()
    found, seconds, cpu = timed(lambda: matrix(job))
    sees = known & (truth > 0)
    relative = np.abs(found[sees] / truth[sees] - 1)
    errors = {
        "L2": relative_l2(found[known], truth[known]),
        "median": float(np.median(relative)),
        "95 %": float(np.percentile(relative, 95)),
        "worst row": float(np.abs(found.sum(axis=1) - 1).max()),
    }
    return Row(f"{job.name}, {len(job.faces)} faces", tool, "", setting, seconds, cpu, errors)


def _pairs(tool: str, setting: str, matrix: Matrix) -> Iterator[Row]:
    for pair in occluded():
        found, seconds, cpu = timed(lambda: matrix(pair))  # noqa: B023
        error = abs(found[0, 1] / pair.exact - 1)
        yield Row(f"two squares, {pair.name}", tool, "", setting, seconds, cpu, {"relative": float(error)})


def _hatbox(quick: bool) -> Iterator[Tool]:
    for tolerance in (1e-2,) if quick else (1e-2, 1e-3, 1e-4, 1e-5):

        def matrix(job: Quads, tolerance: float = tolerance) -> np.ndarray:
            return np.asarray(hatbox.view_factors(job.vertices, job.faces, tolerance=tolerance).toarray())

        yield "hatbox", f"tolerance {tolerance:g}", matrix, math.inf


def _pyviewfactor(_: bool) -> Iterator[Tool]:
    try:
        import pyviewfactor
        import pyvista
    except ImportError as error:
        raise AbsentError(str(error)) from error

    def matrix(job: Quads) -> np.ndarray:
        mesh = pyvista.PolyData.from_regular_faces(job.vertices, job.faces)
        # It looks for obstacles only among those that are named, and its F[i, j] is from j to i.
        return np.asarray(pyviewfactor.compute_viewfactor_matrix(mesh, None if job.convex else [mesh])).T

    # The first calls compile; that is not their work.
    matrix(cube(1))
    matrix(l_room(1))
    yield "pyviewfactor", "default", matrix, math.inf


def _raystrack(quick: bool) -> Iterator[Tool]:
    try:
        import raystrack
    except ImportError as error:
        raise AbsentError(str(error)) from error

    def matrix(job: Quads, rays: int = 16) -> np.ndarray:
        triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
        ids = [str(k) for k in range(len(job.faces))]
        meshes = (raystrack.Mesh(job.vertices[face].astype(np.float32), triangles) for face in job.faces)
        scene = raystrack.Scene(map(raystrack.Surface, ids, meshes))
        options = raystrack.SolveOptions(
            raystrack.Sampling(rays_per_cell=rays), raystrack.Accuracy(max_replicates=1, min_replicates=1)
        )
        with raystrack.Solver(scene, device="cpu") as solver:
            query = raystrack.Query.matrix(receiver_sides=("front",))
            result = solver.solve(query, options)
        hit = [k for k, channel in enumerate(result.channels) if channel.kind == "surface"]
        receivers = [int(result.channels[k].surface_id) for k in hit]
        values = np.zeros((len(ids), len(ids)))
        values[np.ix_([int(sender) for sender in result.sender_ids], receivers)] = result.dense()[:, hit]
        return values

    matrix(cube(1))
    for rays in (128,) if quick else (128, 1024):
        # A face has sixteen cells. It takes about 60 ms a face for whatever number of rays, so it gets the small jobs.
        yield "raystrack", f"{16 * rays} rays a face", partial(matrix, rays=rays), 300
