"""A plot: the illuminance of the floor of two rooms with a lamp in the first, in lux.

Run it: python plot_floor.py [FOLDER]
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

import hatbox

ROOT = Path(__file__).resolve().parents[2]


def main(folder: Path, elements: int = 3000) -> np.ndarray:
    """Draws the floor from above and returns the illuminance on its grid; NaN where there is no floor."""
    scene = hatbox.Scene.load(ROOT / "scenes" / "two-rooms.glb")
    # Light that is gathered once more is nowhere negative, also beside the sharp shadow of the doorway.
    solution = hatbox.solve(scene, elements=elements, gather=True, error_points=0)
    x, z = np.linspace(0.05, 8.15, 163), np.linspace(0.05, 3.95, 79)
    points = np.array([[a, 0.0, c] for c in z for a in x])
    with warnings.catch_warnings():
        # The wall between the rooms stands on no floor: its points are far from any.
        warnings.simplefilter("ignore", hatbox.HatboxWarning)
        lux = solution.probe(points, (0.0, 1.0, 0.0)).irradiance.mean(axis=1).reshape(len(z), len(x))
    in_wall = (x > 4.0) & (x < 4.2)
    lux[np.ix_((z < 1.5) | (z > 2.4), in_wall)] = np.nan
    figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
    scale = LogNorm(np.nanmin(lux), np.nanmax(lux))
    picture = axes.pcolormesh(x, z, lux, norm=scale, shading="nearest", cmap="inferno")
    lines = axes.contour(x, z, lux, levels=[5, 10, 20, 50, 100, 200, 300], colors="white", linewidths=0.7)
    axes.clabel(lines, fmt="%g", fontsize=8)
    axes.set(aspect="equal", xlabel="x (m)", ylabel="z (m)", title="Illuminance of the floor (lx)")
    figure.colorbar(picture, ax=axes, format="%g", shrink=0.7, label="lx")
    figure.savefig(folder / "floor.png", dpi=120)
    plt.close(figure)
    return lux


if __name__ == "__main__":
    floor = main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
    print(f"from {np.nanmin(floor):.2f} to {np.nanmax(floor):.1f} lx")
