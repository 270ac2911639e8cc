"""What was measured: kept piece by piece, then written into the book as tables and pictures."""

from __future__ import annotations

import datetime
import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import hatbox

from .measure import Row
from .rays import RATE
from .scenes import ROOT
from .terrain import MEMORY

PEERS = ("mitsuba", "pyradiance", "pyviewfactor", "raystrack", "embreex")
BOOK = ROOT / "book" / "benchmarks.md"
IMAGES = ROOT / "book" / "images"
BEGIN, END = "<!-- peers: written by `benches/peers/run report` -->", "<!-- peers: end -->"


def keep(piece: str, quick: bool, rows: list[Row], absent: dict[str, str]) -> None:
    """Keeps what was measured, with what it was measured on."""
    found = {
        "date": str(datetime.date.today()),
        "machine": _machine(),
        "commit": _commit(),
        "versions": _versions(),
        "absent": absent,
        "rows": [asdict(row) for row in rows],
    }
    path = _path(piece, quick)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=1), encoding="utf-8")


def write(pieces: list[str], quick: bool) -> None:
    """Writes tables and pictures of all pieces into the book; those of quick jobs go to standard output only."""
    found = {piece: json.loads(_path(piece, quick).read_text()) for piece in pieces if _path(piece, quick).exists()}
    text = "\n".join(_section(piece, facts) for piece, facts in found.items())
    if quick:
        print(text)
        return
    rows = [row for facts in found.values() for row in _rows(facts)]
    light, cube = [row for row in rows if row.again is not None], [row for row in rows if row.job.startswith("cube")]
    if light:
        _plot(light, ("L2", "95 %"), "irradiance", IMAGES / "peers-light.png")
        text += "\n![Time against error: irradiance](images/peers-light.png)\n"
    if cube:
        _plot(cube, ("L2",), "view factors", IMAGES / "peers-factors.png")
        text += "\n![Time against error: view factors of the closed cube](images/peers-factors.png)\n"
    before, rest = BOOK.read_text(encoding="utf-8").split(BEGIN)
    BOOK.write_text(f"{before}{BEGIN}\n\n{text}\n{END}{rest.split(END)[1]}", encoding="utf-8")


def _path(piece: str, quick: bool) -> Path:
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    return target / "peers" / ("quick" if quick else "results") / f"{piece}.json"


def _rows(facts: dict[str, Any]) -> list[Row]:
    return [Row(**row) for row in facts["rows"]]


