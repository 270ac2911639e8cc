"""What all tests share."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hypothesis import settings

import hatbox

sys.path.insert(0, str(Path(__file__).parent))
ROOT = Path(__file__).resolve().parents[2]

# Solves take as long as they take on a busy machine; examples are few, since each is a solve.
settings.register_profile("hatbox", deadline=None, max_examples=15, derandomize=True)
settings.load_profile("hatbox")


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The folder of sample scenes."""
    return ROOT / "scenes"


@pytest.fixture(scope="session")
def cube_solution() -> hatbox.Solution:
    """The cube with a glowing ceiling, solved."""
    from shapes import cube

    return hatbox.solve(cube(), elements=300, tolerance=1e-4)
