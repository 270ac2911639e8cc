"""Arguments as arrays, checked: what comes out is what the native module takes, and is not copied if it was that."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ._native import HatboxError

Floats = npt.NDArray[np.float64]


def numbers(what: str, value: Any) -> Floats:
    """`value` as float64 in C order; `TypeError` if it does not consist of real numbers."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{what}: the type is {array.dtype}, but real numbers are needed")
    return np.ascontiguousarray(array, dtype=np.float64) if array.ndim else array.astype(np.float64)


def vectors(what: str, value: Any, rows: str = "n") -> Floats:
    """`value` as float64 of the shape (n, 3)."""
    array = numbers(what, value)
    if array.ndim != 2 or array.shape[1] != 3:
        raise HatboxError(f"{what}: the shape is {array.shape}, but ({rows}, 3) is needed")
    return array


def indices(what: str, value: Any) -> npt.NDArray[np.int64]:
    """`value` as int64 in C order; `TypeError` if it does not consist of whole numbers."""
    array = np.asarray(value)
    if array.size == 0:
        array = array.astype(np.int64)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{what}: the type is {array.dtype}, but whole numbers are needed")
    if array.dtype == np.uint64 and array.size and array.max() > np.iinfo(np.int64).max:
        raise HatboxError(f"{what}: {array.max()} is too great for an index")
    return np.ascontiguousarray(array, dtype=np.int64)


def quads(value: Any) -> npt.NDArray[np.int64]:
    """Faces of the shape (F, 3) or (F, 4) as (F, 4), triangles with their last index repeated."""
    faces = indices("faces", value)
    if faces.size == 0:
        return faces.reshape(0, 4)
    if faces.ndim != 2 or faces.shape[1] not in (3, 4):
        raise HatboxError(f"faces: the shape is {faces.shape}, but (F, 3) or (F, 4) is needed")
    return faces if faces.shape[1] == 4 else np.ascontiguousarray(faces[:, [0, 1, 2, 2]])


def tolerance(value: float) -> float:
    """A relative error that is asked for."""
    value = float(value)
    if not 0.0 < value < 1.0:
        raise HatboxError(f"tolerance {value}: it must lie between 0 and 1 (100%), such as 0.01")
    return value


def count(what: str, value: int | None) -> int | None:
    """A number of things, if it is given."""
    if value is not None and value < 1:
        raise HatboxError(f"{what} {value}: it must be a whole number greater than 0")
    return value


def subdivision(elements: int | None, max_edge: float | None) -> tuple[int | None, float | None]:
    """How finely to subdivide: one of both, or neither."""
    if elements is not None and max_edge is not None:
        raise HatboxError("elements and max_edge are both given; give one of them")
    return count("elements", elements), None if max_edge is None else float(max_edge)