def _machine() -> str:
    """The processor and its number of threads."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        models = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
        return f"{len(models)} threads of {models[0]}"
    except (OSError, IndexError):
        return f"{os.cpu_count()} threads of {platform.processor() or platform.machine()}"


def _commit() -> str:
    command = ["git", "describe", "--always", "--dirty"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


def _versions() -> dict[str, str]:
    versions = {"hatbox": hatbox.__version__}
    for peer in PEERS:
        try:
            versions[peer] = importlib.metadata.version(peer)
        except importlib.metadata.PackageNotFoundError:
            versions[peer] = "absent"
    return versions


def _section(piece: str, facts: dict[str, Any]) -> str:
    """The tables of a piece, and under what they were made."""
    rows = _rows(facts)
    versions = ", ".join(f"{name} {version}" for name, version in facts["versions"].items())
    head = f"`benches/peers/run {piece}`: {facts['date']}, {facts['machine']}, commit {facts['commit']}; {versions}."
    absent = [f"Absent: {tool} ({reason})." for tool, reason in facts["absent"].items()]
    rates = [row for row in rows if RATE in row.errors]
    tables = [_rates(rates)] if rates else [_table(job, rows) for job in dict.fromkeys(row.job for row in rows)]
    return "\n\n".join([" ".join([head, *absent]), *tables]) + "\n"


def _table(job: str, rows: list[Row]) -> str:
    """One job in Markdown. The last column compares with the cheapest of ours that is at least as accurate."""
    rows = [row for row in rows if row.job == job]
    keys, lamps = list(rows[0].errors), rows[0].again is not None
    heads = ["program", "setting", "s", "CPU s", *keys, *(["other lamp, CPU s"] if lamps else []), "Hatbox beside it"]
    text = [f"**{job[0].upper()}{job[1:]}**", ""]
    text += ["| " + " | ".join(heads) + " |", "|---|---|" + "---:|" * (len(heads) - 2)]
    for row in rows:
        cells = [row.tool, f"{row.series} {row.setting}".strip(), f"{row.seconds:.3g}", f"{row.cpu_seconds:.3g}"]
        cells += [f"{row.errors[key]:.3g}" if key == MEMORY else f"{100 * row.errors[key]:.2g} %" for key in keys]
        cells += [f"{row.again:.2g}"] if row.again is not None else []
        text.append("| " + " | ".join([*cells, beside(row, rows)]) + " |")
    return "\n".join(text)


def beside(peer: Row, rows: Iterable[Row]) -> str:
    """How Hatbox compares with a row of another tool, at its error or a smaller one, in seconds of all processors."""
    if peer.tool == "hatbox":
        return ""
    key = next(iter(peer.errors))
    times = [row.cpu_seconds for row in rows if row.tool == "hatbox" and row.errors[key] <= peer.errors[key]]
    if not times:
        return "**loses**: not as accurate"
    ratio = peer.cpu_seconds / min(times)
    return f"{ratio:.2g} × faster" if ratio >= 1 else f"**loses**: {1 / ratio:.2g} × slower"


def _rates(rows: list[Row]) -> str:
    """Rays a second, a line for each job."""
    heads = "| millions of rays a second | hatbox | embree, robust | | embree, default | |"
    text = [heads, "|---|---:|---:|---|---:|---|"]
    for job in dict.fromkeys(row.job for row in rows):
        ours, robust, default = (row.errors[RATE] for row in rows if row.job == job)
        cells = [f"{rate:.2f} | {_won(ours / rate)}" for rate in (robust, default)]
        text.append(f"| {job} | {ours:.2f} | " + " | ".join(cells) + " |")
    return "\n".join(text)


def _won(ratio: float) -> str:
    return f"{ratio:.2f}" if ratio >= 1 else f"{ratio:.2f}, **loses**"


def _series(rows: list[Row]) -> Iterator[tuple[str, str, list[Row]]]:
    """Tool, label, and rows in the order of time."""
    for tool, series in dict.fromkeys((row.tool, row.series) for row in rows):
        mine = [row for row in rows if (row.tool, row.series) == (tool, series)]
        yield tool, f"{tool}, {series}" if series else tool, sorted(mine, key=lambda row: row.cpu_seconds)


def _plot(rows: list[Row], keys: tuple[str, ...], what: str, path: Path) -> None:
    """Time against error: a column of pictures for each job, a line of them for each measure of the error."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator

    jobs = list(dict.fromkeys(row.job for row in rows))
    size = (5.2 * len(jobs), 3.6 * len(keys))
    figure, grid = plt.subplots(len(keys), len(jobs), figsize=size, layout="constrained", squeeze=False, sharex="col")
    colors = {tool: f"C{k}" for k, tool in enumerate(dict.fromkeys(row.tool for row in rows))}
    styles = ["o-", "s--", "D-", "^:", "v-."]
    for (line, key), (column, job) in ((a, b) for a in enumerate(keys) for b in enumerate(jobs)):
        ax, used = grid[line, column], dict.fromkeys(colors, 0)
        for tool, label, mine in _series([row for row in rows if row.job == job]):
            times, errors = [row.cpu_seconds for row in mine], [100 * row.errors[key] for row in mine]
            look = {"color": colors[tool], "markersize": 4, "linewidth": 1.2, "label": label}
            ax.loglog(times, errors, styles[used[tool] % len(styles)], **look)
            used[tool] += 1
        ax.grid(visible=True, which="both", alpha=0.2)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_locator(LogLocator(subs=(2, 5)))
            axis.set_minor_formatter("{x:g}")
        ax.tick_params(which="both", labelsize=7)
        ax.set_ylabel(f"relative error of the {what}, {key} (%)", fontsize=9)
        if line == 0:
            ax.set_title(job)
        if line == len(keys) - 1:
            ax.set_xlabel("seconds of all processors")
    known = {label: line for ax in grid.flat for line, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=4, fontsize=7)
    figure.savefig(path, dpi=110)
    plt.close(figure)
