"""The examples run and say what is right."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import hatbox
from shapes import cube

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_tested() -> None:
    tests = Path(__file__).read_text()
    for path in EXAMPLES.glob("*.py"):
        assert f'example("{path.stem}")' in tests, path


@pytest.mark.filterwarnings("default::hatbox.HatboxWarning")
def test_trimesh_in_pyvista_out(tmp_path: Path) -> None:
    import pyvista

    mesh = example("trimesh_to_pyvista").main(tmp_path)
    # The walls, the block's six faces and the floor under it, which is dark.
    assert mesh.area == pytest.approx(2 * (12 + 10 + 7.5) + 6)
    again = pyvista.read(tmp_path / "room.vtp")
    np.testing.assert_array_equal(again["radiosity"], mesh["radiosity"])
    lamp = mesh.points[:, 2] == mesh.points[:, 2].max()
    assert mesh["radiosity"][lamp].max() == pytest.approx(1000.0)


def test_meshio_in_and_out(tmp_path: Path) -> None:
    import meshio

    example("meshio_heat").main(tmp_path)
    loss = meshio.read(tmp_path / "furnace.vtu").cell_data["net loss"][0]
    # What is lost is gained: the furnace is closed. The hot floor loses, the cold ceiling gains, four walls are alike.
    assert abs(loss.sum()) < 1e-6 * abs(loss).max()
    assert loss[0] > 0 > loss[1]
    np.testing.assert_allclose(loss[2:], loss[2:].mean(), rtol=1e-3)


def test_numpy_reads_a_solution(tmp_path: Path) -> None:
    scene = cube({"wall": 0.5, "lamp": 0.5}, {"lamp": 1.0}, materials=["wall", "lamp", "wall", "wall", "wall", "wall"])
    solution = hatbox.solve(scene, elements=300, tolerance=1e-4, error_points=0)
    solution.save(tmp_path / "cube.npz")
    means = example("npz_with_numpy").mean_irradiance_of_materials(tmp_path / "cube.npz")
    # ∫E over both materials is the irradiance of all.
    assert 5 * means["wall"] + means["lamp"] == pytest.approx(6 * solution.energy.mean_irradiance[0], rel=1e-9)


@pytest.mark.filterwarnings("default::hatbox.HatboxWarning")
def test_a_plot_of_the_floor(tmp_path: Path) -> None:
    lux = example("plot_floor").main(tmp_path, elements=400)
    assert (tmp_path / "floor.png").stat().st_size > 10_000
    # The lamp hangs in the first room; the doorway lets a little of its light through.
    assert np.nanmean(lux[:, :78]) > 10 * np.nanmean(lux[:, 90:]) > 0
    assert np.isnan(lux).any()
