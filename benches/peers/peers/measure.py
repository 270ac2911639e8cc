"""Time and error."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

T = TypeVar("T")


@dataclass(frozen=True)
class Row:
    """One measurement."""

    job: str
    tool: str
    setting: str
    seconds: float
    cpu_seconds: float
    errors: dict[str, float]


def _cpu() -> float:
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def timed(work: Callable[[], T]) -> tuple[T, float, float]:
    """What the work returns, the seconds it took, and those of all processors."""
    started, cpu = time.perf_counter(), _cpu()
    result = work()
    return result, time.perf_counter() - started, _cpu() - cpu


def pointwise(found: np.ndarray, truth: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """The relative L2 error, and the median and 95th percentile of the relative error at a point."""
    difference, norm = np.linalg.norm(found - truth, axis=1), np.linalg.norm(truth, axis=1)
    relative = difference / norm
    return {
        "L2": float(np.sqrt((weights * difference**2).sum() / (weights * norm**2).sum())),
        "median": float(np.median(relative)),
        "95 %": float(np.percentile(relative, 95)),
    }
