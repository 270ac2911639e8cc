"""Solutions: radiosity and irradiance as functions on the surfaces."""

from __future__ import annotations

import json
import os
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _native as native_module
from ._arrays import count, vectors
from ._arrays import tolerance as checked_tolerance
from ._materials import Quantity
from ._native import HatboxError
from ._progress import bar
from ._scene import HatboxWarning, Scene, _warn
from ._system import System, _settings

# The operator may have this part of the error.
_OPERATOR_SHARE = 0.5


class Probed(NamedTuple):
    """Values at points."""

    irradiance: npt.NDArray[np.float64]
    """E in lx or W/m², shape (n, bands); NaN where no surface looks the point's way."""
    radiosity: npt.NDArray[np.float64]
    """B in lm/m² or W/m², likewise."""


class Triangles(NamedTuple):
    """A solution as triangles with values at their vertices."""

    vertices: npt.NDArray[np.float64]
    """Positions in metres, shape (n, 3). Where the solution jumps, a place has several vertices."""
    normals: npt.NDArray[np.float64]
    """Unit normals, shape (n, 3)."""
    triangles: npt.NDArray[np.uint32]
    """Indices of vertices, shape (m, 3), counter-clockwise from the lit side."""
    values: npt.NDArray[np.float64]
    """B or E, shape (n, bands)."""


@dataclass(frozen=True)
class Energy:
    """Where the power went, per band, in lm or W; arrays of the shape (bands,)."""

    emitted: npt.NDArray[np.float64]
    """∫B⁰, what the lamps emit."""
    leaving: npt.NDArray[np.float64]
    """∫B, what leaves the surfaces."""
    absorbed: npt.NDArray[np.float64]
    """∫(1 − R)E, what the surfaces keep."""
    escaped: npt.NDArray[np.float64]
    """What leaves the scene or falls on unlit backs."""
    defect: float
    """|emitted − absorbed − escaped| / emitted, the greatest of all bands."""
    mean_irradiance: npt.NDArray[np.float64]
    """∫E divided by the area, in lx or W/m²."""


@dataclass(frozen=True)
class ErrorEstimate:
    """How wrong the solution may be. From samples: an estimate, not a bound."""

    estimate: float
    """‖B − B̃‖ / ‖B̃ − B⁰‖, the relative L2 error of the reflected light."""
    residual: float
    """The relative residual of the equation at points that the solver never saw."""
    propagated: float
    """What the residual causes elsewhere by reflection. The estimate is the norm of the sum of the two functions."""
    data: float
    """Of the residual, what textures lose by projection."""
    discretisation: float
    """Of the residual, the rest: elements too large for the light on them, and the operator's part."""
    bends: float
    """What joining takes from elements that are joined where faces bend; `continuity="broken"` does not join."""
    pointwise: list[float]
    """The residuals relative to the light *there* that half of the area does not exceed, and nine tenths."""
    absorption: float
    """The emitted over the leaving power."""
    operator: float
    """What the operator's errors (quadrature and visibility) change of the reflected light, in the same norm."""
    solver: float
    """Relative residual that the solver left."""
    seconds: float
    """Time it took to estimate."""


class Certificate(NamedTuple):
    """What the error of a solution is proven not to exceed, in the worst band."""

    bound: float
    """‖B − B̃‖ / ‖B̃ − B⁰‖, the relative L2 error of the reflected light, at the most."""
    residual: float
    """The relative residual of the equation, at the most. The bound is this, divided by 1 − reflectance."""
    reflectance: float
    """The greatest reflectance."""
    receivers: int
    """Number of parts of elements on which the residual was bounded."""


