"""A solution's file without Hatbox: `numpy.load` and a little arithmetic.

Run it: python npz_with_numpy.py SOLUTION.npz
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np


def mean_irradiance_of_materials(path: Path) -> dict[str, float]:
    """The mean irradiance of each material's cells in the first band, for linear functions on triangles."""
    with np.load(path) as file:
        if str(file["basis"]) != "linear":
            raise SystemExit("this example wants linear functions")
        corners = file["vertices"][file["cells"][:, :3]]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        # The mean of a linear function over a triangle is that of its corners.
        irradiance = file["irradiance"][0].reshape(-1, 3).mean(axis=1)
        names, material = file["material_names"], file["material"]
        return {
            str(name): float(np.average(irradiance[material == k], weights=area[material == k]))
            for k, name in enumerate(names)
            if (material == k).any()
        }


if __name__ == "__main__":
    for name, lux in mean_irradiance_of_materials(Path(sys.argv[1])).items():
        print(f"{name:<12} {lux:8.3f} lx")
