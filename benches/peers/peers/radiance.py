"""Radiance, by way of pyradiance: irradiance at points by `rtrace -I`."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import hatbox

from .measure import LONG, AbsentError, Row, pointwise, timed
from .scenes import Lit

# Bounces; no extra rays where it is bright; when faint rays end; how finely lamps are cut, and every shadow tested.
_BOUNCES = ["-ab", "8", "-as", "0", "-ar", "64", "-lw", "2e-3", "-lr", "8"]
_OPTIONS = [*_BOUNCES, "-ds", "0.05", "-dj", "0.5", "-dt", "0", "-dc", "1"]


def measure(job: Lit, quick: bool) -> Iterator[Row]:
    """More and more rays, and a finer and finer cache of indirect light, until it takes long."""
    try:
        import pyradiance
    except ImportError as error:
        raise AbsentError(str(error)) from error
    rows = np.hstack([job.points, job.normals])
    rays = "".join(" ".join(f"{x:.9g}" for x in row) + "\n" for row in rows).encode()

    def trace(options: list[str]) -> np.ndarray:
        with tempfile.TemporaryDirectory() as folder:
            octree = Path(folder) / "scene.oct"
            octree.write_bytes(pyradiance.oconv(stdin=_rad(job.scene).encode(), warning=False))
            text = pyradiance.rtrace(rays, octree, header=False, irradiance=True, params=options)
        return np.loadtxt(text.decode().splitlines())[:, :3]

    for divisions, cache in [(32, 0.3)] if quick else [(32, 0.3), (64, 0.2), (128, 0.15), (256, 0.1)]:
        options = f"-aa {cache} -ad {divisions}".split()
        found, seconds, cpu = timed(lambda: trace(_OPTIONS + options))  # noqa: B023
        errors = pointwise(found, job.truth, job.weights)
        yield Row(job.name, "radiance", "", f"-aa {cache} -ad {divisions}", seconds, cpu, errors, cpu)
        if seconds > LONG:
            break


def _rad(scene: hatbox.Scene) -> str:
    """The scene in Radiance's own format. Its plastic is lit on both sides; here no light comes behind anything."""
    text = []
    for k in range(len(scene.material_names)):
        emits, paint = scene.exitance[k].any(), " ".join(f"{v:.9g}" for v in np.broadcast_to(scene.reflectance[k], 3))
        glow = " ".join(f"{v:.9g}" for v in np.broadcast_to(scene.exitance[k] / math.pi, 3))
        text.append(f"void light m{k} 0 0 3 {glow}" if emits else f"void plastic m{k} 0 0 5 {paint} 0 0")
    for index, (cell, material) in enumerate(zip(scene.cells, scene.material, strict=True)):
        corners = scene.vertices[cell[:3] if cell[2] == cell[3] else cell]
        numbers = " ".join(f"{x:.9g}" for x in corners.ravel())
        text.append(f"m{material} polygon f{index} 0 0 {corners.size} {numbers}")
    return "\n".join(text) + "\n"
