"""Scenes that several tests use."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

import hatbox

# The unit cube, seen from inside: floor, ceiling, four walls.
CUBE_VERTICES = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=np.float64
)
CUBE_FACES = np.array([[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [3, 2, 6, 7], [0, 3, 7, 4], [1, 5, 6, 2]])

# Two unit squares that face each other at distance 1 (Howell's catalogue, C-11).
SQUARES = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]], dtype=np.float64
)
SQUARE_FACES = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
C_11 = 0.199824895698387


def cube(reflectance: Any = 0.5, exitance: Any = (0.0, 1.0, 0.0, 0.0, 0.0, 0.0), **more: Any) -> hatbox.Scene:
    """The cube with a glowing ceiling."""
    return hatbox.Scene(CUBE_VERTICES, CUBE_FACES, reflectance, exitance, **more)


def box(size: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """A box of some size, seen from inside."""
    return CUBE_VERTICES * size, CUBE_FACES
