"""Mitsuba 3: irradiance at points by path tracing.

At each point lies a nearly white square of the size of a dust grain, and a path tracer looks at it. So light comes
directly from the lamps by next-event estimation, as in a picture.
"""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import hatbox

from .measure import LONG, AbsentError, Row, pointwise, timed
from .scenes import Lit

# Reflectance of the grains, and their half side over the size of the scene.
_WHITE = 0.99
_GRAIN = 1e-4
# Paths that are followed at once.
_WAVE = 1 << 22
# Compiles a path tracer and runs it; an LLVM that is too old ends the process.
_TRIAL = """
import mitsuba
mitsuba.set_variant("llvm_ad_rgb")
integrator = {"type": "path", "max_depth": -1, "rr_depth": 2}
mitsuba.render(mitsuba.load_dict(mitsuba.cornell_box() | {"integrator": integrator}), spp=1).numpy()
"""


def measure(job: Lit, quick: bool) -> Iterator[Row]:
    """More and more paths."""
    trace = tracer(job)
    # The first call compiles, where there is anything to compile; that is not its work.
    trace(1, 0)
    for paths in (16,) if quick else (16, 64, 256, 1024):
        # With the scene, as a new one needs to be made for every lamp.
        found, seconds, cpu = timed(lambda: tracer(job)(paths, 1))  # noqa: B023
        errors = pointwise(found, job.truth, job.weights)
        yield Row(job.name, "mitsuba", _variant(), f"{paths} paths a point", seconds, cpu, errors, cpu)
        if seconds > LONG:
            break


@cache
def _variant() -> str:
    """The fastest variant that works here: Mitsuba compiles its kernels where it finds an LLVM that is able to."""
    if importlib.util.find_spec("mitsuba") is None:
        raise AbsentError("there is no module mitsuba in the environment")
    variant = "llvm_ad_rgb" if any(map(_compiles, _llvm())) else "scalar_rgb"
    import mitsuba as mi

    mi.set_variant(variant)
    return variant


def _compiles(library: str | None) -> bool:
    """Whether Mitsuba compiles with that library; then it will. It looks for one when it is imported."""
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": library} if library else dict(os.environ)
    trial = subprocess.run([sys.executable, "-c", _TRIAL], env=environment, capture_output=True, check=False)
    if trial.returncode == 0:
        os.environ.update(environment)
    return trial.returncode == 0


def _llvm() -> Iterator[str | None]:
    """Where an LLVM may be: where Mitsuba looks by itself, then that of rustc."""
    yield None
    sysroot = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=False)
    if sysroot.returncode == 0:
        yield from sorted(map(str, Path(sysroot.stdout.strip(), "lib").glob("libLLVM*.so*")))


def tracer(job: Lit) -> Callable[[int, int], np.ndarray]:
    """A function of the number of paths at a point and of a seed: E at all points of a job."""
    _variant()
    import mitsuba as mi

    count, size = len(job.points), float(np.ptp(job.scene.vertices, axis=0).max())
    parts = {"type": "scene", "integrator": {"type": "path", "max_depth": -1, "rr_depth": 8}}
    parts |= _surfaces(mi, job.scene) | {"grains": _grains(mi, job, size), "eyes": _eyes(mi, job, size)}
    scene = mi.load_dict(parts)

    def trace(paths: int, seed: int) -> np.ndarray:
        passes = math.ceil(paths * count / _WAVE)
        pictures = [
            np.array(mi.render(scene, spp=math.ceil(paths / passes), seed=seed * 4096 + k)) for k in range(passes)
        ]
        return math.pi / _WHITE * np.mean(pictures, axis=0)[0, :, :3]

    return trace


def _surfaces(mi: Any, scene: hatbox.Scene) -> dict[str, object]:
    """A mesh for each material."""
    parts: dict[str, object] = {}
    for material in range(len(scene.material_names)):
        cells = scene.cells[scene.material == material]
        triangles = np.concatenate([cells[:, [0, 1, 2]], cells[cells[:, 2] != cells[:, 3]][:, [0, 2, 3]]])
        if len(triangles):
            paint, light = scene.reflectance[material], scene.exitance[material] / math.pi
            parts[f"m{material}"] = _mesh(mi, scene.vertices, triangles, paint, light)
    return parts


def _grains(mi: Any, job: Lit, size: float) -> object:
    side = np.eye(3)[np.argmin(np.abs(job.normals), axis=1)]
    u = np.cross(job.normals, side)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(job.normals, u)
    ends = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    corners = [job.points + _GRAIN * size * (a * u + b * v + job.normals) for a, b in ends]
    quads = np.arange(4 * len(job.points)).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return _mesh(mi, np.stack(corners, axis=1).reshape(-1, 3), triangles, np.full(3, _WHITE), np.zeros(3))


def _eyes(mi: Any, job: Lit, size: float) -> dict[str, object]:
    """One eye a point, straight above its grain; each is a pixel of one picture."""

    def film(width: int) -> dict[str, object]:
        box = {"type": "box"}
        return {"type": "hdrfilm", "width": width, "height": 1, "rfilter": box, "component_format": "float32"}

    def eye(point: np.ndarray, normal: np.ndarray) -> dict[str, object]:
        up = np.eye(3)[np.argmin(np.abs(normal))]
        look = [[float(x) for x in vector] for vector in (point + 2 * _GRAIN * size * normal, point, up)]
        return {"type": "radiancemeter", "to_world": mi.ScalarTransform4f().look_at(*look), "film": film(1)}

    eyes = {f"eye{k:06}": eye(*at) for k, at in enumerate(zip(job.points, job.normals, strict=True))}
    return {"type": "batch", "film": film(len(eyes)), "sampler": {"type": "independent"}, **eyes}


def _mesh(mi: Any, vertices: np.ndarray, triangles: np.ndarray, paint: np.ndarray, light: np.ndarray) -> object:
    def rgb(values: np.ndarray) -> dict[str, object]:
        return {"type": "rgb", "value": [float(value) for value in np.broadcast_to(values, 3)]}

    props = mi.Properties()
    props["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": rgb(paint)})
    if light.any():
        props["emitter"] = mi.load_dict({"type": "area", "radiance": rgb(light)})
    mesh = mi.Mesh("mesh", len(vertices), len(triangles), props=props)
    values = mi.traverse(mesh)
    values["vertex_positions"] = vertices.astype(np.float32).ravel()
    values["faces"] = triangles.astype(np.uint32).ravel()
    values.update()
    return mesh
