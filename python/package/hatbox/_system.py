"""The finite-element system, piece by piece: for those who want more than its solution."""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.linalg import LinearOperator

from . import _native as native_module
from ._arrays import count, numbers, subdivision
from ._arrays import tolerance as checked_tolerance
from ._materials import Quantity, spread
from ._native import HatboxError
from ._progress import bar
from ._scene import Scene, _warn

if TYPE_CHECKING:
    from ._solution import Solution

# Elements of a solve that is not told how many.
_ELEMENTS = 3000
# Names of a list that are told.
_NAMED = 3


class PairBlock(NamedTuple):
    """The block S_ij of two cells, in m²."""

    values: npt.NDArray[np.float64]
    """∬ N_k N_l G V, shape (functions of cell i, functions of cell j)."""
    quadrature_error: float
    """Estimated error of its sum from quadrature, in m²."""
    visibility_error: float
    """Estimated error of its sum from sampled visibility, in m²."""


class System:
    """The equation Δ b = b⁰ + M_R Δ⁻¹ S b on a scene: what does not depend on the light is computed once.

    Everything is written in the *broken* space, where cells share nothing and every cell has coefficients of its own:
    the values at its nodes. Continuity is a sparse matrix C: `C.T @ Δ @ C` is the mass matrix of the joined space.

    Args:
        scene: The scene.
        basis: A name of `hatbox.BASES`.
        continuity: A name of `hatbox.CONTINUITIES`.
        elements: Subdivide to about so many elements; 3000 if neither this nor `max_edge` is given.
        max_edge: Subdivide until no edge is longer, in metres.
        tolerance: Relative error that form factors and visibility may have, between 0 and 1.
        operator: "auto" or a name of `hatbox.OPERATORS`.
        grading: Vertices of the subdivision are at t^q from the edges of faces, this being q: finer there, where light
            varies most. 2 suits linear and 3 quadratic functions.
        memory: The most bytes that the operator may store; 16 GiB if not given.
        checkpoint: A file that keeps finished work, from which the same work goes on if it exists: after a crash, an
            interrupt or a kill, with the same result. Rays are kept, which are most of the work of a large scene. It is
            removed when the system has been solved for the first time.
        seed: Seed of everything that is sampled.
        threads: Number of threads, here and in all that is done with the system; as many as there are processors if not
            given. No result depends on it.
        progress: Whether a bar is drawn, where there is a terminal or a notebook to draw it in.

    Raises:
        HatboxError: A name that is in no list, a tolerance or subdivision that is impossible, too many unknowns, a
            checkpoint of other work or one that cannot be written.
        KeyboardInterrupt: Ctrl-C.
    """

    _native: native_module.System

    def __init__(
        self,
        scene: Scene,
        basis: str = "linear",
        *,
        continuity: str = "continuous",
        elements: int | None = None,
        max_edge: float | None = None,
        tolerance: float = 0.01,
        operator: str = "auto",
        grading: float = 1.0,
        memory: int | None = None,
        checkpoint: str | os.PathLike[str] | None = None,
        seed: int = 0,
        threads: int | None = None,
        progress: bool = False,
    ) -> None:
        elements, max_edge = subdivision(elements, max_edge)
        if elements is None and max_edge is None:
            elements = _ELEMENTS
        tolerance, threads = checked_tolerance(tolerance), count("threads", threads)
        with bar(progress) as reporter:
            settings = _settings(basis, continuity, tolerance, operator, grading, memory, seed, checkpoint)
            self._native = native_module.System(scene._native, settings, elements, max_edge, threads, reporter)

    @classmethod
    def _of(cls, native: native_module.System) -> System:
        system = cls.__new__(cls)
        system._native = native
        return system

    @cached_property
    def scene(self) -> Scene:
        """The scene, subdivided."""
        return Scene._of(self._native.scene)

    @property
    def broken_dofs(self) -> int:
        """D, the number of coefficients of the broken space."""
        return self._native.dofs[0]

    @property
    def dofs(self) -> int:
        """U, the number of unknowns: D if nothing is joined."""
        return self._native.dofs[1]

    @cached_property
    def offsets(self) -> npt.NDArray[np.uint64]:
        """Cell c has the coefficients `offsets[c]` to `offsets[c + 1]`; shape (N + 1,)."""
        return self._native.offsets

    @cached_property
    def nodes(self) -> npt.NDArray[np.float64]:
        """The points at which the coefficients are the values, in metres; shape (D, 3)."""
        return self._native.nodes

    @cached_property
    def mass(self) -> sparse.csr_array:
        """Δ_ij = ∫ N_i N_j in m², a `scipy.sparse.csr_array` of the shape (D, D)."""
        return _sparse(self._native.mass(), (self.broken_dofs, self.broken_dofs))

    def reflectance_mass(self, band: int = 0) -> sparse.csr_array:
        """(M_R)_ij = ∫ R N_i N_j in m², a `scipy.sparse.csr_array` of the shape (D, D).

        Raises:
            IndexError: There is no such band.
        """
        return _sparse(self._native.reflectance_mass(_index(band)), (self.broken_dofs, self.broken_dofs))

    @cached_property
    def continuity(self) -> sparse.csr_array:
        """C, broken coefficients from joined ones: a `scipy.sparse.csr_array` of the shape (D, U)."""
        entries = self._native.continuity()
        if entries is None:
            return sparse.csr_array(sparse.eye_array(self.broken_dofs))
        return _sparse(entries, (self.broken_dofs, self.dofs))

    @cached_property
    def load(self) -> npt.NDArray[np.float64]:
        """b⁰_i = ∫ B⁰ N_i in lm or W, shape (D, bands)."""
        return self._native.load().T

    @property
    def exchange(self) -> LinearOperator:
        """S_ij = ∬ N_i N_j G V in m², symmetric, as a `scipy.sparse.linalg.LinearOperator` of the shape (D, D).

        It holds no material. In a closed scene its row sums are those of Δ.
        """
        return _Exchange(self._native, self.broken_dofs)

    def pair_block(self, i: int, j: int, tolerance: float = 1e-6) -> PairBlock:
        """The block S_ij of the cells i and j, integrated afresh to a relative tolerance of its own.

        Raises:
            IndexError: There is no such cell.
        """
        return PairBlock(*self._native.pair_block(_index(i), _index(j), checked_tolerance(tolerance)))

    def with_materials(self, reflectance: Quantity | None = None, exitance: Quantity | None = None) -> System:
        """The system of the same cells in other materials, with the same operator; it takes next to no time.

        Args:
            reflectance: R as in `Scene`, with a row for each of `scene.material_names`; a mapping changes those it
                names.
            exitance: B⁰, likewise.

        Raises:
            HatboxError: As `Scene` does.

        A sampled operator has the lamps for which it was built: how finely shadows are sampled follows them, and the
        light of materials that were dark then is left to rays, which is noisy (a `HatboxWarning`). Build with all lamps
        lit that are to be lit one after the other. The estimated error tells whether what was built will do.
        """
        names, place = self.scene.material_names, self.nodes[0]
        keep = spread("reflectance", {}, names, place)
        paints, a = keep if reflectance is None else spread("reflectance", reflectance, names, place)
        lamps, b = keep if exitance is None else spread("exitance", exitance, names, place)
        native = self._native.with_materials(paints, lamps, max(a, b))
        _warn(_dark_before(native.new_lamps))
        return System._of(native)

    def solve(
        self,
        *,
        solver: str = "auto",
        error_points: int = 512,
        gather: bool = False,
        threads: int | None = None,
        progress: bool = False,
    ) -> Solution:
        """Solves for the emission of the scene.

        Args:
            solver: "auto" or a name of `hatbox.SOLVERS`.
            error_points: Number of points at which the error is estimated, at the least; with 0 it stays unknown.
            gather: Whether the light is gathered once more at the nodes: sharper shadows, half an order more accurate.
            threads: Number of threads; that of the system if not given.
            progress: As in `System`.

        Raises:
            HatboxError: The solver did not converge.
            KeyboardInterrupt: Ctrl-C.
        """
        from ._solution import Solution

        threads = count("threads", threads)
        with bar(progress) as reporter:
            native = self._native.solve(solver, error_points, gather, threads, reporter)
        return Solution._of(native, self)

    def __repr__(self) -> str:
        return f"<hatbox.System: {len(self.offsets) - 1} elements, {self.dofs} unknowns>"


