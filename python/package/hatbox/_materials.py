"""Reflectances and exitances as users give them: numbers, arrays, functions, or a mapping from names to these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from ._arrays import numbers
from ._native import HatboxError

Function: TypeAlias = Callable[[npt.NDArray[np.float64]], npt.ArrayLike]
Value: TypeAlias = npt.ArrayLike | Function
Quantity: TypeAlias = Value | Mapping[str, Value]
Given: TypeAlias = list[float] | Callable[[float, float, float], list[float]]

_RULES = {
    "reflectance": "a reflectance is between 0 and 1",
    "exitance": "an exitance is a finite number and not negative",
}
_LIMITS = {"reflectance": 1.0, "exitance": float(np.finfo(np.float64).max)}


def spread(
    what: str, value: Quantity, names: Sequence[str], place: npt.NDArray[np.float64]
) -> tuple[list[Given | None], int]:
    """One entry per material, `None` where a mapping does not name it, and the greatest number of bands.

    `place` is a point at which functions are tried, to learn how many bands they have.
    """
    if isinstance(value, Mapping):
        strangers = [name for name in value if name not in names]
        if strangers:
            raise HatboxError(f"{what}: there is no material `{strangers[0]}`\n  help: use one of {', '.join(names)}")
        given: list[Given | None] = [None] * len(names)
        for index, name in enumerate(names):
            if name in value:
                given[index] = _single(what, name, value[name], place)
    elif callable(value):
        given = [_pointwise(what, name, value) for name in names]
    else:
        given = list(_rows(what, numbers(what, value), len(names)))
    return given, max((_bands(entry, place) for entry in given if entry is not None), default=1)


def _single(what: str, name: str, value: Value, place: npt.NDArray[np.float64]) -> Given:
    if callable(value):
        return _pointwise(what, name, value)
    array = numbers(what, value)
    if array.ndim > 1 or array.size == 0:
        raise HatboxError(f"{what} of `{name}`: the shape is {array.shape}, but () or (bands,) is needed")
    return [float(number) for number in array.reshape(-1)]


def _rows(what: str, array: npt.NDArray[np.float64], count: int) -> list[Given]:
    """One row per material; a single number or row stands for all."""
    table = array.reshape(array.shape[0], -1) if array.ndim == 1 else array.reshape(1, 1) if array.ndim == 0 else array
    if table.ndim != 2 or table.shape[1] == 0 or table.shape[0] not in (1, count):
        shapes = f"(), ({count},), (1, bands) or ({count}, bands)" if count > 1 else "() or (1, bands)"
        raise HatboxError(
            f"{what}: the shape is {array.shape}, but {shapes} is needed\n"
            "  help: give a row for all or one for each material; a scene without `materials` has one for each face "
            "if one of its arrays has a row for each"
        )
    return [[float(number) for number in row] for row in np.broadcast_to(table, (count, table.shape[1]))]


def _bands(given: Given, place: npt.NDArray[np.float64]) -> int:
    return len(given(*map(float, place)) if callable(given) else given)


def _pointwise(what: str, name: str, function: Function) -> Callable[[float, float, float], list[float]]:
    """The function at one point, with its values checked like the numbers of any material."""
    most = _LIMITS[what]

    def at(x: float, y: float, z: float) -> list[float]:
        values = np.asarray(function(np.array([[x, y, z]])), dtype=np.float64)
        if values.shape not in ((), (1,), (1, values.size)) or values.size == 0:
            raise HatboxError(
                f"{what} of `{name}`: the function returned the shape {values.shape} for one point, "
                "but (1,) or (1, bands) is needed"
            )
        values = values.reshape(-1)
        wrong = np.flatnonzero(~((values >= 0.0) & (values <= most)))
        if wrong.size:
            band = int(wrong[0])
            verb = "reflects" if what == "reflectance" else "emits"
            rule = _RULES[what]
            raise HatboxError(f"material `{name}` {verb} {values[band]} in band {band} at ({x}, {y}, {z}); {rule}")
        return [float(value) for value in values]

    return at
