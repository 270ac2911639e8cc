"""What is said when something is wrong, and how work is stopped."""

from __future__ import annotations

import _thread
import io
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hatbox
from shapes import CUBE_FACES, CUBE_VERTICES, cube

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
BAD_FILES = {
    "empty.obj": "# nothing\n",
    "index.obj": SQUARE + "f 1 2 9\n",
    "nan.obj": "v 0 0 0\nv nan 0 0\nv 1 1 0\nf 1 2 3\n",
    "scene.xyz": "",
    "broken.toml": 'meshes = ["room.obj"\n',
    "broken.glb": "glTF",
    "flat.obj": "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
}


def words(text: str) -> list[str]:
    """The words of a message, whatever it is decorated with."""
    return re.findall(r"[^\s×│╰─▶]+", text.replace("help:", " "))


def program() -> str:
    path = os.environ.get("HATBOX_PROGRAM")
    if path is None:
        pytest.skip("HATBOX_PROGRAM does not say where the command line is")
    return path


def said(*arguments: str) -> list[str]:
    done = subprocess.run([program(), *arguments], capture_output=True, text=True, check=False, encoding="utf-8")
    assert done.returncode == 1, done.stderr
    return words(done.stderr)


@pytest.mark.parametrize("name", [*BAD_FILES, "missing.obj"])
def test_the_words_are_those_of_the_command_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    if name in BAD_FILES:
        path.write_text(BAD_FILES[name])
    with pytest.raises(hatbox.HatboxError) as caught:
        hatbox.Scene.load(path)
    spoken = said("solve", str(path))
    mine = words(str(caught.value))
    # The command line may show the offending text in between.
    rest = iter(spoken)
    assert all(word in rest for word in mine), f"{caught.value}\n{spoken}"


def test_unwritable_outputs_have_the_words_of_the_command_line(
    tmp_path: Path, scenes: Path, cube_solution: hatbox.Solution
) -> None:
    for name in ("out.xyz", "no/folder/out.npz"):
        path = str(tmp_path / name)
        with pytest.raises(hatbox.HatboxError) as caught:
            cube_solution.save(path)
        assert words(str(caught.value)) == said("solve", str(scenes / "cube.toml"), "-o", path)


def test_what_is_no_solution_has_the_words_of_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "wrong.npz"
    path.write_text("no archive")
    with pytest.raises(hatbox.HatboxError) as caught:
        hatbox.Solution.load(path)
    assert words(str(caught.value)) == said("render", str(path), "-o", str(tmp_path / "out.png"))


@pytest.mark.parametrize("what", ["basis", "continuity", "operator", "solver"])
def test_unknown_names_are_answered_with_the_known_ones(what: str) -> None:
    known = {
        "basis": hatbox.BASES,
        "continuity": hatbox.CONTINUITIES,
        "operator": hatbox.OPERATORS,
        "solver": hatbox.SOLVERS,
    }[what]
    with pytest.raises(hatbox.HatboxError, match=f"there is no {what} `magic`") as caught:
        hatbox.solve(cube(), elements=6, **{what: "magic"})  # type: ignore[arg-type]
    assert all(name in str(caught.value) for name in known)


def interrupted(work: Any) -> None:
    """Runs the work and interrupts it from another thread, as Ctrl-C does."""
    timer = threading.Timer(0.2, _thread.interrupt_main)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            work()
    finally:
        timer.cancel()


def test_ctrl_c_interrupts_a_solve_and_leaves_the_module_usable() -> None:
    # Minutes of work, if nobody stops it.
    interrupted(lambda: hatbox.solve(cube(), "linear", elements=12_000, tolerance=1e-8))
    interrupted(lambda: hatbox.view_factors(CUBE_VERTICES, CUBE_FACES, elements=12_000, tolerance=1e-8))
    assert hatbox.solve(cube(), elements=30, error_points=0).energy.defect < 1e-9


