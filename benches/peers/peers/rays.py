"""Rays a second: Embree by way of embreex, and the library's own by its bench."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator

import numpy as np

from .measure import Row, timed
from .scenes import ROOT


def measure(quick: bool) -> Iterator[Row]:
    """Closest hits of rays in a sphere of 82 thousand triangles, in all directions."""
    yield from _embree(100_000 if quick else 2_000_000)
    if not quick:
        yield from _own()


def _sphere(times: int) -> np.ndarray:
    octahedron = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], float)
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    triangles = octahedron[np.array(faces)]
    for _ in range(times):
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        ab, bc, ca = a + b, b + c, c + a
        parts = [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        triangles = np.concatenate(parts)
        triangles /= np.linalg.norm(triangles, axis=2, keepdims=True)
    return triangles


def _embree(count: int) -> Iterator[Row]:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        return
    scene = EmbreeScene()
    triangles = _sphere(6)
    TriangleMesh(scene, triangles.astype(np.float32))
    random = np.random.default_rng(1)
    origins = (0.5 * random.standard_normal((count, 3)) / 3).astype(np.float32)
    directions = random.standard_normal((count, 3))
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    scene.run(origins[:1000], directions[:1000])
    _, seconds, cpu = timed(lambda: scene.run(origins, directions))
    setting = f"{len(triangles)} triangles, incoherent, one thread"
    yield Row("rays", "embree", setting, seconds, cpu, {"million a second": count / cpu / 1e6})


def _own() -> Iterator[Row]:
    command = ["cargo", "bench", "-p", "hatbox", "--bench", "rays"]
    done, seconds, cpu = timed(lambda: subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False))
    for line in done.stdout.splitlines():
        rate = re.search(r"([\d.]+)\s*M", line)
        if rate:
            yield Row("rays", "hatbox", line.strip(), seconds, cpu, {"million a second": float(rate.group(1))})