class Solution:
    """Radiosity B and irradiance E as functions on the N cells of a subdivided scene.

    A cell's functions are given by the values at its nodes: D coefficients in all, per band.
    """

    _native: native_module.Solution
    _system: System | None

    def __init__(self) -> None:
        raise TypeError("solutions come from hatbox.solve and Solution.load")

    @classmethod
    def _of(cls, native: native_module.Solution, system: System | None) -> Solution:
        solution = cls.__new__(cls)
        solution._native, solution._system = native, system
        return solution

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Solution:
        """Reads what `save` or the command line wrote as `.npz`. It cannot be relit: the operator is not in the file.

        Raises:
            HatboxError: It is no such file, or a damaged one.
        """
        return cls._of(native_module.Solution.load(os.fspath(path)), None)

    def save(self, path: str | os.PathLike[str], *, threads: int | None = None, progress: bool = False) -> None:
        """Writes a file, whole or not at all; the format follows the extension (see `hatbox.OUTPUTS`).

        Raises:
            HatboxError: No such format, or the file cannot be written.
            KeyboardInterrupt: Ctrl-C; nothing is written then.
        """
        threads = count("threads", threads)
        with bar(progress) as reporter:
            self._native.save(os.fspath(path), threads, reporter)

    @cached_property
    def radiosity(self) -> npt.NDArray[np.float64]:
        """B at the nodes in lm/m² or W/m², shape (D, bands); read-only, shared with the solution."""
        return self._native.radiosity.T

    @cached_property
    def irradiance(self) -> npt.NDArray[np.float64]:
        """E at the nodes in lx or W/m², shape (D, bands); read-only, shared with the solution."""
        return self._native.irradiance.T

    @cached_property
    def coefficients(self) -> npt.NDArray[np.float64]:
        """What was solved for: the coefficients of B in the joined space, shape (unknowns, bands)."""
        return self._native.coefficients.T

    @cached_property
    def nodes(self) -> npt.NDArray[np.float64]:
        """The points at which the coefficients are the values, in metres; shape (D, 3)."""
        return self._native.nodes

    @cached_property
    def offsets(self) -> npt.NDArray[np.uint64]:
        """Cell c has the coefficients `offsets[c]` to `offsets[c + 1]`; shape (N + 1,)."""
        return self._native.offsets

    @property
    def basis(self) -> str:
        """Name of the basis."""
        return self._native.basis

    @cached_property
    def scene(self) -> Scene:
        """The scene, subdivided as it was solved."""
        return Scene._of(self._native.scene)

    @property
    def system(self) -> System:
        """The finite-element system behind it.

        Raises:
            HatboxError: The solution came from a file.
        """
        if self._system is None:
            raise HatboxError("a solution from a file has no exchange operator\n  help: solve the scene again")
        return self._system

    @cached_property
    def report(self) -> dict[str, Any]:
        """What the solve did, with the keys of `hatbox solve --json`.

        Raises:
            HatboxError: The solution came from a file.
        """
        text = self._native.report
        if text is None:
            raise HatboxError("a solution from a file does not know how it was made\n  help: solve the scene again")
        report: dict[str, Any] = json.loads(text)
        return report

    @cached_property
    def energy(self) -> Energy:
        """Where the power went."""
        found = dict(self.report["energy"])
        defect = found.pop("defect")
        return Energy(**{key: np.array(value) for key, value in found.items()}, defect=defect)

    @cached_property
    def error(self) -> ErrorEstimate | None:
        """The estimated error; `None` if it was not asked for."""
        found = self.report["error"]
        return None if found is None else ErrorEstimate(**{k: v for k, v in found.items() if k != "kind"})

    def certify(self, *, threads: int | None = None, progress: bool = False) -> Certificate:
        """Proves what the error is at most: far more than the estimate, and many times the work.

        Raises:
            HatboxError: A material varies from place to place, or reflects everything; or a cell is a quad that is no
                parallelogram, and its functions are not constant.
            KeyboardInterrupt: Ctrl-C.
        """
        threads = count("threads", threads)
        with bar(progress) as reporter:
            return Certificate(*self._native.certify(threads, reporter))

    def probe(
        self,
        points: npt.ArrayLike,
        normals: npt.ArrayLike,
        *,
        direct: bool = False,
        gather: bool = False,
        seed: int = 0,
        threads: int | None = None,
    ) -> Probed:
        """E and B at points. Each takes the value of the nearest cell whose lit side looks the way of its normal.

        Args:
            points: Positions in metres, shape (n, 3).
            normals: Directions of any length, shape (n, 3) or (3,).
            direct: Whether the light of lamps is taken as it falls on each point, with shadows as sharp as they are,
                instead of as functions on elements have it.
            gather: Whether all light is gathered afresh at each point: the most accurate, at the price of a visit of
                every surface for every point. The direct light is in it. Points in the air, as on a work plane, get
                what arrives there, and NaN for B.
            seed: Of the rays, where so much stands between that rays are needed.
            threads: How many; as many as there are processors if not given.

        Raises:
            HatboxError: A wrong shape, or both `direct` and `gather`.
            KeyboardInterrupt: Ctrl-C.

        Points that lie far from any surface, and those that find none, are a `HatboxWarning`.
        """
        positions = vectors("points", points)
        directions = vectors(
            "normals", np.broadcast_to(np.asarray(normals), positions.shape) if np.shape(normals) == (3,) else normals
        )
        if directions.shape != positions.shape:
            raise HatboxError(f"normals: the shape is {directions.shape}, but {positions.shape} is needed")
        if direct and gather:
            raise HatboxError("direct and gather: what is gathered has the direct light in it\n  help: choose one")
        irradiance, radiosity, doubts = self._native.probe(positions, directions, direct, gather, seed, threads)
        for doubt in doubts:
            warnings.warn(doubt, HatboxWarning, stacklevel=2)
        return Probed(irradiance.T, radiosity.T)

    def bake(self, quantity: str = "radiosity") -> Triangles:
        """B or E ("radiosity" or "irradiance") as triangles with values at their vertices, for other programs.

        Raises:
            HatboxError: It is neither.
        """
        if quantity not in ("radiosity", "irradiance"):
            raise HatboxError(f"quantity `{quantity}` is neither `radiosity` nor `irradiance`")
        vertices, normals, triangles, values = self._native.bake(quantity == "irradiance")
        return Triangles(vertices, normals, triangles, values.T)

    def relight(self, exitance: Quantity, **options: Any) -> Solution:
        """The solution under other lamps, on the operator that is there.

        Args:
            exitance: B⁰ in lm/m² or W/m², as in `Scene`, with a row for each of `scene.material_names`; a mapping
                changes those it names.
            options: Those of `System.solve`.

        Raises:
            HatboxError: An impossible exitance, or the solution came from a file.
            KeyboardInterrupt: Ctrl-C.

        How finely shadows are sampled follows the first lamps; see `System.with_materials`. What the first solution has
        asked of a sampled operator is known: lamps that are dimmed or tinted together take no pass over its rays,
        others and other paints fewer than before.
        """
        return self.system.with_materials(exitance=exitance).solve(**options)

    def repaint(self, reflectance: Quantity, **options: Any) -> Solution:
        """The solution with other reflectances, on the operator that is there; see `relight`."""
        return self.system.with_materials(reflectance=reflectance).solve(**options)

    def __repr__(self) -> str:
        return f"<hatbox.Solution: {self.basis}, {len(self.radiosity)} coefficients, {self.radiosity.shape[1]} bands>"


