"""The package itself: types, documentation, names."""

from __future__ import annotations

import doctest
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import hatbox
from hatbox import _native

PYTHON = Path(__file__).resolve().parents[1]


def run(*command: str) -> None:
    done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, check=False, cwd=PYTHON)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_stubs_are_those_of_the_native_module() -> None:
    run("mypy.stubtest", "hatbox._native", "--mypy-config-file", str(PYTHON / "pyproject.toml"))


def test_the_types_are_right() -> None:
    run("mypy", "package/hatbox", "--config-file", str(PYTHON / "pyproject.toml"))


def test_the_code_is_tidy() -> None:
    folders = [".", str(PYTHON.parent / "benches" / "peers")]
    run("ruff", "check", "--quiet", "--config", "pyproject.toml", *folders)
    run("ruff", "format", "--check", "--quiet", "--config", "pyproject.toml", *folders)


def test_the_package_says_that_it_is_typed() -> None:
    assert (Path(inspect.getfile(hatbox)).parent / "py.typed").exists()


def test_the_tour_of_the_package_runs() -> None:
    results = doctest.testmod(hatbox)
    assert results.attempted > 3
    assert results.failed == 0


def test_the_example_of_the_readme_runs() -> None:
    text = (PYTHON.parent / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert blocks
    for block in blocks:
        names: dict[str, hatbox.Solution] = {}
        exec(block, names)
        assert names["brighter"].energy.emitted == 2 * names["solution"].energy.emitted


@pytest.mark.filterwarnings("default::hatbox.HatboxWarning")
def test_the_guide_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (PYTHON.parent / "book" / "python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) > 3
    (tmp_path / "scenes").symlink_to(PYTHON.parent / "scenes")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks:
        exec(block, names)
    assert (tmp_path / "cornell.glb").exists()


PUBLIC = [(name, getattr(hatbox, name)) for name in hatbox.__all__ if callable(getattr(hatbox, name))]


@pytest.mark.parametrize(("name", "thing"), PUBLIC)
def test_everything_public_is_documented(name: str, thing: object) -> None:
    assert inspect.getdoc(thing), name
    if inspect.isclass(thing):
        for member, value in vars(thing).items():
            if not member.startswith("_") and (callable(value) or isinstance(value, property)):
                assert inspect.getdoc(value), f"{name}.{member}"


@pytest.mark.parametrize("function", [hatbox.solve, hatbox.view_factors, hatbox.System])
def test_every_argument_is_documented(function: object) -> None:
    text = inspect.getdoc(function) or ""
    for argument in inspect.signature(function).parameters:  # type: ignore[arg-type]
        assert re.search(rf"^ +{argument}: ", text, re.MULTILINE), argument


def test_lists_of_names_say_what_each_is() -> None:
    for table in (_native.BASES, _native.SOLVERS, _native.OPERATORS, _native.CONTINUITIES, _native.OUTPUTS):
        assert table
        assert all(summary for summary in table.values())
    assert "constant" in hatbox.BASES
    assert re.fullmatch(r"\d+\.\d+\.\d+", hatbox.__version__)
