"""Scenes: from files, and from arrays."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from . import _native as native_module
from ._arrays import indices, quads, vectors
from ._materials import Given, Quantity, spread
from ._native import HatboxError

Names = Sequence[str]
_T = TypeVar("_T", bound=np.generic)
_DEFAULTS: dict[str, Given] = {"reflectance": [0.5], "exitance": [0.0]}


class HatboxWarning(UserWarning):
    """Something about the input that was repaired or passed over, or that makes a result doubtful."""


class Scene:
    """A mesh and what it is made of.

    Args:
        vertices: Positions in metres, shape (V, 3). They may be duplicated; vertices at one place are welded.
        faces: Indices of vertices, shape (F, 3) for triangles or (F, 4) for quads, counter-clockwise when seen from the
            lit side. A triangle among quads repeats its last index.
        reflectance: R, between 0 and 1. A number; an array of the shape (M,), (1, bands) or (M, bands) with a row per
            material; a function of points (n, 3) that returns (n,) or (n, bands); or a mapping from the names of
            materials to a number, to numbers per band, or to a function. What a mapping leaves out is 0.5.
        exitance: B⁰ in lm/m² or W/m², in the same ways. What a mapping leaves out is 0.
        materials: The material of each face, shape (F,): indices into the rows of the above, or names. If it is not
            given, all faces are of one material, or, if arrays have a row for each face, every face of its own.
        groups: The group (part) of each face, shape (F,): indices or names. One group if not given.
        two_sided: Whether both sides of faces send and receive: one answer, one per material, or a mapping from names.
        physics: "light" (lm/m², lx) or "heat" (W/m²); it changes names of units only.

    Raises:
        HatboxError: A wrong shape, an index out of range, a position that is not finite, nothing with an area, a
            reflectance or exitance that is impossible.
        TypeError: An array of something else than numbers.

    A function is called with one point at a time in the course of the work, from any thread; what it raises, the work
    raises.
    """

    _native: native_module.Scene

    def __init__(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        reflectance: Quantity = 0.5,
        exitance: Quantity = 0.0,
        materials: npt.ArrayLike | Names | None = None,
        *,
        groups: npt.ArrayLike | Names | None = None,
        two_sided: bool | Sequence[bool] | Mapping[str, bool] = False,
        physics: str = "light",
    ) -> None:
        if physics not in ("light", "heat"):
            raise HatboxError(f"physics `{physics}` is neither `light` nor `heat`")
        positions, corners = vectors("vertices", vertices, "V"), quads(faces)
        count = len(corners)
        if materials is None:
            material, names = _implied(count, [reflectance, exitance, two_sided])
        else:
            material, names = _labels("materials", materials, count, _rows(reflectance, exitance, two_sided))
        group, group_names = _labels("groups", groups, count) if groups is not None else _implied(count, [])
        place = positions[corners[0, 0]] if count and 0 <= corners[0, 0] < len(positions) else np.zeros(3)
        table, bands = _table(names, reflectance, exitance, place)
        table["two_sided"] = _sides(two_sided, names)
        native = native_module.Scene(positions, corners, material, group, table, group_names, physics, bands)
        self._native = native
        _warn(native.warnings)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scene:
        """Reads a scene; the format follows the extension (see `hatbox.FORMATS`).

        What had to be repaired or passed over is a `HatboxWarning` and stands in `warnings`.

        Raises:
            HatboxError: What is wrong with the file, where in it, and what to do.
        """
        native = native_module.Scene.load(os.fspath(path))
        _warn(native.warnings)
        return cls._of(native)

    @classmethod
    def _of(cls, native: native_module.Scene) -> Scene:
        scene = cls.__new__(cls)
        scene._native = native
        return scene

    @property
    def warnings(self) -> list[str]:
        """What was repaired or passed over in the input, a sentence each."""
        return self._native.warnings

    @property
    def bands(self) -> int:
        """Number of bands."""
        return self._native.bands

    @property
    def physics(self) -> str:
        """Either "light" or "heat"."""
        return self._native.physics

    @property
    def area(self) -> float:
        """Area of all sides that send and receive, in m²; a two-sided sheet counts twice."""
        return self._native.area

    @cached_property
    def material_names(self) -> list[str]:
        """Names of the M materials."""
        return self._native.material_names

    @cached_property
    def group_names(self) -> list[str]:
        """Names of the groups (parts, objects)."""
        return self._native.group_names

    @cached_property
    def reflectance(self) -> npt.NDArray[np.float64]:
        """R per material and band, shape (M, bands); NaN where it varies over the surface."""
        return _frozen(self._native.reflectance)

    @cached_property
    def exitance(self) -> npt.NDArray[np.float64]:
        """B⁰ per material and band in lm/m² or W/m², shape (M, bands); NaN where it varies over the surface."""
        return _frozen(self._native.exitance)

    @cached_property
    def vertices(self) -> npt.NDArray[np.float64]:
        """Positions in metres, shape (V, 3), welded."""
        return _frozen(self._native.vertices)

    @cached_property
    def cells(self) -> npt.NDArray[np.uint32]:
        """Corners of the N cells, shape (N, 4), counter-clockwise from the lit side; a triangle repeats its last."""
        return _frozen(self._native.cells)

    @cached_property
    def material(self) -> npt.NDArray[np.uint32]:
        """Index of each cell's material, shape (N,)."""
        return _frozen(self._native.material)

    @cached_property
    def group(self) -> npt.NDArray[np.uint32]:
        """Index of each cell's group, shape (N,)."""
        return _frozen(self._native.group)

    @cached_property
    def surface(self) -> npt.NDArray[np.uint32]:
        """Index of the opaque face of the input that each cell is a part of, shape (N,)."""
        return _frozen(self._native.surface)

    def __repr__(self) -> str:
        return f"<hatbox.Scene: {len(self.cells)} cells, {self.area:.4g} m², {self.bands} bands>"