class _Exchange(LinearOperator):  # type: ignore[misc]
    """S, applied by the native module to all columns in one pass."""

    def __init__(self, system: native_module.System, size: int) -> None:
        super().__init__(np.dtype(np.float64), (size, size))
        self._system = system

    def _matmat(self, x: Any) -> Any:
        columns = np.ascontiguousarray(numbers("x", x).T)
        return self._system.exchange(columns).T

    def _matvec(self, x: Any) -> Any:
        return self._matmat(np.reshape(x, (-1, 1)))[:, 0]

    def _adjoint(self) -> _Exchange:
        return self


def element_nodes(basis: str, shape: str = "triangle") -> npt.NDArray[np.float64]:
    """The reference coordinates of an element's nodes, shape (functions, 2).

    The reference triangle is (0,0), (1,0), (0,1); the reference quad is the unit square, counter-clockwise from (0,0).

    Args:
        basis: A name of `hatbox.BASES`.
        shape: "triangle" or "quad".

    Raises:
        HatboxError: There is no such basis, or it has no element of that shape.
    """
    return native_module.nodes(basis, shape)


def shape_functions(basis: str, points: npt.ArrayLike, shape: str = "triangle") -> npt.NDArray[np.float64]:
    """N_k at points of the reference cell, shape (n, functions).

    Args:
        basis: A name of `hatbox.BASES`.
        points: Reference coordinates, shape (n, 2).
        shape: "triangle" or "quad".

    Raises:
        HatboxError: There is no such basis, it has no element of that shape, or the shape of `points` is another.
    """
    array = numbers("points", points)
    if array.ndim != 2 or array.shape[1] != 2:
        raise HatboxError(f"points: the shape is {array.shape}, but (n, 2) is needed")
    return native_module.shape_functions(basis, array, shape)


