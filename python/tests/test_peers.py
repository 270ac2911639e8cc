"""The comparison with other programs, as far as it goes without them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benches" / "peers"))

from peers import factors, report, scenes
from peers.exact import box_factors
from peers.measure import Row, pointwise


def test_the_closed_forms_of_a_box_close_and_are_reciprocal() -> None:
    cube = scenes.cube(3)
    stretched = cube.vertices * [1.0, 2.0, 5.0]
    exact = box_factors(stretched, cube.faces)
    np.testing.assert_allclose(exact.sum(axis=1), 1.0, atol=1e-12)
    sides = np.ptp(stretched[cube.faces], axis=1)
    area = np.where(sides > 0, sides, 1.0).prod(axis=1)
    np.testing.assert_allclose(area[:, None] * exact, (area[:, None] * exact).T, atol=1e-13)


def test_the_arms_of_the_room_have_closed_forms_that_keep_to_the_rows() -> None:
    room = scenes.l_room(2)
    known = room.in_one_box()
    assert not room.convex
    sums = np.where(known, box_factors(room.vertices, room.faces), 0.0).sum(axis=1)
    # The faces of the arms' common part see nothing else; no face sees more than all.
    assert sums.max() == pytest.approx(1.0, abs=1e-12)


def test_absent_programs_are_named_and_ours_is_measured() -> None:
    absent: dict[str, str] = {}
    rows = list(factors.measure(quick=True, absent=absent))
    assert {row.tool for row in rows} == {"hatbox"}
    assert set(absent) == {"pyviewfactor", "raystrack"}
    assert all(row.errors[key] < 0.01 for row in rows for key in row.errors if key in ("L2", "relative"))


def row(tool: str, cpu: float, error: float) -> Row:
    return Row("job", tool, "", "", cpu, cpu, {"L2": error})


@pytest.mark.parametrize(
    ("cpu", "error", "verdict"),
    [(4.0, 0.01, "2 × faster"), (1.0, 0.01, "**loses**: 2 × slower"), (1.0, 0.001, "**loses**: not as accurate")],
)
def test_the_table_says_who_wins(cpu: float, error: float, verdict: str) -> None:
    ours = [row("hatbox", 2.0, 0.01), row("hatbox", 0.1, 0.5)]
    assert report.beside(row("other", cpu, error), ours) == verdict


def test_errors_are_relative() -> None:
    truth = np.array([[1.0, 0.0], [0.0, 2.0]])
    found = pointwise(1.1 * truth, truth)
    assert found == {"L2": pytest.approx(0.1), "median": pytest.approx(0.1), "95 %": pytest.approx(0.1)}