def _frozen(array: npt.NDArray[_T]) -> npt.NDArray[_T]:
    array.flags.writeable = False
    return array


def _warn(texts: list[str]) -> None:
    for text in texts:
        warnings.warn(text, HatboxWarning, stacklevel=3)


def _rows(*values: Any) -> int:
    """How many rows the longest array among the values has."""
    arrays = [np.asarray(value) for value in values if not callable(value) and not isinstance(value, Mapping)]
    return max((array.shape[0] for array in arrays if array.ndim), default=1)


def _implied(count: int, values: list[Any]) -> tuple[npt.NDArray[np.uint32], list[str]]:
    """One material for all faces, or one for each if an array has a row for each."""
    if _rows(*values) == count and count > 1:
        return np.arange(count, dtype=np.uint32), [f"face {k}" for k in range(count)]
    return np.zeros(count, dtype=np.uint32), ["default"]


def _labels(what: str, value: Any, count: int, rows: int = 1) -> tuple[npt.NDArray[np.uint32], list[str]]:
    """Indices and names of what each face belongs to."""
    array = np.asarray(value)
    if array.shape != (count,):
        raise HatboxError(f"{what}: the shape is {array.shape}, but ({count},) is needed: one for each face")
    if array.dtype.kind == "U":
        names = list(dict.fromkeys(array.tolist()))
        number = {name: index for index, name in enumerate(names)}
        return np.array([number[name] for name in array.tolist()], dtype=np.uint32), names
    index = indices(what, array)
    if index.size and index.min() < 0:
        raise HatboxError(f"{what}: {index.min()} is no index; they are counted from 0")
    length = max(int(index.max(initial=0)) + 1, rows)
    if length > 2**32 - 1:
        raise HatboxError(f"{what}: {length - 1} is too great for an index")
    return index.astype(np.uint32), [str(k) for k in range(length)]


def _table(
    names: Names, reflectance: Quantity, exitance: Quantity, place: npt.NDArray[np.float64]
) -> tuple[dict[str, Any], int]:
    """The materials as the native module takes them, and the number of bands."""
    table: dict[str, Any] = {"names": list(names)}
    most = 1
    for what, value in (("reflectance", reflectance), ("exitance", exitance)):
        given, bands = spread(what, value, names, place)
        table[what] = [_DEFAULTS[what] if entry is None else entry for entry in given]
        most = max(most, bands)
    return table, most


def _sides(two_sided: bool | Sequence[bool] | Mapping[str, bool], names: Names) -> list[bool]:
    if isinstance(two_sided, Mapping):
        return [bool(two_sided.get(name, False)) for name in names]
    array = np.asarray(two_sided)
    if array.dtype != np.bool_ or array.shape not in ((), (len(names),)):
        raise HatboxError(f"two_sided: it must be True, False, or {len(names)} of these, one for each material")
    return [bool(side) for side in np.broadcast_to(array, len(names))]
