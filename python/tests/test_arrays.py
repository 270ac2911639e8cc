"""Bad arrays: each is an exception that names the argument, and none is a crash."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import hatbox
from hatbox._arrays import quads, vectors
from shapes import CUBE_FACES, CUBE_VERTICES, SQUARE_FACES, SQUARES


def factors(vertices: Any = SQUARES, faces: Any = SQUARE_FACES, **more: Any) -> np.ndarray:
    return hatbox.view_factors(vertices, faces, tolerance=1e-4, **more).toarray()


GOOD = factors()

shapes = st.lists(st.integers(0, 4), max_size=4).map(tuple)


@given(arrays.arrays(np.float64, shapes.filter(lambda s: len(s) != 2 or s[1] != 3)))
def test_vertices_of_a_wrong_shape(vertices: np.ndarray) -> None:
    with pytest.raises(hatbox.HatboxError, match="vertices: the shape is"):
        hatbox.Scene(vertices, SQUARE_FACES)


@given(arrays.arrays(np.int64, shapes.filter(lambda s: 0 not in s and (len(s) != 2 or s[1] not in (3, 4)))))
def test_faces_of_a_wrong_shape(faces: np.ndarray) -> None:
    with pytest.raises(hatbox.HatboxError, match="faces: the shape is"):
        hatbox.Scene(SQUARES, faces)


@pytest.mark.parametrize("dtype", [complex, object, "U3", "datetime64[s]"])
def test_arrays_of_something_else_than_numbers(dtype: Any) -> None:
    wrong = np.zeros((8, 3)).astype(dtype)
    with pytest.raises(TypeError, match="vertices: the type is"):
        hatbox.Scene(wrong, SQUARE_FACES)
    with pytest.raises(TypeError, match="faces: the type is"):
        hatbox.Scene(SQUARES, wrong)
    with pytest.raises(TypeError, match="reflectance: the type is"):
        hatbox.Scene(SQUARES, SQUARE_FACES, wrong)
    with pytest.raises(TypeError, match="points: the type is"):
        hatbox.shape_functions("linear", wrong[:, :2])


def test_faces_of_floating_point_are_refused() -> None:
    with pytest.raises(TypeError, match="faces: the type is float64"):
        hatbox.Scene(SQUARES, SQUARE_FACES.astype(float))


@pytest.mark.parametrize("vertices", [np.float32, np.float16, np.int32, np.uint8, np.longdouble])
@pytest.mark.parametrize("faces", [np.int32, np.uint8, np.uint64, np.int16])
def test_numbers_of_any_type_mean_the_same(vertices: Any, faces: Any) -> None:
    np.testing.assert_array_equal(factors(SQUARES.astype(vertices), SQUARE_FACES.astype(faces)), GOOD)


def test_lists_foreign_byte_order_strides_and_read_only_arrays_mean_the_same() -> None:
    locked = SQUARES.copy()
    locked.flags.writeable = False
    every_other = np.repeat(SQUARES, 2, axis=0)[::2]
    wide = np.zeros((8, 6))
    wide[:, ::2] = SQUARES
    for vertices in [
        SQUARES.tolist(),
        np.asfortranarray(SQUARES),
        locked,
        every_other,
        wide[:, ::2],
        SQUARES.astype(">f8"),
        SQUARES[::-1][::-1],
    ]:
        np.testing.assert_array_equal(factors(vertices), GOOD)
    fixed = SQUARE_FACES.copy()
    fixed.flags.writeable = False
    for faces in [SQUARE_FACES.tolist(), np.asfortranarray(SQUARE_FACES), fixed, SQUARE_FACES.astype(">i4")]:
        np.testing.assert_array_equal(factors(SQUARES, faces), GOOD)


def test_arguments_of_the_right_type_reach_the_library_without_a_copy() -> None:
    faces = SQUARE_FACES.astype(np.int64)
    for own, taken in [(SQUARES, vectors("vertices", SQUARES)), (faces, quads(faces))]:
        assert taken.ctypes.data == own.ctypes.data
        assert np.shares_memory(taken, own)


def test_arguments_are_not_changed() -> None:
    vertices, faces = SQUARES.copy(), SQUARE_FACES.copy()
    factors(vertices, faces)
    np.testing.assert_array_equal(vertices, SQUARES)
    np.testing.assert_array_equal(faces, SQUARE_FACES)


@given(st.integers(0, 7), st.integers(0, 2), st.sampled_from([np.nan, np.inf, -np.inf]))
def test_positions_that_are_no_place(row: int, column: int, value: float) -> None:
    vertices = SQUARES.copy()
    vertices[row, column] = value
    with pytest.raises(hatbox.HatboxError, match=f"vertex {row} .* which is not a place"):
        hatbox.Scene(vertices, SQUARE_FACES)


@given(st.integers(0, 1), st.integers(0, 3), st.integers(-(2**63), -1) | st.integers(8, 2**63 - 1))
def test_indices_out_of_range(row: int, column: int, index: int) -> None:
    faces = SQUARE_FACES.copy()
    faces[row, column] = index
    with pytest.raises(hatbox.HatboxError, match=f"face {row} refers to vertex {index}, but there are only 8"):
        hatbox.Scene(SQUARES, faces)


def test_indices_beyond_signed_numbers() -> None:
    with pytest.raises(hatbox.HatboxError, match="too great for an index"):
        hatbox.Scene(SQUARES, np.full((1, 4), 2**64 - 1, dtype=np.uint64))


@pytest.mark.parametrize("faces", [[], np.empty((0, 3), int), np.empty((0, 4)), np.empty((3, 0), int)])
def test_no_faces(faces: Any) -> None:
    with pytest.raises(hatbox.HatboxError, match="the scene has no faces"):
        hatbox.Scene(SQUARES, faces)
    with pytest.raises(hatbox.HatboxError, match="the scene has no faces"):
        hatbox.view_factors(SQUARES, faces)


def test_no_vertices() -> None:
    with pytest.raises(hatbox.HatboxError, match="there are only 0"):
        hatbox.Scene(np.empty((0, 3)), SQUARE_FACES)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (-0.1, "reflects -0.1"),
        (1.1, "reflects 1.1"),
        (np.nan, "reflects NaN"),
        ([0.1, 0.2, 0.3], "the shape is"),
        (np.zeros((2, 2, 2)), "the shape is"),
        (np.zeros((2, 0)), "the shape is"),
        ({"paint": 0.5}, "there is no material `paint`"),
        ({"default": [[0.5]]}, "reflectance of `default`: the shape is"),
    ],
)
def test_reflectances_that_are_impossible(value: Any, words: str) -> None:
    with pytest.raises(hatbox.HatboxError, match=words):
        hatbox.Scene(SQUARES, SQUARE_FACES, value)


@pytest.mark.parametrize("value", [-1.0, np.inf, np.nan])
def test_exitances_that_are_impossible(value: float) -> None:
    with pytest.raises(hatbox.HatboxError, match="an exitance is a finite number and not negative"):
        hatbox.Scene(SQUARES, SQUARE_FACES, 0.5, value)


def test_bands_that_do_not_agree() -> None:
    with pytest.raises(hatbox.HatboxError, match="has 2 bands, others have 3"):
        hatbox.Scene(SQUARES, SQUARE_FACES, [[0.1, 0.2]], [[1.0, 2.0, 3.0]])


@pytest.mark.parametrize("labels", [[0], [0, 1, 2], [[0, 1]], []])
@pytest.mark.parametrize("what", ["materials", "groups"])
def test_labels_of_a_wrong_shape(what: str, labels: Any) -> None:
    with pytest.raises(hatbox.HatboxError, match=f"{what}: the shape is"):
        hatbox.Scene(SQUARES, SQUARE_FACES, **{what: labels})


@pytest.mark.parametrize("what", ["materials", "groups"])
def test_labels_that_are_no_labels(what: str) -> None:
    with pytest.raises(hatbox.HatboxError, match="-1 is no index"):
        hatbox.Scene(SQUARES, SQUARE_FACES, **{what: [0, -1]})
    with pytest.raises(TypeError, match="whole numbers are needed"):
        hatbox.Scene(SQUARES, SQUARE_FACES, **{what: [0.0, 1.0]})


def test_more_materials_than_rows() -> None:
    with pytest.raises(hatbox.HatboxError, match=r"reflectance: the shape is \(2,\)"):
        hatbox.Scene(SQUARES, SQUARE_FACES, [0.1, 0.2], materials=[0, 5])


@pytest.mark.parametrize("points", [[0.0, 0.0, 0.0], np.zeros((2, 2)), np.zeros((1, 2, 3))])
def test_points_of_a_wrong_shape(points: Any, cube_solution: hatbox.Solution) -> None:
    with pytest.raises(hatbox.HatboxError, match="points: the shape is"):
        cube_solution.probe(points, [0.0, 0.0, 1.0])


def test_normals_of_a_wrong_shape(cube_solution: hatbox.Solution) -> None:
    with pytest.raises(hatbox.HatboxError, match="normals: the shape is"):
        cube_solution.probe(np.zeros((3, 3)), np.zeros((2, 3)))


@pytest.mark.parametrize("tolerance", [0.0, 1.0, -1.0, np.nan, np.inf])
def test_tolerances_that_are_impossible(tolerance: float) -> None:
    with pytest.raises(hatbox.HatboxError, match="must lie between 0 and 1"):
        hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, tolerance=tolerance)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"elements": 0}, "elements 0"),
        ({"max_edge": 0.0}, "greatest edge length must be a positive number"),
        ({"max_edge": float("nan")}, "greatest edge length must be a positive number"),
        ({"max_edge": 1e-9}, "gives more than 50000000 cells"),
        ({"elements": 10, "max_edge": 1.0}, "both given"),
        ({"threads": 0}, "threads 0"),
        ({"memory": 0}, "memory 0"),
        ({"elements": 3000, "memory": 1_000_000}, "more than the 1 MB there are"),
        ({"elements": 100_000}, "more than the .* allowed"),
    ],
)
def test_options_that_are_impossible(options: dict[str, Any], words: str) -> None:
    with pytest.raises(hatbox.HatboxError, match=words):
        hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, **options)


def test_operators_refuse_vectors_of_another_size(cube_solution: hatbox.Solution) -> None:
    with pytest.raises(ValueError, match="is needed"):
        cube_solution.system._native.exchange(np.zeros((1, 3)))
