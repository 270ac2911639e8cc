"""A meshio file in and out: the net radiant heat flux of the walls of a furnace, from their temperatures.

Run it: python meshio_heat.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import meshio
import numpy as np

import hatbox

STEFAN_BOLTZMANN = 5.670374419e-8


def furnace() -> meshio.Mesh:
    """A cube seen from inside, with a temperature in kelvin on each face: the floor is hot."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
    quads = np.array([[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [3, 2, 6, 7], [0, 3, 7, 4], [1, 5, 6, 2]])
    temperature = np.array([1200.0, 800.0, 900.0, 900.0, 900.0, 900.0])
    return meshio.Mesh(points, [("quad", quads)], cell_data={"temperature": [temperature]})


def main(folder: Path) -> meshio.Mesh:
    """Writes the furnace, reads it as anybody's file, and writes the fluxes beside the temperatures."""
    furnace().write(folder / "furnace.vtu")
    mesh = meshio.read(folder / "furnace.vtu")
    faces, temperature = mesh.cells_dict["quad"], mesh.cell_data_dict["temperature"]["quad"]
    emissivity = 0.8
    scene = hatbox.Scene(
        mesh.points,
        faces,
        1 - emissivity,
        emissivity * STEFAN_BOLTZMANN * temperature**4,
        physics="heat",
        groups=np.arange(len(faces)),
    )
    solution = hatbox.solve(scene, elements=600, tolerance=1e-4)
    # The integrals of B − E over each face: what it loses.
    loss = solution.system.mass @ (solution.radiosity - solution.irradiance)
    face = np.repeat(solution.scene.group, np.diff(solution.offsets.astype(int)))
    mesh.cell_data["net loss"] = [np.bincount(face, loss[:, 0])]
    mesh.write(folder / "furnace.vtu")
    return mesh


if __name__ == "__main__":
    result = main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
    for index, watts in enumerate(result.cell_data["net loss"][0]):
        print(f"face {index}: {watts / 1000:+.2f} kW")
