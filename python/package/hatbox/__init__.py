"""Hatbox: diffuse light and radiant heat by the finite-element method.

>>> import numpy as np
>>> import hatbox
>>> vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]])
>>> faces = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])  # a floor, and a lamp above that looks down
>>> scene = hatbox.Scene(vertices, faces, reflectance=[0.5, 0.0], exitance=[0.0, 100.0])
>>> solution = hatbox.solve(scene, elements=200)
>>> lux = solution.probe([[0.5, 0.5, 0.0]], [[0.0, 0.0, 1.0]]).irradiance

Units are those of the whole of Hatbox: metres; radiosity and exitance in lm/m² or W/m²; irradiance in lx or W/m²;
reflectance between 0 and 1. A diffuse emitter of radiance L has the exitance πL. Faces are lit on the side from which
their vertices run counter-clockwise, and block light on both.

Arrays have the bands (one, the three of RGB, or any number) on their last axis. Whatever is wrong with the input is a
`HatboxError`, with the words of the command line; Ctrl-C is a `KeyboardInterrupt`, at any time.
"""

from ._factors import view_factors
from ._native import BASES, CLOSURES, CONTINUITIES, FORMATS, OPERATORS, OUTPUTS, SOLVERS, HatboxError, __version__
from ._scene import HatboxWarning, Scene
from ._solution import Certificate, Energy, ErrorEstimate, Probed, Solution, Triangles, solve
from ._system import PairBlock, System, element_nodes, shape_functions

__all__ = [
    "BASES",
    "CLOSURES",
    "CONTINUITIES",
    "FORMATS",
    "OPERATORS",
    "OUTPUTS",
    "SOLVERS",
    "Certificate",
    "Energy",
    "ErrorEstimate",
    "HatboxError",
    "HatboxWarning",
    "PairBlock",
    "Probed",
    "Scene",
    "Solution",
    "System",
    "Triangles",
    "__version__",
    "element_nodes",
    "shape_functions",
    "solve",
    "view_factors",
]
