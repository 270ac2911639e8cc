"""`benches/peers/run`: measures, and writes the tables and the picture of the book."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator

import numpy as np

from . import factors, light, rays, report
from .measure import Row
from .scenes import DATA, ROOT, Lit, load, sample

SECTIONS: dict[str, Callable[[bool], Iterator[Row]]] = {
    "factors": factors.measure,
    "light": light.measure,
    "rays": rays.measure,
}


def truth(samples: int) -> None:
    """Writes the irradiance of the two rooms at points, by a long run of a path tracer."""
    scene = load(ROOT / "scenes" / "two-rooms.glb")
    points, normals = sample(scene, 300, seed=7)
    job = Lit("", scene, points, normals, np.ones(len(points)), np.empty((0, 3)))
    halves = [light.mitsuba_irradiance(job, samples // 2, seed) for seed in (1 << 20, 1 << 21)]
    noise = np.linalg.norm(halves[0] - halves[1], axis=1) / np.linalg.norm(halves[0] + halves[1], axis=1)
    print(
        f"noise: {np.linalg.norm(halves[0] - halves[1]) / np.linalg.norm(halves[0] + halves[1]):.2%} in L2, "
        f"{np.median(noise):.2%} in the median, {np.percentile(noise, 95):.2%} at the 95th percentile"
    )
    table = np.hstack([points, normals, (halves[0] + halves[1]) / 2])
    DATA.mkdir(exist_ok=True)
    np.savetxt(DATA / "two-rooms.csv", table, "%.7g", ",", header="x,y,z,nx,ny,nz,E_0,E_1,E_2", comments="")


def main() -> None:
    """Reads the arguments and does it."""
    parser = argparse.ArgumentParser(description="Hatbox beside other programs", prog="benches/peers/run")
    parser.add_argument("--quick", action="store_true", help="small jobs, and nothing is written into the book")
    parser.add_argument("--only", action="append", choices=SECTIONS, help="a section; may be given several times")
    parser.add_argument("--truth", type=int, metavar="PATHS", help="make data/two-rooms.csv again with so many a point")
    arguments = parser.parse_args()
    if arguments.truth:
        truth(arguments.truth)
        return
    rows = []
    for name in arguments.only or SECTIONS:
        for row in SECTIONS[name](arguments.quick):
            rows.append(row)
            print(f"{row.job}: {row.tool} {row.setting}: {row.cpu_seconds:.2f} CPU s, {row.errors}", file=sys.stderr)
    text = report.tables(rows)
    print(text)
    if not arguments.quick and not arguments.only:
        (ROOT / "book" / "peers.md").write_text(text + "\n", encoding="utf-8")
        report.plot(rows, ROOT / "book" / "images" / "peers.png")


if __name__ == "__main__":
    main()