def test_interrupted_work_goes_on_where_it_was(tmp_path: Path) -> None:
    kept, done = tmp_path / "work", threading.Event()

    def solve(scene: hatbox.Scene, checkpoint: Path | None, **options: Any) -> hatbox.Solution:
        return hatbox.solve(scene, operator="sampled", tolerance=0.04, checkpoint=checkpoint, **options)

    def interrupt() -> None:
        while not done.is_set():
            if kept.exists() and kept.stat().st_size > 1_000_000:
                _thread.interrupt_main()
                return
            time.sleep(0.001)

    # A large part of a hundred megabytes of work.
    many = {"elements": 150_000, "error_points": 0}
    watcher = threading.Thread(target=interrupt)
    watcher.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            solve(cube(), kept, **many)
    finally:
        done.set()
        watcher.join()
    assert kept.stat().st_size > 1_000_000
    with pytest.raises(hatbox.HatboxError, match="not a checkpoint of this work"):
        solve(cube(0.3), kept, **many)
    resumed, whole = solve(cube(), kept, **many), solve(cube(), None, **many)
    np.testing.assert_array_equal(resumed.radiosity, whole.radiosity)
    assert not kept.exists()


def test_what_is_kept_is_not_done_again(tmp_path: Path) -> None:
    kept, same = tmp_path / "work", tmp_path / "same"

    for options in ({"elements": 3000, "error_points": 0}, {"tolerance": 0.1}):
        sizes = []
        for _ in range(2):
            # The first time an empty file, which is removed in the end under one of its names only.
            if not same.exists():
                same.touch()
            os.link(same, kept)
            hatbox.solve(cube(), operator="sampled", checkpoint=kept, **options)
            assert not kept.exists()
            sizes.append(same.stat().st_size)
        assert sizes[0] == sizes[1] > 10_000
        same.unlink()


def test_rays_that_memory_does_not_hold_are_warned_of() -> None:
    options = {"elements": 3000, "operator": "sampled", "error_points": 0}
    with pytest.warns(hatbox.HatboxWarning, match="do not fit into 1 MB of memory and are cast again"):
        little = hatbox.solve(cube(), memory=1_000_000, **options)
    np.testing.assert_array_equal(little.radiosity, hatbox.solve(cube(), **options).radiosity)


@pytest.mark.skipif(os.name == "nt", reason="processes are interrupted otherwise there")
def test_ctrl_c_ends_a_program_in_the_middle_of_a_solve() -> None:
    work = "print('begun', flush=True); hatbox.solve(cube(), elements=12_000, tolerance=1e-8)"
    code = f"import hatbox\nfrom shapes import cube\n{work}"
    command, folder = [sys.executable, "-c", code], Path(__file__).parent
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "begun\n"
        time.sleep(0.2)
        program.send_signal(signal.SIGINT)
        _, complaint = program.communicate(timeout=60)
    assert program.returncode == -signal.SIGINT
    assert complaint.rstrip().splitlines()[-1].startswith("KeyboardInterrupt")


def test_the_interpreter_runs_on_while_the_library_works() -> None:
    """Another thread must get its turn: a solve that needs an answer from it would otherwise never end."""
    asked, answered = threading.Event(), threading.Event()

    def answer() -> None:
        if asked.wait(60):
            answered.set()

    helper = threading.Thread(target=answer)
    helper.start()

    def emission(points: Any) -> Any:
        asked.set()
        assert answered.wait(60)
        return points[:, 0]

    hatbox.solve(cube(0.5, emission), "constant", elements=6, error_points=0)
    helper.join()


class Terminal(io.StringIO):
    """A stream that claims to be looked at."""

    def isatty(self) -> bool:
        return True


def test_progress_is_drawn_where_it_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    for stream, progress, seen in [(Terminal(), True, True), (Terminal(), False, False), (io.StringIO(), True, False)]:
        monkeypatch.setattr(sys, "stderr", stream)
        hatbox.solve(cube(), elements=400, tolerance=1e-4, error_points=0, progress=progress)
        assert ("form factors" in stream.getvalue()) == seen
