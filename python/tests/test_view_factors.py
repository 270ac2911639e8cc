"""View factors against closed forms, and what holds for all of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hatbox
from shapes import C_11, CUBE_FACES, CUBE_VERTICES, SQUARE_FACES, SQUARES, box

sides = st.floats(0.2, 5.0)


@given(sides, sides, sides, st.sampled_from([1e-2, 1e-5]))
def test_closed_boxes_close_and_are_reciprocal(x: float, y: float, z: float, tolerance: float) -> None:
    vertices, faces = box(np.array([x, y, z]))
    factors = hatbox.view_factors(vertices, faces, tolerance=tolerance).toarray()
    np.testing.assert_allclose(factors.sum(axis=1), 1.0, atol=tolerance)
    areas = np.array([x * y, x * y, x * z, x * z, y * z, y * z])
    exchanged = areas[:, None] * factors
    np.testing.assert_allclose(exchanged, exchanged.T, rtol=1e-12, atol=1e-15)
    assert (factors >= 0).all()


@pytest.mark.parametrize(("size", "tolerance"), [((3.0, 0.5, 0.25), 0.01), ((2.0, 5.0, 1.30078125), 1e-5)])
def test_the_tolerance_is_met_where_long_rectangles_touch(size: tuple[float, float, float], tolerance: float) -> None:
    factors = hatbox.view_factors(*box(np.array(size)), tolerance=tolerance).toarray()
    np.testing.assert_allclose(factors.sum(axis=1), 1.0, atol=tolerance)


@settings(max_examples=5)
@given(st.permutations(range(6)), st.integers(0, 2**32 - 1))
def test_the_order_of_faces_and_their_place_in_space_do_not_matter(order: list[int], seed: int) -> None:
    rotation = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    moved = hatbox.view_factors(CUBE_VERTICES @ rotation.T + 3.0, CUBE_FACES[order], tolerance=1e-5).toarray()
    plain = hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, tolerance=1e-5).toarray()
    np.testing.assert_allclose(moved, plain[np.ix_(order, order)], atol=1e-5)


@pytest.mark.parametrize(("gap", "exact"), [(1.0, C_11), (0.5, 0.415253283577147), (0.1, 0.826994522397257)])
def test_parallel_squares(gap: float, exact: float) -> None:
    factors = hatbox.view_factors(SQUARES * [1, 1, gap], SQUARE_FACES, tolerance=1e-7)
    assert factors[0, 1] == pytest.approx(exact, abs=1e-6)
    assert factors.shape == (2, 2)


def test_a_blocker_over_half_the_sight_hides_half() -> None:
    blocker = np.array([[0, 0, 0.5], [0.5, 0, 0.5], [0.5, 1, 0.5], [0, 1, 0.5]])
    factors = hatbox.view_factors(
        np.vstack([SQUARES, blocker]), np.vstack([SQUARE_FACES, [[8, 9, 10, 11]]]), tolerance=1e-3
    )
    assert factors[0, 1] == pytest.approx(C_11 / 2, abs=2e-3 * C_11)


def test_groups_add_up_their_faces() -> None:
    single = hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, tolerance=1e-5).toarray()
    names = ["floor", "ceiling", "wall", "wall", "wall", "wall"]
    grouped = hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, names, tolerance=1e-5).toarray()
    assert grouped.shape == (3, 3)
    assert grouped[0, 1] == pytest.approx(single[0, 1], rel=1e-12)
    assert grouped[0, 2] == pytest.approx(single[0, 2:].sum(), rel=1e-12)
    assert grouped[2, 2] == pytest.approx(single[2:, 2:].sum() / 4, rel=1e-12)
    numbers = hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, [0, 1, 2, 2, 2, 2], tolerance=1e-5).toarray()
    np.testing.assert_array_equal(numbers, grouped)


def test_subdividing_does_not_change_between_what_the_factors_are() -> None:
    coarse = hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, tolerance=1e-5).toarray()
    fine = hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, elements=96, tolerance=1e-5).toarray()
    np.testing.assert_allclose(fine, coarse, atol=1e-4)


def test_a_face_without_area_has_an_empty_row() -> None:
    faces = np.vstack([SQUARE_FACES[:1], [[0, 1, 1, 1]], SQUARE_FACES[1:]])
    with pytest.warns(hatbox.HatboxWarning, match="no area"):
        factors = hatbox.view_factors(SQUARES, faces, tolerance=1e-5).toarray()
    assert factors.shape == (3, 3)
    assert factors[0, 2] == pytest.approx(C_11, rel=1e-4)
    assert not factors[1].any()
    assert not factors[:, 1].any()


def test_both_sides_of_a_sheet_are_one_row() -> None:
    # A sheet half-way between the squares is seen by both.
    sheet = SQUARES[:4] + [0, 0, 0.5]
    vertices, faces = np.vstack([SQUARES, sheet]), np.vstack([SQUARE_FACES, [[8, 9, 10, 11]]])
    factors = hatbox.view_factors(vertices, faces, two_sided=True, tolerance=1e-5).toarray()
    assert factors[0, 1] == 0
    # Half of what a sheet sends leaves by each side.
    assert factors[0, 2] == pytest.approx(0.415253283577147 / 2, rel=1e-4)
    assert factors[2, 0] == pytest.approx(0.415253283577147 / 2, rel=1e-4)


def test_triangles_and_quads_agree() -> None:
    triangles = np.vstack([CUBE_FACES[:, [0, 1, 2]], CUBE_FACES[:, [0, 2, 3]]])
    groups = np.tile(np.arange(6), 2)
    split = hatbox.view_factors(CUBE_VERTICES, triangles, groups, tolerance=1e-5).toarray()
    whole = hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, tolerance=1e-5).toarray()
    np.testing.assert_allclose(split, whole, atol=1e-4)


@pytest.mark.parametrize("closure", [name for name in hatbox.CLOSURES if name != "none"])
def test_a_closure_makes_row_sums_right(closure: str) -> None:
    factors = hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, tolerance=0.01, elements=100, closure=closure)
    np.testing.assert_allclose(factors.sum(axis=1), 1.0, atol=1e-9)


def test_a_threshold_leaves_small_pairs_out() -> None:
    vertices, faces = box(np.array([10.0, 1.0, 1.0]))
    whole = hatbox.view_factors(vertices, faces)
    thin = hatbox.view_factors(vertices, faces, threshold=0.01)
    assert thin.nnz < whole.nnz
    np.testing.assert_allclose(thin.sum(axis=1), whole.sum(axis=1), atol=1e-6)
    with pytest.raises(hatbox.HatboxError, match="threshold"):
        hatbox.view_factors(vertices, faces, threshold=2.0)
    with pytest.raises(hatbox.HatboxError, match="there is no closure"):
        hatbox.view_factors(vertices, faces, closure="magic")
