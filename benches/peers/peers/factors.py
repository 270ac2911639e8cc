"""View factors: all of a closed enclosure, and single pairs with a blocker between."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import hatbox

from .measure import Row, timed
from .scenes import Enclosure, cube, l_room, occluded

Matrix = Callable[[np.ndarray, np.ndarray], np.ndarray]


def tools(quick: bool) -> Iterator[tuple[str, str, Matrix]]:
    """Name, setting, and F of quads; F_ij is the fraction of what leaves i that reaches j."""
    for tolerance in [1e-2] if quick else [1e-2, 1e-3, 1e-4]:
        yield (
            "hatbox",
            f"tolerance {tolerance:g}",
            lambda v, f, t=tolerance: hatbox.view_factors(v, f, tolerance=t).toarray(),
        )
    try:
        import pyviewfactor
        import pyvista
    except ImportError:
        pass
    else:

        def semi_analytic(v: np.ndarray, f: np.ndarray) -> np.ndarray:
            mesh = pyvista.PolyData.from_regular_faces(v, f)
            # Its F[i, j] is from j to i.
            return np.asarray(pyviewfactor.compute_viewfactor_matrix(mesh)).T

        # The first call compiles; that is not its work.
        small = cube(1)
        semi_analytic(small.vertices, small.faces)
        yield "pyviewfactor", "default", semi_analytic
    try:
        import raystrack
    except ImportError:
        pass
    else:
        for rays in [4096] if quick else [4096, 32768]:
            yield "raystrack", f"{rays} rays a face", lambda v, f, n=rays: _raystrack(raystrack, v, f, n)


def _raystrack(module: object, vertices: np.ndarray, faces: np.ndarray, rays: int) -> np.ndarray:
    r = module
    triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    meshes = {str(k): r.Mesh(vertices[face].astype(np.float32), triangles) for k, face in enumerate(faces)}  # type: ignore[attr-defined]
    scene = r.Scene(r.Surface(name, mesh) for name, mesh in meshes.items())  # type: ignore[attr-defined]
    options = r.SolveOptions(sampling=r.Sampling(rays_per_cell=128))  # type: ignore[attr-defined]
    with r.Solver(scene, device="cpu") as solver:  # type: ignore[attr-defined]
        query = r.Query.matrix(receiver_sides=("front",))  # type: ignore[attr-defined]
        result = solver.solve(query, options, r.Budget(rays=rays * len(faces)))  # type: ignore[attr-defined]
    place = {name: k for k, name in enumerate(meshes)}
    matrix = np.zeros((len(faces), len(faces)))
    dense = np.asarray(result.dense())
    for column, channel in enumerate(result.channels):
        receiver = getattr(channel, "receiver", None) or getattr(channel, "surface_id", None) or channel.surface
        if str(receiver) in place:
            matrix[[place[name] for name in result.sender_ids], place[str(receiver)]] += dense[:, column]
    return matrix


def measure(quick: bool) -> Iterator[Row]:
    """Row sums of enclosures, and the error of occluded pairs."""
    jobs: list[Enclosure] = [cube(7)] if quick else [cube(13), l_room(9)]
    for tool, setting, matrix in tools(quick):
        for job in jobs:
            factors, seconds, cpu = timed(lambda: matrix(job.vertices, job.faces))
            deficit = np.abs(factors.sum(axis=1) - 1)
            errors = {"worst row": float(deficit.max()), "mean row": float(deficit.mean())}
            yield Row(f"{job.name}, {len(job.faces)} faces", tool, setting, seconds, cpu, errors)
        for pair in occluded():
            vertices, faces = _pair(pair.blocker)
            factors, seconds, cpu = timed(lambda: matrix(vertices, faces))
            error = abs(factors[0, 1] / pair.exact - 1)
            yield Row(pair.name, tool, setting, seconds, cpu, {"relative": float(error)})


def _pair(blocker: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    squares = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]], float)
    return np.vstack([squares, blocker]), np.arange(12).reshape(3, 4)
