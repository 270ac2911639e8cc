"""A trimesh mesh in, a PyVista mesh out: a room with a lamp, solved, as triangles that carry their radiosity.

Run it: python trimesh_to_pyvista.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyvista
import trimesh

import hatbox


def room() -> tuple[trimesh.Trimesh, list[str]]:
    """A box seen from inside with a smaller one on its floor, and the material of each face."""
    walls = trimesh.creation.box(extents=(4.0, 3.0, 2.5))
    walls.invert()
    block = trimesh.creation.box(extents=(1.0, 1.0, 1.0))
    block.apply_translation((0.7, 0.0, -0.75))
    mesh = trimesh.util.concatenate([walls, block])
    looks_down = mesh.face_normals[:, 2] < -0.5
    is_wall = np.arange(len(mesh.faces)) < len(walls.faces)
    return mesh, ["lamp" if down and wall else "paint" for down, wall in zip(looks_down, is_wall, strict=True)]


def main(folder: Path) -> pyvista.PolyData:
    """Solves the room and writes it as a file that ParaView opens."""
    mesh, materials = room()
    scene = hatbox.Scene(mesh.vertices, mesh.faces, {"paint": 0.6, "lamp": 0.0}, {"lamp": 1000.0}, materials)
    solution = hatbox.solve(scene, elements=600)
    baked = solution.bake()
    result = pyvista.PolyData.from_regular_faces(baked.vertices, baked.triangles)
    result.point_data["radiosity"] = baked.values[:, 0]
    result.save(folder / "room.vtp")
    return result


if __name__ == "__main__":
    found = main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
    print(
        f"{found.n_cells} triangles, radiosity {found['radiosity'].min():.1f} to {found['radiosity'].max():.1f} lm/m²"
    )
