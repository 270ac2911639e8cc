"""Time and error, and what could not be measured."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

T = TypeVar("T")

# Seconds after which a program's next step, which takes a multiple, is left out.
LONG = 15.0


class AbsentError(Exception):
    """A program is not here, or does not run; the text says why."""


@dataclass(frozen=True)
class Row:
    """One measurement."""

    job: str
    tool: str
    series: str
    """What rows of a tool that belong together have in common."""
    setting: str
    """In what they differ."""
    seconds: float
    cpu_seconds: float
    errors: dict[str, float]
    """The first is the one by which programs are compared."""
    again: float | None = None
    """Seconds of all processors for the same under another lamp."""


def _cpu() -> float:
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def timed(work: Callable[[], T]) -> tuple[T, float, float]:
    """What the work returns, the seconds it took, and those of all processors."""
    started, cpu = time.perf_counter(), _cpu()
    result = work()
    return result, time.perf_counter() - started, _cpu() - cpu


def relative_l2(found: np.ndarray, truth: np.ndarray, weights: np.ndarray | float = 1.0) -> float:
    """The norm of the difference over that of the truth."""
    return float(np.sqrt((weights * (found - truth) ** 2).sum() / (weights * truth**2).sum()))


def pointwise(found: np.ndarray, truth: np.ndarray, weights: np.ndarray | None = None) -> dict[str, float]:
    """The relative L2 error, and the median and 95th percentile of the relative error at a point.

    `truth` has a row of bands for each point; points weigh the same unless weights are given.
    """
    relative = np.linalg.norm(found - truth, axis=1) / np.linalg.norm(truth, axis=1)
    return {
        "L2": relative_l2(found, truth, 1.0 if weights is None else weights[:, None]),
        "median": float(np.median(relative)),
        "95 %": float(np.percentile(relative, 95)),
    }
