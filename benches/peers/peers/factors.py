"""View factors: all of a closed enclosure, and single pairs with a blocker between."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import hatbox

from .exact import box_factors
from .measure import AbsentError, Row, relative_l2, timed
from .scenes import Quads, cube, l_room, occluded

Matrix = Callable[[Quads], np.ndarray]
Tool = tuple[str, str, Matrix]


def measure(quick: bool, absent: dict[str, str]) -> Iterator[Row]:
    """Every tool on every job; tools that are not here go into `absent`."""
    for tool, setting, matrix in _present(quick, absent):
        yield from _cube(tool, setting, matrix, 7 if quick else 13)
        yield from _room(tool, setting, matrix, l_room(4 if quick else 9))
        yield from _pairs(tool, setting, matrix)


def _present(quick: bool, absent: dict[str, str]) -> Iterator[Tool]:
    for tools in (_hatbox, _pyviewfactor, _raystrack):
        try:
            yield from tools(quick)
        except AbsentError as error:
            absent[tools.__name__.strip("_")] = str(error)


def _cube(tool: str, setting: str, matrix: Matrix, per_side: int) -> Iterator[Row]:
    job = cube(per_side)
    truth = box_factors(job.vertices, job.faces)
    found, seconds, cpu = timed(lambda: matrix(job))
    sees = truth > 0
    relative = np.abs(found[sees] / truth[sees] - 1)
    errors = {
        "L2": relative_l2(found, truth),
        "median": float(np.median(relative)),
        "95 %": float(np.percentile(relative, 95)),
        "worst row": float(np.abs(found.sum(axis=1) - 1).max()),
    }
    yield Row(f"{job.name}, {len(job.faces)} faces", tool, "", setting, seconds, cpu, errors)


def _room(tool: str, setting: str, matrix: Matrix, job: Quads) -> Iterator[Row]:
    found, seconds, cpu = timed(lambda: matrix(job))
    deficit = np.abs(found.sum(axis=1) - 1)
    errors = {"mean row": float(deficit.mean()), "worst row": float(deficit.max())}
    yield Row(f"{job.name}, {len(job.faces)} faces", tool, "", setting, seconds, cpu, errors)


def _pairs(tool: str, setting: str, matrix: Matrix) -> Iterator[Row]:
    for pair in occluded():
        found, seconds, cpu = timed(lambda: matrix(pair))  # noqa: B023
        error = abs(found[0, 1] / pair.exact - 1)
        yield Row(f"two squares, {pair.name}", tool, "", setting, seconds, cpu, {"relative": float(error)})


def _hatbox(quick: bool) -> Iterator[Tool]:
    for tolerance in (1e-2,) if quick else (1e-2, 1e-3, 1e-4, 1e-5):

        def matrix(job: Quads, tolerance: float = tolerance) -> np.ndarray:
            return np.asarray(hatbox.view_factors(job.vertices, job.faces, tolerance=tolerance).toarray())

        yield "hatbox", f"tolerance {tolerance:g}", matrix


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
    yield "pyviewfactor", "default", matrix


def _raystrack(quick: bool) -> Iterator[Tool]:
    try:
        import raystrack
    except ImportError as error:
        raise AbsentError(str(error)) from error

    def matrix(job: Quads, rays: int = 1024) -> np.ndarray:
        triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
        ids = [str(k) for k in range(len(job.faces))]
        meshes = (raystrack.Mesh(job.vertices[face].astype(np.float32), triangles) for face in job.faces)
        scene = raystrack.Scene(map(raystrack.Surface, ids, meshes))
        options = raystrack.SolveOptions(accuracy=raystrack.Accuracy(max_replicates=1 << 20, tolerance=1e-12))
        with raystrack.Solver(scene, device="cpu") as solver:
            query = raystrack.Query.matrix(receiver_sides=("front",))
            result = solver.solve(query, options, raystrack.Budget(rays=rays * len(ids)))
        hit = [k for k, channel in enumerate(result.channels) if channel.kind == "surface"]
        receivers = [int(result.channels[k].surface_id) for k in hit]
        values = np.zeros((len(ids), len(ids)))
        values[np.ix_([int(sender) for sender in result.sender_ids], receivers)] = result.dense()[:, hit]
        return values

    matrix(cube(1))
    for rays in (4096,) if quick else (4096, 16384, 65536):
        yield "raystrack", f"{rays} rays a face", lambda job, rays=rays: matrix(job, rays)
