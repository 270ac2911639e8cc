"""Irradiance at points of the Cornell box and of two rooms, to an error in some time; and again under another lamp."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import hatbox

from . import path_tracer, radiance
from .measure import LONG, AbsentError, Row, pointwise, timed
from .scenes import Lit, cornell, two_rooms

Tool = Callable[[Lit, bool], Iterator[Row]]


def measure_cornell(quick: bool, absent: dict[str, str]) -> Iterator[Row]:
    """Every tool on the Cornell box."""
    yield from _measure(cornell(), quick, absent)


def measure_rooms(quick: bool, absent: dict[str, str]) -> Iterator[Row]:
    """Every tool on two rooms with a lamp in the first."""
    yield from _measure(two_rooms(), quick, absent)


def _measure(job: Lit, quick: bool, absent: dict[str, str]) -> Iterator[Row]:
    tools: dict[str, Tool] = {"hatbox": _hatbox, "mitsuba": path_tracer.measure, "radiance": radiance.measure}
    for name, tool in tools.items():
        try:
            yield from tool(job, quick)
        except AbsentError as error:
            absent[name] = str(error)


def _hatbox(job: Lit, quick: bool) -> Iterator[Row]:
    tolerances = (0.1,) if quick else (0.1, 0.05, 0.02, 0.01)
    meshes = () if quick else (("linear", 1000), ("linear", 4000), ("quadratic", 1000), ("quadratic", 3000))
    for tolerance in tolerances:
        row = _row(job, "tolerance", f"{tolerance:g}", tolerance=tolerance)
        yield row
        if row.seconds > LONG:
            break
    for tolerance in (0.5,) if quick else (0.5, 0.2, 0.1, 0.05, 0.02):
        yield _row(job, "tolerance, direct light", f"{tolerance:g}", direct=True, tolerance=tolerance)
    for elements in () if quick else (100, 250, 500):
        options = {"direct": True, "basis": "quadratic", "elements": elements, "error_points": 0}
        yield _row(job, "quadratic, direct light", f"{elements} elements", **options)  # type: ignore[arg-type]
    for elements in () if quick else (200, 300, 1000):
        options = {"direct": True, "operator": "sampled", "elements": elements, "error_points": 0}
        yield _row(job, "by rays, direct light", f"{elements} elements", **options)  # type: ignore[arg-type]
    for basis, elements in meshes:
        yield _row(job, basis, f"{elements} elements", basis=basis, elements=elements, error_points=0)


def _row(job: Lit, series: str, setting: str, *, direct: bool = False, **options: object) -> Row:
    def first() -> tuple[hatbox.Solution, dict[str, float]]:
        solution = hatbox.solve(job.scene, progress=False, **options)  # type: ignore[arg-type]
        return solution, _errors(solution, job, direct)

    (solution, errors), seconds, cpu = timed(first)
    lamps = 2 * job.scene.exitance
    _, _, again = timed(lambda: _errors(solution.relight(lamps, error_points=0), job, direct))
    return Row(job.name, "hatbox", series, setting, seconds, cpu, errors, again)


def _errors(solution: hatbox.Solution, job: Lit, direct: bool) -> dict[str, float]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hatbox.HatboxWarning)
        found = solution.probe(job.points, job.normals, direct=direct).irradiance
    return pointwise(found, job.truth, job.weights)
