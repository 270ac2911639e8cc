"""Solutions against what is known, and what can be done with them."""

from __future__ import annotations

import threading
import warnings
from pathlib import Path

import numpy as np
import pytest

import hatbox
from shapes import CUBE_FACES, CUBE_VERTICES, cube


def mean(solution: hatbox.Solution, normal: tuple[float, float, float], center: tuple[float, float, float]) -> float:
    """The mean of B over a wall of the cube, by Gauss points on a grid of sixteen squares."""
    gauss, weights = np.polynomial.legendre.leggauss(4)
    at = (np.arange(8)[:, None] + (gauss + 1) / 2).ravel() / 8 - 0.5
    weight = np.tile(weights / 2, 8) / 8
    axes = np.delete(np.eye(3), np.argmax(np.abs(normal)), axis=0)
    points = np.array(center) + at[:, None, None] * axes[0] + at[None, :, None] * axes[1]
    values = solution.probe(points.reshape(-1, 3), normal).radiosity[:, 0]
    return float(np.outer(weight, weight).ravel() @ values)


@pytest.mark.parametrize(
    ("rho", "floor", "ceiling", "wall"), [(0.5, 0.171215, 1.104364, 0.181105), (0.8, 0.660976, 1.587514, 0.687878)]
)
def test_a_cube_with_a_glowing_ceiling_has_the_published_means(
    rho: float, floor: float, ceiling: float, wall: float
) -> None:
    solution = hatbox.solve(cube(rho), "quadratic", elements=400, tolerance=1e-4, error_points=0)
    assert mean(solution, (0, 0, 1), (0.5, 0.5, 0)) == pytest.approx(floor, abs=5e-4)
    assert mean(solution, (0, 0, -1), (0.5, 0.5, 1)) == pytest.approx(ceiling, abs=5e-4)
    assert mean(solution, (1, 0, 0), (0, 0.5, 0.5)) == pytest.approx(wall, abs=5e-4)
    # Power does not depend on the mesh: ∫B = ∫B⁰/(1 − ρ) in a closed scene.
    assert solution.energy.leaving[0] == pytest.approx(1 / (1 - rho), rel=1e-9)


@pytest.mark.parametrize("basis", hatbox.BASES)
@pytest.mark.parametrize("continuity", hatbox.CONTINUITIES)
def test_a_furnace_glows_uniformly(basis: str, continuity: str) -> None:
    scene = cube(0.5, 0.5)
    solution = hatbox.solve(scene, basis, continuity=continuity, elements=60, tolerance=1e-4, error_points=0)
    np.testing.assert_allclose(solution.radiosity, 1.0, atol=1e-9)
    np.testing.assert_allclose(solution.coefficients, 1.0, atol=1e-9)
    assert solution.energy.defect < 1e-9


@pytest.mark.parametrize(
    ("solver", "operator"),
    [*((name, "auto") for name in hatbox.SOLVERS), ("auto", "dense")],
)
def test_all_solvers_and_operators_agree(solver: str, operator: str, cube_solution: hatbox.Solution) -> None:
    solution = hatbox.solve(cube(), solver=solver, operator=operator, elements=300, tolerance=1e-4, error_points=0)
    scale = np.abs(cube_solution.radiosity).max()
    np.testing.assert_allclose(solution.radiosity, cube_solution.radiosity, atol=1e-3 * scale)


def test_the_sampled_operator_has_the_same_light(cube_solution: hatbox.Solution) -> None:
    sampled = hatbox.solve(cube(), operator="sampled", elements=100, tolerance=0.02, error_points=0)
    assert sampled.report["operator"]["kind"] == "sampled"
    assert sampled.energy.leaving[0] == pytest.approx(cube_solution.energy.leaving[0], rel=0.02)


