"""Rays a second beside Embree: the program of `benches/embree`, which measures both in one process on the same rays."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from .measure import AbsentError, Row
from .scenes import ROOT

RATE = "M rays/s"

# scene, kind, threads, and rates: ours, Embree's for robust scenes, Embree's by default.
_LINE = re.compile(r"^(\S+) +(any|closest|pairs of 16) +(\d) +([\d.]+) +([\d.]+) +[\d.]+ +([\d.]+)")


def measure(quick: bool, absent: dict[str, str]) -> Iterator[Row]:
    """Single rays and batches of sixteen, on two scenes of 72 000 triangles."""
    try:
        yield from _rates(["--quick", "box"] if quick else ["spheres", "soup"])
    except AbsentError as error:
        absent["embree"] = str(error)


def _rates(arguments: list[str]) -> Iterator[Row]:
    program = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "embree-bench"
    done = subprocess.run([program, _embree(), *arguments], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise AbsentError(done.stderr.strip().splitlines()[-1])
    for line in done.stdout.splitlines():
        if found := _LINE.match(line):
            scene, kind, threads, *rates = found.groups()
            job = f"{scene}, {kind}, {threads} thread{'s' if threads != '1' else ''}"
            ours, robust, default = map(float, rates)
            yield Row(job, "hatbox", "", "", 0.0, 0.0, {RATE: ours})
            yield Row(job, "embree", "", "robust", 0.0, 0.0, {RATE: robust})
            yield Row(job, "embree", "", "default", 0.0, 0.0, {RATE: default})


def _embree() -> Path:
    """The library in the wheel embreex."""
    found = [path for pattern in ("libembree4*.so*", "libembree4*.dylib") for path in Path(sys.prefix).rglob(pattern)]
    if not found:
        raise AbsentError("there is no libembree4 in the environment")
    return min(found)
