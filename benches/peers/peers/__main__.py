"""`benches/peers/run`: measures piece by piece, and writes what was measured into the book."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator

import numpy as np

from . import factors, light, path_tracer, rays, report, terrain
from .measure import Row
from .scenes import DATA, ROOT, Lit, load, sample

Piece = Callable[[bool, dict[str, str]], Iterator[Row]]

PIECES: dict[str, Piece] = {
    "factors": factors.measure,
    "cornell": light.measure_cornell,
    "rooms": light.measure_rooms,
    "terrain": terrain.measure,
    "rays": rays.measure,
}


def main() -> None:
    """Reads the arguments and does it."""
    parser = argparse.ArgumentParser(description="Hatbox beside other programs", prog="benches/peers/run")
    parser.add_argument("--quick", action="store_true", help="small jobs; nothing is written into the book")
    parser.add_argument("--truth", type=int, metavar="PATHS", help="make data/two-rooms.csv again with so many a point")
    choices = [*PIECES, "report", []]
    text = f"{', '.join(PIECES)} or report; all of them if none is given"
    parser.add_argument("pieces", nargs="*", choices=choices, metavar="PIECE", help=text)
    arguments = parser.parse_args()
    if arguments.truth:
        _truth(arguments.truth)
        return
    for name in arguments.pieces or [*PIECES, "report"]:
        if name == "report":
            report.write(list(PIECES), arguments.quick)
        else:
            _measure(name, arguments.quick)


def _measure(name: str, quick: bool) -> None:
    absent: dict[str, str] = {}
    rows = []
    for row in PIECES[name](quick, absent):
        rows.append(row)
        # Whoever ends this early keeps what there is.
        report.keep(name, quick, rows, absent)
        errors = ", ".join(f"{key} {value:.3g}" for key, value in row.errors.items())
        print(f"{row.job}: {row.tool} {row.setting}: {row.cpu_seconds:.2f} CPU s, {errors}", file=sys.stderr)
    report.keep(name, quick, rows, absent)


def _truth(paths: int) -> None:
    """Writes the irradiance of the two rooms at points, by a long run of a path tracer."""
    scene = load(ROOT / "scenes" / "two-rooms.glb")
    points, normals = sample(scene, 300, seed=7)
    trace = path_tracer.tracer(Lit("", scene, points, normals, np.ones(len(points)), np.empty((0, 3))))
    halves = [trace(paths // 2, seed) for seed in (1, 2)]
    mean = (halves[0] + halves[1]) / 2
    # The halves differ by twice the noise of their mean.
    noise = np.linalg.norm(halves[0] - halves[1], axis=1) / 2 / np.linalg.norm(mean, axis=1)
    print(
        f"noise: {np.linalg.norm(halves[0] - halves[1]) / 2 / np.linalg.norm(mean):.2%} in L2, "
        f"{np.median(noise):.2%} in the median, {np.percentile(noise, 95):.2%} at the 95th percentile"
    )
    table = np.hstack([points, normals, mean])
    DATA.mkdir(exist_ok=True)
    np.savetxt(DATA / "two-rooms.csv", table, "%.7g", ",", header="x,y,z,nx,ny,nz,E_0,E_1,E_2", comments="")


if __name__ == "__main__":
    main()
