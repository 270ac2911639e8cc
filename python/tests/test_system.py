"""The pieces of the system, with SciPy as the second way to the same numbers."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.sparse.linalg import LinearOperator, aslinearoperator, gmres, splu

import hatbox
from shapes import C_11, SQUARE_FACES, SQUARES, cube

BASES = list(hatbox.BASES)


def system(basis: str = "linear", **options: object) -> hatbox.System:
    return hatbox.System(cube(), basis, **{"elements": 60, "tolerance": 1e-4, **options})  # type: ignore[arg-type]


@pytest.mark.parametrize("basis", BASES)
def test_scipy_solves_the_same_equation(basis: str) -> None:
    pieces = system(basis)
    # Δ b = b⁰ + M_R Δ⁻¹ S b, tested with the joined functions.
    mass, continuity, load = pieces.mass, pieces.continuity, pieces.load[:, 0]
    inverse, paint, exchange = splu(mass.tocsc()).solve, pieces.reflectance_mass(), pieces.exchange

    def equation(b: np.ndarray) -> np.ndarray:
        broken = continuity @ b
        return continuity.T @ (mass @ broken - paint @ inverse(exchange @ broken))

    size = pieces.dofs
    found, info = gmres(
        LinearOperator((size, size), matvec=equation, dtype=float), continuity.T @ load, rtol=1e-12, atol=0.0
    )
    assert info == 0
    expected = pieces.solve(error_points=0)
    np.testing.assert_allclose(found, expected.coefficients[:, 0], rtol=1e-8, atol=1e-9)
    irradiance = inverse(exchange @ (continuity @ found))
    np.testing.assert_allclose(irradiance, expected.irradiance[:, 0], rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("basis", BASES)
def test_the_exchange_operator_is_symmetric_and_closed(basis: str) -> None:
    pieces = system(basis)
    ones = np.ones(pieces.broken_dofs)
    np.testing.assert_allclose(pieces.exchange @ ones, pieces.mass @ ones, atol=1e-10)
    rng = np.random.default_rng(1)
    x, y = rng.standard_normal((2, pieces.broken_dofs))
    assert x @ (pieces.exchange @ y) == pytest.approx(y @ (pieces.exchange @ x), rel=1e-12)
    assert x @ (pieces.exchange.T @ y) == pytest.approx(y @ (pieces.exchange @ x), rel=1e-12)


def test_the_exchange_operator_takes_blocks_of_columns_in_any_layout() -> None:
    pieces = system()
    exchange = aslinearoperator(pieces.exchange)
    block = np.random.default_rng(2).standard_normal((pieces.broken_dofs, 6))
    columns = np.column_stack([exchange @ block[:, k] for k in range(6)])
    np.testing.assert_array_equal(exchange @ block, columns)
    np.testing.assert_array_equal(exchange @ np.asfortranarray(block), columns)
    np.testing.assert_array_equal(exchange @ block[:, ::2], columns[:, ::2])
    with pytest.raises(ValueError, match="dimension"):
        exchange @ np.zeros(pieces.broken_dofs + 1)


@pytest.mark.parametrize("basis", BASES)
def test_masses_and_loads_integrate(basis: str) -> None:
    pieces = system(basis)
    assert pieces.mass.sum() == pytest.approx(6.0)
    assert pieces.reflectance_mass().sum() == pytest.approx(3.0)
    assert pieces.load.sum() == pytest.approx(1.0)
    assert abs(pieces.mass - pieces.mass.T).max() < 1e-15
    joined = pieces.continuity.T @ pieces.mass @ pieces.continuity
    assert joined.sum() == pytest.approx(6.0)
    assert np.linalg.eigvalsh(joined.toarray()).min() > 0


def test_a_given_load_is_the_integral_of_the_function() -> None:
    pieces = system().with_materials(exitance=lambda p: p[:, 0] * p[:, 1])
    # A load of functions that sum to 1 sums to the integral: ∫xy over floor, ceiling and the walls x = 1 and y = 1.
    assert pieces.load.sum() == pytest.approx(2 * 0.25 + 2 * 0.5, rel=1e-9)
    linear = system().with_materials(exitance=lambda p: 1 + p[:, 2])
    nodal = linear.mass @ (1 + linear.nodes[:, 2])
    np.testing.assert_allclose(linear.load[:, 0], nodal, atol=1e-12)


@pytest.mark.parametrize("basis", [name for name in BASES if name != "quadratic"])
def test_a_single_pair_has_howells_view_factor(basis: str) -> None:
    scene = hatbox.Scene(SQUARES, SQUARE_FACES)
    pieces = hatbox.System(scene, basis, continuity="broken", elements=1, tolerance=1e-4)
    cells = len(pieces.offsets) - 1
    first = [c for c in range(cells) if pieces.scene.surface[c] == 0]
    second = [c for c in range(cells) if pieces.scene.surface[c] == 1]
    blocks = [pieces.pair_block(i, j, 1e-8) for i in first for j in second]
    assert sum(block.values.sum() for block in blocks) == pytest.approx(C_11, abs=1e-7)
    assert all(block.visibility_error == 0 for block in blocks)
    back = pieces.pair_block(second[0], first[0], 1e-8)
    np.testing.assert_allclose(back.values, blocks[0].values.T, atol=1e-9)
    assert not pieces.pair_block(0, 0).values.any()


@pytest.mark.parametrize(("i", "j"), [(-1, 0), (0, 10**6)])
def test_cells_that_do_not_exist_are_index_errors(i: int, j: int) -> None:
    with pytest.raises(IndexError):
        system().pair_block(i, j)


def test_bands_that_do_not_exist_are_index_errors() -> None:
    for band in (-1, 1):
        with pytest.raises(IndexError):
            system().reflectance_mass(band)


@pytest.mark.parametrize("basis", BASES)
def test_shape_functions_are_nodal_and_sum_to_one(basis: str) -> None:
    for shape in ("triangle", "quad"):
        try:
            nodes = hatbox.element_nodes(basis, shape)
        except hatbox.HatboxError as error:
            assert "basis on quads" in str(error)
            continue
        np.testing.assert_allclose(hatbox.shape_functions(basis, nodes, shape), np.eye(len(nodes)), atol=1e-14)
        points = np.random.default_rng(3).uniform(0, 0.5, (20, 2))
        np.testing.assert_allclose(hatbox.shape_functions(basis, points, shape).sum(axis=1), 1.0)


def test_a_system_shares_its_operator_with_its_repaints() -> None:
    pieces = system()
    other = pieces.with_materials(reflectance=0.9, exitance=[[1.0, 0.5, 0.2]])
    x = np.random.default_rng(4).standard_normal(pieces.broken_dofs)
    np.testing.assert_array_equal(pieces.exchange @ x, other.exchange @ x)
    assert other.scene.bands == 3
    assert pieces.scene.bands == 1


def test_a_lamp_that_was_dark_when_rays_were_cast_is_named() -> None:
    def lit_on(operator: str) -> hatbox.System:
        # Of the cube's faces the second shines.
        return system(operator=operator).with_materials(exitance=[[3.0], [0.0]] + [[0.0]] * 4)

    with pytest.warns(hatbox.HatboxWarning, match="was dark when the operator was built"):
        lit_on("sampled")
    lit_on("dense")


def test_many_lamps_that_were_dark_are_one_warning() -> None:
    dark = system(operator="sampled")
    with pytest.warns(hatbox.HatboxWarning) as caught:
        dark.with_materials(exitance=[[3.0]] * 6)
    assert len(caught) == 1
    assert re.search("materials .* and 2 more were dark", str(caught[0].message))