def solve(
    scene: Scene,
    basis: str = "linear",
    *,
    tolerance: float = 0.02,
    operator: str = "auto",
    progress: bool = True,
    continuity: str = "continuous",
    elements: int | None = None,
    max_edge: float | None = None,
    max_unknowns: int | None = None,
    focus: str | npt.ArrayLike | None = None,
    gather: bool = False,
    grading: float = 1.0,
    memory: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    solver: str = "auto",
    seed: int = 0,
    threads: int | None = None,
    error_points: int = 512,
) -> Solution:
    """Computes the radiosity of a scene, to a tolerance or on a given subdivision.

    Args:
        scene: The scene.
        basis: A name of `hatbox.BASES`.
        tolerance: Relative L2 error of the reflected light, estimated, between 0 and 1: the mesh is refined where the
            light needs it until the estimate is no greater. With `elements` or `max_edge` the mesh is as they say, and
            the estimate (`Solution.error`) tells what was reached; form factors and visibility may have half of the
            error then as well.
        operator: "auto" or a name of `hatbox.OPERATORS`.
        progress: Whether a bar is drawn, where there is a terminal or a notebook to draw it in.
        continuity: A name of `hatbox.CONTINUITIES`.
        elements: Subdivide to about so many elements.
        max_edge: Subdivide until no edge is longer, in metres.
        max_unknowns: Refinement stops before a band has more coefficients (three for a linear element): 20 000 with the
            operator "dense" and a million with others, or twice those of the first mesh, if not given.
            `Solution.report["adaptivity"]["reached"]` tells whether it did.
        focus: Where the error counts: the name of a material or a group, or two opposite corners of a box, shape
            (2, 3). Elsewhere it counts as far as it matters there.
        gather: Whether the light is gathered once more at the nodes: sharper shadows, half an order more accurate.
        grading: Vertices of the subdivision are at t^q from the edges of faces, this being q: finer there, where light
            varies most. 2 suits linear and 3 quadratic functions.
        memory: The most bytes that the operator may store; 16 GiB if not given.
        checkpoint: A file that keeps finished work, from which the same work goes on if it exists: after a crash, an
            interrupt or a kill, with the same result. Rays are kept, which are most of the work of a large scene. It is
            removed when the solution is there.
        solver: "auto" or a name of `hatbox.SOLVERS`.
        seed: Seed of everything that is sampled.
        threads: Number of threads, here and in all that is done with `Solution.system`; as many as there are processors
            if not given. No result depends on it.
        error_points: Number of points at which the error is estimated, at the least; with 0 it stays unknown, which
            needs a given subdivision.

    Raises:
        HatboxError: A name that is in no list, a tolerance or subdivision that is impossible, too many unknowns, no
            convergence, nothing in focus, a checkpoint of other work or one that cannot be written.
        KeyboardInterrupt: Ctrl-C.
    """
    tolerance, threads = checked_tolerance(tolerance), count("threads", threads)
    if elements is None and max_edge is None:
        if error_points < 1:
            raise HatboxError("error_points 0: refinement needs an estimate\n  help: give elements or max_edge")
        settings = _settings(basis, continuity, tolerance, operator, grading, memory, seed, checkpoint)
        count("max_unknowns", max_unknowns)
        region = focus if focus is None or isinstance(focus, str) else _box(focus)
        with bar(progress) as reporter:
            system, native = native_module.System.adapted(
                scene._native, settings, solver, error_points, max_unknowns, region, gather, threads, reporter
            )
        _warn(native.warnings)
        return Solution._of(native, System._of(system))
    if focus is not None:
        raise HatboxError("focus: with elements or max_edge nothing is refined\n  help: give a tolerance only")
    fixed = System(
        scene,
        basis,
        continuity=continuity,
        elements=elements,
        max_edge=max_edge,
        tolerance=_OPERATOR_SHARE * tolerance,
        operator=operator,
        grading=grading,
        memory=memory,
        checkpoint=checkpoint,
        seed=seed,
        threads=threads,
        progress=progress,
    )
    solution = fixed.solve(solver=solver, error_points=error_points, gather=gather, threads=threads, progress=progress)
    _warn(solution._native.warnings)
    return solution


def _box(corners: npt.ArrayLike) -> list[list[float]]:
    array = vectors("focus", corners, "2")
    if len(array) != 2:
        raise HatboxError(f"focus: the shape is {array.shape}, but (2, 3) is needed")
    return [[float(number) for number in corner] for corner in array]
