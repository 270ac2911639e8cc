"""The native half of the package: arguments are checked before they come here."""

from collections.abc import Callable
from typing import Any, Final, final

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.uint32]
_Given = list[float] | Callable[[float, float, float], list[float]]
_Reporter = Callable[[str, int, int], None]
_Triplets = tuple[_Indices, _Indices, _Floats]

__all__ = [
    "BASES",
    "CLOSURES",
    "CONTINUITIES",
    "FORMATS",
    "OPERATORS",
    "OUTPUTS",
    "SOLVERS",
    "HatboxError",
    "Scene",
    "Solution",
    "System",
    "__version__",
    "nodes",
    "shape_functions",
    "view_factors",
]

__version__: Final[str]
BASES: Final[dict[str, str]]
"""The bases, with a line of help each."""
CLOSURES: Final[dict[str, str]]
"""How the row sums of view factors may be made right, with a line of help each."""
CONTINUITIES: Final[dict[str, str]]
"""Where functions may be joined, with a line of help each."""
FORMATS: Final[dict[str, str]]
"""Extensions of the files that scenes are read from, with a line of help each."""
OPERATORS: Final[dict[str, str]]
"""The exchange operators, with a line of help each."""
OUTPUTS: Final[dict[str, str]]
"""Extensions of the files that solutions are written to, with a line of help each."""
SOLVERS: Final[dict[str, str]]
"""The solvers, with a line of help each."""

class HatboxError(ValueError):
    """The input is wrong. The text is that of the command line: where and what is wrong, and what to do about it."""

@final
class Scene:
    def __new__(
        cls,
        vertices: _Floats,
        faces: npt.NDArray[np.int64],
        material: _Indices,
        group: _Indices,
        materials: dict[str, Any],
        group_names: list[str],
        physics: str,
        bands: int,
    ) -> Scene: ...
    @staticmethod
    def load(path: str) -> Scene: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def bands(self) -> int: ...
    @property
    def physics(self) -> str: ...
    @property
    def area(self) -> float: ...
    @property
    def material_names(self) -> list[str]: ...
    @property
    def group_names(self) -> list[str]: ...
    @property
    def reflectance(self) -> _Floats: ...
    @property
    def exitance(self) -> _Floats: ...
    @property
    def vertices(self) -> _Floats: ...
    @property
    def cells(self) -> _Indices: ...
    @property
    def material(self) -> _Indices: ...
    @property
    def group(self) -> _Indices: ...
    @property
    def surface(self) -> _Indices: ...

@final
class System:
    def __new__(
        cls,
        scene: Scene,
        settings: dict[str, Any],
        elements: int | None,
        max_edge: float | None,
        threads: int | None,
        reporter: _Reporter | None,
    ) -> System: ...
    @staticmethod
    def adapted(
        scene: Scene,
        settings: dict[str, Any],
        solver: str,
        error_points: int,
        max_unknowns: int | None,
        focus: str | list[list[float]] | None,
        gather: bool,
        threads: int | None,
        reporter: _Reporter | None,
    ) -> tuple[System, Solution]: ...
    def solve(
        self, solver: str, error_points: int, gather: bool, threads: int | None, reporter: _Reporter | None
    ) -> Solution: ...
    def with_materials(self, reflectance: list[_Given | None], exitance: list[_Given | None], bands: int) -> System: ...
    @property
    def new_lamps(self) -> list[str]: ...
    @property
    def scene(self) -> Scene: ...
    @property
    def dofs(self) -> tuple[int, int]: ...
    @property
    def offsets(self) -> npt.NDArray[np.uint64]: ...
    @property
    def nodes(self) -> _Floats: ...
    def mass(self) -> _Triplets: ...
    def reflectance_mass(self, band: int) -> _Triplets: ...
    def continuity(self) -> _Triplets | None: ...
    def load(self) -> _Floats: ...
    def exchange(self, x: _Floats) -> _Floats: ...
    def pair_block(self, i: int, j: int, tolerance: float) -> tuple[_Floats, float, float]: ...

@final
class Solution:
    @staticmethod
    def load(path: str) -> Solution: ...
    def save(self, path: str, threads: int | None, reporter: _Reporter | None) -> None: ...
    def certify(self, threads: int | None, reporter: _Reporter | None) -> tuple[float, float, float, int]: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def radiosity(self) -> _Floats: ...
    @property
    def irradiance(self) -> _Floats: ...
    @property
    def coefficients(self) -> _Floats: ...
    @property
    def scene(self) -> Scene: ...
    @property
    def basis(self) -> str: ...
    @property
    def offsets(self) -> npt.NDArray[np.uint64]: ...
    @property
    def nodes(self) -> _Floats: ...
    @property
    def report(self) -> str | None: ...
    def probe(
        self, points: _Floats, normals: _Floats, direct: bool, gather: bool, seed: int, threads: int | None
    ) -> tuple[_Floats, _Floats, list[str]]: ...
    def bake(self, irradiance: bool) -> tuple[_Floats, _Floats, _Indices, _Floats]: ...

def view_factors(
    scene: Scene,
    groups: bool,
    elements: int | None,
    max_edge: float | None,
    tolerance: float,
    closure: str,
    threshold: float,
    memory: int | None,
    seed: int,
    threads: int | None,
    reporter: _Reporter | None,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], _Floats, _Floats, list[str]]: ...
def nodes(basis: str, shape: str) -> _Floats: ...
def shape_functions(basis: str, points: _Floats, shape: str) -> _Floats: ...