def test_a_tolerance_alone_refines_until_it_is_reached() -> None:
    solution = hatbox.solve(cube(), tolerance=0.1)
    assert solution.error is not None
    assert solution.error.estimate <= 0.1
    assert solution.report["adaptivity"]["reached"]
    # The last mesh's operator is there for other lamps.
    twice = solution.relight({"face 1": 2.0}, error_points=0)
    np.testing.assert_allclose(twice.radiosity, 2 * solution.radiosity, rtol=1e-8, atol=1e-9)


def test_refinement_stops_before_there_are_too_many_unknowns() -> None:
    solution = hatbox.solve(cube(), tolerance=1e-3, max_unknowns=1000)
    assert not solution.report["adaptivity"]["reached"]
    assert len(solution.radiosity) <= max(1000, 3 * solution.report["adaptivity"]["rounds"][0]["elements"])


@pytest.mark.parametrize("focus", ["face 0", [[0, 0, -0.1], [1, 1, 0.1]]])
def test_the_error_may_count_in_one_place(focus: str | list[list[float]]) -> None:
    solution = hatbox.solve(cube(), tolerance=0.1, focus=focus)
    assert solution.report["adaptivity"]["reached"]


def test_a_certificate_is_more_than_the_estimate() -> None:
    solution = hatbox.solve(cube(0.5), "constant", elements=48)
    found = solution.certify(threads=1)
    assert solution.error is not None
    assert solution.error.estimate < found.bound < 1
    assert found.bound == pytest.approx(found.residual / (1 - found.reflectance))


def test_gathering_moves_the_values_a_little() -> None:
    plain = hatbox.solve(cube(), elements=60, error_points=0)
    gathered = plain.system.solve(error_points=0, gather=True)
    difference = np.abs(gathered.irradiance - plain.irradiance).max()
    assert 0 < difference < 0.5 * np.abs(plain.irradiance).max()


def test_what_refinement_cannot_do_is_said() -> None:
    with pytest.raises(hatbox.HatboxError, match="use a box"):
        hatbox.solve(cube(), focus="nowhere")
    with pytest.raises(hatbox.HatboxError, match="give elements"):
        hatbox.solve(cube(), error_points=0)
    with pytest.raises(hatbox.HatboxError, match="nothing is refined"):
        hatbox.solve(cube(), elements=30, focus="face 0")


@pytest.mark.parametrize("threads", [1, 2])
def test_the_answer_does_not_depend_on_the_number_of_threads(threads: int, cube_solution: hatbox.Solution) -> None:
    solution = hatbox.solve(cube(), elements=300, tolerance=1e-4, threads=threads, error_points=0)
    assert solution.radiosity.tobytes() == cube_solution.radiosity.tobytes()
    x = np.sin(np.arange(len(solution.radiosity)))
    assert (solution.system.exchange @ x).tobytes() == (cube_solution.system.exchange @ x).tobytes()


def test_grading_makes_elements_thin_at_edges() -> None:
    graded = [hatbox.System(cube(), elements=150, grading=q).scene.vertices for q in (1.0, 2.0)]
    thinnest = [np.diff(np.unique(vertices[:, 0].round(9))).min() for vertices in graded]
    assert thinnest[1] < thinnest[0]
    with pytest.raises(hatbox.HatboxError, match=r"grading 0\.5: it must lie between 1 and 8"):
        hatbox.solve(cube(), elements=60, grading=0.5)


def test_an_operator_that_does_not_fit_is_refused() -> None:
    with pytest.raises(hatbox.HatboxError, match="MB"):
        hatbox.solve(cube(), operator="dense", elements=1000, memory=1_000_000)


def test_arrays_are_shared_and_not_copied(cube_solution: hatbox.Solution) -> None:
    native = cube_solution._native
    for array, again in [(cube_solution.radiosity, native.radiosity), (cube_solution.irradiance, native.irradiance)]:
        assert np.shares_memory(array, again)
        assert not array.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0


def test_shared_arrays_outlive_their_solution() -> None:
    kept = hatbox.solve(cube(0.5, 0.5), "constant", elements=60, error_points=0).radiosity
    # Memory that was freed would be used again by these.
    others = [np.full_like(kept, 7.0) for _ in range(100)]
    np.testing.assert_allclose(kept, 1.0, atol=1e-9)
    assert len(others) == 100


