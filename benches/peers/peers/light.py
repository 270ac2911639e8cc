"""Irradiance at points of the Cornell box and of two rooms: time against error; and the same under another lamp."""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

import hatbox

from .measure import Row, pointwise, timed
from .scenes import Lit, cornell, two_rooms


def measure(quick: bool) -> Iterator[Row]:
    """All tools on both scenes."""
    for job in (cornell(), two_rooms()):
        yield from _hatbox(job, quick)
        yield from _mitsuba(job, quick)
        yield from _radiance(job, quick)


def _hatbox(job: Lit, quick: bool) -> Iterator[Row]:
    settings = (
        [("linear", 500)] if quick else [("linear", 1000), ("linear", 3000), ("quadratic", 1000), ("quadratic", 3000)]
    )
    for basis, elements in settings:
        solution, seconds, cpu = timed(
            lambda: hatbox.solve(job.scene, basis, elements=elements, error_points=0, progress=False)
        )
        yield Row(job.name, "hatbox", f"{basis}, {elements}", seconds, cpu, _errors(solution, job))
        lamps = 2 * job.scene.exitance
        relit, seconds, cpu = timed(lambda: solution.relight(lamps, error_points=0))
        yield Row(f"{job.name}, relit", "hatbox", f"{basis}, {elements}", seconds, cpu, _errors(relit, job, 2.0))


def _errors(solution: hatbox.Solution, job: Lit, scale: float = 1.0) -> dict[str, float]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hatbox.HatboxWarning)
        found = solution.probe(job.points, job.normals).irradiance / scale
    return pointwise(found, job.truth, job.weights)


def mitsuba_irradiance(job: Lit, samples: int, seed: int = 0) -> np.ndarray:
    """E at every point: a nearly white patch of the size of a dust grain lies there, and a path tracer looks at it.

    So light comes directly from the lamps by next-event estimation, as in a picture. The scalar variant runs everywhere.
    """
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    size = float(np.ptp(job.scene.vertices, axis=0).max())
    integrator = mi.load_dict({"type": "path", "max_depth": -1, "rr_depth": 8})

    def read(k: int) -> np.ndarray:
        # A scene for each point: these scenes load in no time, and no patch stands in another's way.
        patch = _patch(mi, job.points[k], job.normals[k], size)
        scene = mi.load_dict({**_mitsuba_scene(mi, job.scene), **patch})
        radiance = np.array(integrator.render(scene, seed=seed + k, spp=samples)).reshape(-1)[:3]
        return math.pi * radiance / _WHITE

    with ThreadPoolExecutor() as pool:
        return np.array(list(pool.map(read, range(len(job.points)))))


# Reflectance of the patches.
_WHITE = 0.99


def _patch(mi, point: np.ndarray, normal: np.ndarray, size: float) -> dict[str, object]:  # type: ignore[no-untyped-def]
    side = [float(x) for x in np.eye(3)[np.argmin(np.abs(normal))]]

    def above(height: float) -> list[float]:
        return [float(x) for x in point + height * size * normal]

    grain = mi.ScalarTransform4f().look_at(above(1e-4), above(1.0), side) @ mi.ScalarTransform4f().scale(1e-4 * size)
    film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}, "component_format": "float32"}
    view = mi.ScalarTransform4f().look_at(above(2e-4), above(0.0), side)
    white = {"type": "diffuse", "reflectance": _rgb(np.array([_WHITE]))}
    return {
        "patch": {"type": "rectangle", "to_world": grain, "bsdf": white},
        "eye": {"type": "radiancemeter", "to_world": view, "film": film, "sampler": {"type": "independent"}},
    }


def _mitsuba_scene(mi, scene: hatbox.Scene) -> dict[str, object]:  # type: ignore[no-untyped-def]
    parts: dict[str, object] = {"type": "scene"}
    for material in range(len(scene.material_names)):
        quads = scene.cells[scene.material == material]
        triangles = np.concatenate([quads[:, [0, 1, 2]], quads[quads[:, 2] != quads[:, 3]][:, [0, 2, 3]]])
        if not len(triangles):
            continue
        props = mi.Properties()
        props["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": _rgb(scene.reflectance[material])})
        if scene.exitance[material].any():
            props["emitter"] = mi.load_dict({"type": "area", "radiance": _rgb(scene.exitance[material] / math.pi)})
        mesh = mi.Mesh(f"m{material}", len(scene.vertices), len(triangles), props=props)
        values = mi.traverse(mesh)
        values["vertex_positions"] = scene.vertices.astype(np.float32).ravel()
        values["faces"] = triangles.astype(np.uint32).ravel()
        values.update()
        parts[f"m{material}"] = mesh
    return parts


def _rgb(values: np.ndarray) -> dict[str, object]:
    # As a spectrum: a colour would be clamped to what a display shows.
    return {"type": "rgb", "value": [float(v) for v in np.broadcast_to(values, 3)]}


def _some(job: Lit) -> Lit:
    """An even choice of the points, for tools that pay for each."""
    chosen = slice(None, None, max(1, len(job.points) // 300))
    return Lit(job.name, job.scene, job.points[chosen], job.normals[chosen], job.weights[chosen], job.truth[chosen])


def _mitsuba(job: Lit, quick: bool) -> Iterator[Row]:
    try:
        import mitsuba  # noqa: F401

    except ImportError:
        return
    job = _some(job)
    for samples in [64] if quick else [64, 256, 1024, 4096]:
        found, seconds, cpu = timed(lambda: mitsuba_irradiance(job, samples, 1))
        errors = pointwise(found, job.truth, job.weights)
        setting = f"{samples} paths at each of {len(job.points)} points"
        yield Row(job.name, "mitsuba", setting, seconds, cpu, errors)
        # Another lamp is another run.
        yield Row(f"{job.name}, relit", "mitsuba", setting, seconds, cpu, errors)


def _radiance(job: Lit, quick: bool) -> Iterator[Row]:
    try:
        import pyradiance
    except ImportError:
        return
    job = _some(job)
    with tempfile.TemporaryDirectory() as folder:
        octree = Path(folder) / "scene.oct"
        try:
            octree.write_bytes(pyradiance.oconv(stdin=_rad(job.scene).encode(), warning=False))
        except Exception as error:
            print(f"pyradiance: {error}")
            return
        rays = (
            "\n".join(" ".join(f"{x:.9g}" for x in (*p, *n)) for p, n in zip(job.points, job.normals, strict=True))
            + "\n"
        )
        for divisions in [64] if quick else [256, 1024, 4096]:
            options = ["-ab", "8", "-ad", str(divisions), "-as", "0", "-aa", "0.1", "-lw", "1e-4", "-ds", "0.02"]

            def trace(options: list[str] = options) -> np.ndarray:
                text = pyradiance.rtrace(rays.encode(), octree, header=False, irradiance=True, params=options)
                return np.loadtxt(text.decode().splitlines())

            found, seconds, cpu = timed(trace)
            errors = pointwise(found[:, :3], job.truth, job.weights)
            yield Row(job.name, "radiance", f"-ab 8 -ad {divisions} -aa 0.1", seconds, cpu, errors)


def _rad(scene: hatbox.Scene) -> str:
    """The scene in Radiance's own format. Its plastic is lit on both sides; closed rooms do not notice."""
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