def _settings(
    basis: str,
    continuity: str,
    tolerance: float,
    operator: str,
    grading: float,
    memory: int | None,
    seed: int,
    checkpoint: str | os.PathLike[str] | None,
) -> dict[str, Any]:
    """What the native module needs to know of every system."""
    if not 1.0 <= grading <= 8.0:
        raise HatboxError(f"grading {grading}: it must lie between 1 and 8")
    return {
        "basis": basis,
        "continuity": continuity,
        "tolerance": tolerance,
        "operator": operator,
        "grading": float(grading),
        "memory": count("memory", memory),
        "seed": seed,
        "checkpoint": None if checkpoint is None else os.fspath(checkpoint),
    }


def _index(index: int) -> int:
    if index < 0:
        raise IndexError(f"{index} is no index; they are counted from 0")
    return index


def _sparse(entries: tuple[Any, Any, Any], shape: tuple[int, int]) -> sparse.csr_array:
    rows, columns, values = entries
    return sparse.csr_array((values, (rows, columns)), shape=shape)


def _dark_before(names: list[str]) -> list[str]:
    """What is said of materials that were dark when the operator was built."""
    if not names:
        return []
    some = ", ".join(f"`{name}`" for name in names[:_NAMED])
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    subject, their = (f"material {some} was", "its") if len(names) == 1 else (f"materials {some}{more} were", "their")
    return [
        f"{subject} dark when the operator was built: {their} light is left to rays, and may be noisy; "
        "build with all lamps lit, and dim them afterwards"
    ]