def test_light_is_linear_in_the_lamps(cube_solution: hatbox.Solution) -> None:
    relit = cube_solution.relight(np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.0]), error_points=0)
    np.testing.assert_allclose(relit.radiosity, 3 * cube_solution.radiosity, rtol=1e-8, atol=1e-9)
    # A mapping changes what it names: the lamp is off, and everything is dark.
    dark = cube_solution.relight({"face 1": 0.0}, error_points=0)
    np.testing.assert_array_equal(dark.radiosity, 0.0)
    coloured = cube_solution.relight({"face 1": [1.0, 2.0, 0.0]}, error_points=0)
    np.testing.assert_allclose(coloured.radiosity, cube_solution.radiosity * [1.0, 2.0, 0.0], rtol=1e-8, atol=1e-9)


def test_repainting_is_painting_from_the_start(cube_solution: hatbox.Solution) -> None:
    paints = np.array([[0.1], [0.2], [0.3], [0.4], [0.5], [0.6]])
    fresh = hatbox.solve(cube(paints), elements=300, tolerance=1e-4)
    again = cube_solution.repaint(paints)
    np.testing.assert_allclose(again.radiosity, fresh.radiosity, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(again.energy.absorbed, fresh.energy.absorbed, rtol=1e-9)


def test_functions_of_the_place_are_integrated_and_reported() -> None:
    # B⁰ = 1 + x and R = ½: on the whole cube the power is 6·1.5, and half of what arrives is absorbed.
    solution = hatbox.solve(
        cube(lambda p: np.full(len(p), 0.5), lambda p: 1.0 + p[:, 0]), elements=60, tolerance=1e-3, error_points=0
    )
    assert solution.energy.emitted[0] == pytest.approx(9.0, rel=1e-9)
    assert solution.energy.absorbed[0] == pytest.approx(9.0, rel=1e-8)
    assert solution.report["solver"]["kind"] == "gmres"
    uniform = hatbox.solve(cube(0.5, [1.5] * 6), elements=60, tolerance=1e-3, error_points=0)
    assert not np.allclose(solution.radiosity, uniform.radiosity)


def test_functions_may_have_bands() -> None:
    scene = cube({"face 0": lambda p: np.column_stack([0.1 + 0 * p[:, 0], 0.9 + 0 * p[:, 0]])})
    assert scene.bands == 2
    two = hatbox.solve(scene, "constant", elements=60, error_points=0).energy
    for band, rho in enumerate([0.1, 0.9]):
        one = hatbox.solve(cube({"face 0": rho}), "constant", elements=60, error_points=0).energy
        assert two.leaving[band] == pytest.approx(one.leaving[0], rel=1e-8)


def test_what_a_function_raises_the_solve_raises() -> None:
    class StrangeError(Exception):
        pass

    def strange(points: np.ndarray) -> np.ndarray:
        if points[0, 0] > 0.5:
            raise StrangeError("not here")
        return np.full(len(points), 0.5)

    scene = cube(strange)
    for _ in range(2):
        with pytest.raises(StrangeError, match="not here"):
            hatbox.solve(scene, elements=60)


def test_what_was_integrated_while_a_function_raised_is_integrated_again() -> None:
    fails = [False]

    def glow(points: np.ndarray) -> np.ndarray:
        if fails[0] and points[0, 0] > 0.5:
            raise ValueError("not yet")
        return 1.0 + points[:, 0]

    painted = cube(0.5, lambda p: 1.0 + p[:, 0])
    exact = hatbox.System(painted, elements=60, tolerance=1e-3).solve(error_points=0)
    system = hatbox.System(cube(0.5, glow), elements=60, tolerance=1e-3)
    fails[0] = True
    with pytest.raises(ValueError, match="not yet"):
        system.solve(error_points=0)
    fails[0] = False
    for solution in (system.solve(error_points=0), system.with_materials(0.5).solve(error_points=0)):
        np.testing.assert_allclose(solution.radiosity, exact.radiosity, rtol=1e-9)


@pytest.mark.parametrize(("value", "words"), [(1.5, "reflects 1.5"), (np.nan, "reflects nan"), (-0.1, "reflects -0.1")])
def test_impossible_values_of_a_function_are_caught(value: float, words: str) -> None:
    scene = cube(lambda p: np.where(p[:, 2] > 0.5, value, 0.5))
    with pytest.raises(hatbox.HatboxError, match=words):
        hatbox.solve(scene, elements=60)


def test_a_function_of_the_wrong_shape_is_caught() -> None:
    with pytest.raises(hatbox.HatboxError, match="the function returned the shape"):
        cube(lambda p: np.zeros((2, 2)))


def test_solutions_are_saved_and_loaded(cube_solution: hatbox.Solution, tmp_path: Path) -> None:
    path = tmp_path / "cube.npz"
    cube_solution.save(path)
    loaded = hatbox.Solution.load(path)
    np.testing.assert_array_equal(loaded.radiosity, cube_solution.radiosity)
    assert loaded.basis == cube_solution.basis
    with np.load(path) as arrays:
        np.testing.assert_array_equal(arrays["radiosity"].T, cube_solution.radiosity)
        np.testing.assert_array_equal(arrays["nodes"], cube_solution.nodes)
        np.testing.assert_array_equal(arrays["cells"], cube_solution.scene.cells)
    for unknown in (loaded.relight, loaded.repaint):
        with pytest.raises(hatbox.HatboxError, match="no exchange operator"):
            unknown(0.5)
    with pytest.raises(hatbox.HatboxError, match="does not know how it was made"):
        _ = loaded.energy


@pytest.mark.parametrize("extension", hatbox.OUTPUTS)
def test_every_output_is_written(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"cube.{extension}"
    hatbox.solve(cube(), "constant", elements=30, error_points=0).save(path)
    assert path.stat().st_size > 0


def test_baked_triangles_carry_the_solution(cube_solution: hatbox.Solution) -> None:
    for quantity, values in [("radiosity", cube_solution.radiosity), ("irradiance", cube_solution.irradiance)]:
        baked = cube_solution.bake(quantity)
        corners = baked.vertices[baked.triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        assert area.sum() == pytest.approx(6.0)
        # Linear functions: the integral is the area times the mean of the corners.
        power = (area * baked.values[baked.triangles, 0].mean(axis=1)).sum()
        assert power == pytest.approx((cube_solution.system.mass @ values).sum(), rel=1e-9)


def test_probing_far_away_warns_and_facing_nothing_is_nan(cube_solution: hatbox.Solution) -> None:
    with pytest.warns(hatbox.HatboxWarning, match="farther than"):
        far = cube_solution.probe([[0.5, 0.5, 0.5]], [[0.0, 0.0, 1.0]])
    assert np.isfinite(far.irradiance).all()
    with pytest.warns(hatbox.HatboxWarning, match="NaN"):
        none = cube_solution.probe([[0.5, 0.5, 0.0]], [[0.0, 0.0, 0.0]])
    assert np.isnan(none.irradiance).all()
    assert cube_solution.probe(np.empty((0, 3)), np.empty((0, 3))).irradiance.shape == (0, 1)


def test_direct_light_at_points_has_shadows_as_sharp_as_they_are() -> None:
    def square(z: float, s: float) -> list[list[float]]:
        return [[-s, -s, z], [s, -s, z], [s, s, z], [-s, s, z]]

    floor, sheet, lamp = [0, 1, 2, 3], [4, 5, 6, 7], [8, 11, 10, 9]
    scene = hatbox.Scene(
        np.array(square(0, 1) + square(0.3, 0.33) + square(1, 0.05)), np.array([floor, sheet, lamp]),
        reflectance=[0.5, 0.0, 0.0], exitance=[0.0, 0.0, 100.0],
    )  # fmt: skip
    solution = hatbox.solve(scene, elements=200, tolerance=1e-3, error_points=0, progress=False)
    points = np.column_stack([np.linspace(-0.42, 0.42, 85), np.zeros((85, 2))])
    up = np.array([0.0, 0.0, 1.0])
    ways: list[dict[str, bool]] = [{"direct": True}, {"gather": True}, {}]
    dark, gathered, plain = (solution.probe(points, up, **way, threads=1).irradiance[:, 0] for way in ways)
    assert np.abs(dark).max() < 2e-3
    assert np.abs(gathered).max() < 2e-3
    with pytest.raises(hatbox.HatboxError, match="choose one"):
        solution.probe(points, up, direct=True, gather=True)
    assert np.abs(plain).max() > 0.04


def test_the_error_is_estimated_if_asked_for(cube_solution: hatbox.Solution) -> None:
    assert cube_solution.error is not None
    assert 0 < cube_solution.error.estimate < 1
    assert hatbox.solve(cube(), elements=30, error_points=0).error is None


def test_scenes_are_read_from_files(scenes: Path) -> None:
    with pytest.warns(hatbox.HatboxWarning, match="split"):
        scene = hatbox.Scene.load(scenes / "cornell-box.glb")
    assert scene.bands == 3
    assert scene.reflectance.shape == scene.exitance.shape == (len(scene.material_names), 3)
    solution = hatbox.solve(scene, elements=200, error_points=0)
    assert solution.radiosity.shape == (len(solution.nodes), 3)
    assert solution.energy.escaped.min() > 0
    assert solution.energy.defect < 1e-9


def test_materials_by_name_and_by_number_are_the_same() -> None:
    lamp = [0, 1, 0, 0, 0, 0]
    names = ["lamp" if k else "wall" for k in lamp]
    by_name = cube({"wall": 0.3, "lamp": 0.0}, {"lamp": 2.0}, materials=names)
    by_number = cube([0.3, 0.0], [0.0, 2.0], materials=lamp)
    assert by_name.material_names == ["wall", "lamp"]
    np.testing.assert_array_equal(by_name.reflectance, by_number.reflectance)
    np.testing.assert_array_equal(by_name.exitance, by_number.exitance)
    np.testing.assert_array_equal(by_name.material, by_number.material)


def test_repairs_are_warnings() -> None:
    faces = np.vstack([CUBE_FACES, [[0, 1, 1, 1]]])
    with pytest.warns(hatbox.HatboxWarning, match="left out a face that has no area"):
        scene = hatbox.Scene(CUBE_VERTICES, faces)
    assert len(scene.warnings) == 1


def test_what_lights_nothing_is_warned_of() -> None:
    turned = hatbox.Scene(CUBE_VERTICES, CUBE_FACES[:, ::-1], 0.5, np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0]]).T)
    for options in ({"elements": 30}, {"tolerance": 0.3}):
        with pytest.warns(hatbox.HatboxWarning, match="lit sides may look outwards"):
            hatbox.solve(turned, **options)
        with pytest.warns(hatbox.HatboxWarning, match="nothing shines"):
            hatbox.solve(cube(exitance=0.0), **options)


def test_two_sided_sheets_have_two_sides() -> None:
    square = CUBE_VERTICES[:4], CUBE_FACES[:1]
    assert hatbox.Scene(*square).area == pytest.approx(1.0)
    assert hatbox.Scene(*square, two_sided=True).area == pytest.approx(2.0)


def test_several_threads_of_python_may_solve_at_once(cube_solution: hatbox.Solution) -> None:
    found: list[hatbox.Solution] = []

    def work() -> None:
        found.append(hatbox.solve(cube(), elements=300, tolerance=1e-4, error_points=0))

    workers = [threading.Thread(target=work) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(found) == 3
    for solution in found:
        np.testing.assert_array_equal(solution.radiosity, cube_solution.radiosity)


def test_no_warning_comes_from_a_clean_scene() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cube().warnings == []
