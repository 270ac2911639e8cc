"""What is computed: closed enclosures and occluded pairs for view factors, two scenes for light."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import hatbox

ROOT = Path(__file__).resolve().parents[3]
DATA = Path(__file__).resolve().parents[1] / "data"

# Howell's catalogue, C-11: parallel unit squares at distance 1.
C_11 = 0.199824895698387

UNIT_BOX = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])


@dataclass(frozen=True)
class Quads:
    """Quads that exchange light, and what is known of their view factors."""

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    exact: float = math.nan
    """The view factor from the first to the second, where there is a closed form."""
    boxes: tuple[np.ndarray, ...] = ()
    """Boxes inside the enclosure, each by two corners: nothing stands between two faces on the sides of one."""

    @property
    def convex(self) -> bool:
        """Whether nothing stands between any two faces."""
        return bool(self.boxes) and bool(self.in_one_box().all())

    def in_one_box(self) -> np.ndarray:
        """Which pairs of faces lie on the sides of one box."""
        corners = self.vertices[self.faces]
        inside = [((corners > low - 1e-9) & (corners < high + 1e-9)).all(axis=(1, 2)) for low, high in self.boxes]
        return np.any([np.outer(within, within) for within in inside], axis=0)


@dataclass(frozen=True)
class Lit:
    """A scene with the irradiance at points on its surfaces."""

    name: str
    scene: hatbox.Scene
    points: np.ndarray
    normals: np.ndarray
    weights: np.ndarray
    truth: np.ndarray


def _cut(quads: list[np.ndarray], edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Quads cut into pieces with edges of about a length."""
    pieces = []
    for a, b, _, d in quads:
        n, m = (max(1, round(np.linalg.norm(e - a) / edge)) for e in (b, d))
        u, v = np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1)
        grid = a + u[:, None, None] * (b - a) + v[None, :, None] * (d - a)
        pieces.append(np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(-1, 4, 3))
    corners = np.concatenate(pieces)
    return corners.reshape(-1, 3), np.arange(4 * len(corners)).reshape(-1, 4)


def _prism(outline: np.ndarray, parts: list[list[int]], height: float, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """A room over a counter-clockwise outline; `parts` are the rectangles of its floor, counter-clockwise too."""
    low = np.column_stack([outline, np.zeros(len(outline))])
    high = low + [0, 0, height]
    quads = [low[part] for part in parts] + [high[part][[0, 3, 2, 1]] for part in parts]
    for i in range(len(outline)):
        j = (i + 1) % len(outline)
        quads.append(np.array([low[i], high[i], high[j], low[j]]))
    return _cut(quads, edge)


def cube(per_side: int) -> Quads:
    """The closed unit cube."""
    outline = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    return Quads("cube", *_prism(outline, [[0, 1, 2, 3]], 1.0, 1.0 / per_side), boxes=(UNIT_BOX,))


def l_room(per_side: int) -> Quads:
    """A closed room in the shape of an L, the ends of which do not see each other."""
    outline = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2], [0, 1]], float)
    parts = [[0, 1, 4, 7], [1, 2, 3, 4], [7, 4, 5, 6]]
    arms = (UNIT_BOX * [2.0, 1.0, 1.0], UNIT_BOX * [1.0, 2.0, 1.0])
    return Quads("L-room", *_prism(outline, parts, 1.0, 1.0 / per_side), boxes=arms)


def occluded() -> list[Quads]:
    """A sheet between the unit squares z = 0 and z = 1."""
    squares = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]], float)

    def with_sheet(name: str, x: tuple[float, float], y: tuple[float, float], z: float, exact: float) -> Quads:
        sheet = [[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]
        return Quads(name, np.vstack([squares, sheet]), np.arange(12).reshape(3, 4), exact)

    return [
        with_sheet("half hidden", (0, 0.5), (0, 1), 0.5, C_11 / 2),
        with_sheet("a quarter hidden", (0, 0.5), (0, 0.5), 0.5, 0.75 * C_11),
        with_sheet("a small sheet between", (0.25, 0.75), (0.25, 0.75), 0.75, 0.115620602132),
    ]


def load(path: Path) -> hatbox.Scene:
    """A scene, whatever had to be repaired in it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hatbox.HatboxWarning)
        return hatbox.Scene.load(path)


def cornell() -> Lit:
    """The Cornell box; the truth is that of the tests."""
    data = ROOT / "crates" / "hatbox" / "tests" / "data"
    table = np.loadtxt(data / "cornell_irradiance.csv", delimiter=",", skiprows=1)
    # Points on the borders of the blocks are what they are; all tools get the same.
    return Lit("Cornell box", load(data / "cornell.obj"), table[:, :3], table[:, 3:6], table[:, 6], table[:, 8:11])


def two_rooms() -> Lit:
    """Two rooms with a lamp in the first; the truth is in `data/two-rooms.csv` (made by `run --truth`)."""
    table = np.loadtxt(DATA / "two-rooms.csv", delimiter=",", skiprows=1)
    scene = load(ROOT / "scenes" / "two-rooms.glb")
    return Lit("two rooms", scene, table[:, :3], table[:, 3:6], np.ones(len(table)), table[:, 6:9])


def sample(scene: hatbox.Scene, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points spread over the surfaces, uniformly by area and stratified, with their normals."""
    corners = scene.vertices[scene.cells]
    halves = np.concatenate([corners[:, [0, 1, 2]], corners[scene.cells[:, 2] != scene.cells[:, 3]][:, [0, 2, 3]]])
    cross = np.cross(halves[:, 1] - halves[:, 0], halves[:, 2] - halves[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    random = np.random.default_rng(seed)
    ends = np.cumsum(area)
    chosen = np.searchsorted(ends, (np.arange(count) + random.random(count)) / count * ends[-1])
    u, v = np.sqrt(random.random(count)), random.random(count)
    weights = np.column_stack([1 - u, u * (1 - v), u * v])
    return np.einsum("nk,nkd->nd", weights, halves[chosen]), cross[chosen] / (2 * area[chosen, None])
