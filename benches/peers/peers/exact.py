"""View factors in closed form: the rectangles into which the sides of a box are cut."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

Kernel = Callable[..., np.ndarray]


def box_factors(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """F of all pairs of rectangles on the sides of a box, parallel to the axes; nothing stands between."""
    corners = vertices[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    extents = np.stack([low, high], axis=2)
    normal = np.argmin(high - low, axis=1)
    area = np.prod(np.where(high > low, high - low, 1.0), axis=1)
    factors = np.zeros((len(faces), len(faces)))
    for a, b in itertools.product(range(3), repeat=2):
        rows, columns = np.flatnonzero(normal == a), np.flatnonzero(normal == b)
        exchange = _parallel if a == b else _perpendicular
        factors[np.ix_(rows, columns)] = exchange(extents[rows][:, None], extents[columns][None], a, b)
    return factors / area[:, None]


def _parallel(one: np.ndarray, two: np.ndarray, axis: int, _: int) -> np.ndarray:
    """A₁F₁₂ of parallel rectangles: Howell's catalogue, C-13."""
    gap = np.abs(one[..., axis, 0] - two[..., axis, 0])
    z = np.where(gap > 0, gap, 1.0)
    u, v = (k for k in range(3) if k != axis)

    def kernel(x: np.ndarray, y: np.ndarray, xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
        a, b = y - eta, x - xi
        p, q = np.sqrt(b**2 + z**2), np.sqrt(a**2 + z**2)
        return (a * p * np.arctan(a / p) + b * q * np.arctan(b / q) - z**2 / 2 * np.log(p**2 + a**2)) / (2 * np.pi)

    ends = (one[..., u, :], one[..., v, :], two[..., u, :], two[..., v, :])
    return np.where(gap > 0, _alternating(kernel, *ends), 0.0)


def _perpendicular(one: np.ndarray, two: np.ndarray, a: int, b: int) -> np.ndarray:
    """A₁F₁₂ of perpendicular rectangles: Howell's catalogue, C-15, by distances from where the planes meet."""
    common = 3 - a - b
    from_two = np.sort(np.abs(one[..., b, :] - two[..., b, :1]), axis=-1)
    from_one = np.sort(np.abs(two[..., a, :] - one[..., a, :1]), axis=-1)

    def kernel(x: np.ndarray, y: np.ndarray, xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
        c, d = np.sqrt(x**2 + xi**2), y - eta
        square = c**2 + d**2
        angle = np.arctan(d / np.where(c > 0, c, 1.0))
        return (d * c * angle - (c**2 - d**2) / 4 * np.log(np.where(square > 0, square, 1.0))) / (2 * np.pi)

    return _alternating(kernel, from_two, one[..., common, :], from_one, two[..., common, :])


def _alternating(kernel: Kernel, *intervals: np.ndarray) -> np.ndarray:
    """The sum of a kernel over all choices of ends, with the sign of the number of lower ends."""
    total: np.ndarray = np.zeros(())
    for ends in itertools.product((0, 1), repeat=len(intervals)):
        chosen = (interval[..., end] for interval, end in zip(intervals, ends, strict=True))
        total = total + (-1) ** sum(ends) * kernel(*chosen)
    return total
