"""The tables and the plots."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
import subprocess
from collections.abc import Iterable
from pathlib import Path

import hatbox

from .measure import Row

PEERS = ("mitsuba", "pyradiance", "pyviewfactor", "raystrack", "embreex")


def machine() -> str:
    """The processor, its number of threads, and how busy it is."""
    model = platform.processor() or platform.machine()
    try:
        found = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        model = f"{len(found)} × {found[0].split(':')[1].strip()}"
        model += f", load {Path('/proc/loadavg').read_text().split()[0]}"
    except (OSError, IndexError):
        pass
    return model


def versions() -> str:
    """Versions of all programs; absent ones are named."""
    text = [f"hatbox {hatbox.__version__}"]
    for peer in PEERS:
        try:
            text.append(f"{peer} {importlib.metadata.version(peer)}")
        except importlib.metadata.PackageNotFoundError:
            text.append(f"{peer} absent")
    return ", ".join(text)


def _number(value: float, key: str) -> str:
    return f"{value:.2f}" if key.startswith("million") else f"{100 * value:.3g} %"


def tables(rows: list[Row]) -> str:
    """A table per job in Markdown; what is dominated by another tool says so."""
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    text = [
        "<!-- Written by benches/peers/run; do not edit. -->",
        f"{datetime.date.today()}, {machine()}. {versions()}; commit {commit.stdout.strip() or 'unknown'}. `s` is the time",
        "from the scene to the result, `CPU s` the sum over processors; on a busy machine the second is the one to compare.",
        "",
    ]
    for job in dict.fromkeys(row.job for row in rows):
        mine = [row for row in rows if row.job == job]
        keys = list(mine[0].errors)
        text.append(f"**{job[0].upper()}{job[1:]}**\n")
        text.append("| program | setting | s | CPU s | " + " | ".join(keys) + " |")
        text.append("|---|---|---:|---:|" + "---:|" * len(keys))
        for row in mine:
            errors = " | ".join(_number(row.errors[key], key) for key in keys)
            text.append(f"| {row.tool} | {row.setting} | {row.seconds:.3g} | {row.cpu_seconds:.3g} | {errors} |")
        text += ["", *_verdict(mine, keys[0]), ""]
    return "\n".join(text)


def _verdict(rows: list[Row], key: str) -> Iterable[str]:
    """Says by whom Hatbox is beaten: less time of processors and less error at once."""
    if key.startswith("million"):
        return
    mine = [row for row in rows if row.tool == "hatbox"]
    for row in mine:
        better = {
            other.tool
            for other in rows
            if other.tool != "hatbox" and other.cpu_seconds < row.cpu_seconds and other.errors[key] < row.errors[key]
        }
        if better:
            yield f"Hatbox **loses** at `{row.setting}`: {', '.join(sorted(better))} is faster and more accurate.\n"


def plot(rows: list[Row], path: Path) -> None:
    """Time against error, a picture per scene."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    jobs = [job for job in dict.fromkeys(row.job for row in rows if "L2" in row.errors) if "relit" not in job]
    if not jobs:
        return
    figure, axes = plt.subplots(1, len(jobs), figsize=(5.5 * len(jobs), 4.2), layout="constrained", squeeze=False)
    for job, ax in zip(jobs, axes[0], strict=True):
        mine = [row for row in rows if row.job == job]
        for tool in dict.fromkeys(row.tool for row in mine):
            points = sorted((row.cpu_seconds, row.errors["L2"], row.errors["95 %"]) for row in mine if row.tool == tool)
            seconds, l2, high = zip(*points, strict=True)
            line = ax.loglog(seconds, [100 * e for e in l2], "o-", label=f"{tool}, L2")[0]
            ax.loglog(seconds, [100 * e for e in high], "^:", color=line.get_color(), label=f"{tool}, 95 %")
        ax.set(title=job, xlabel="seconds of all processors", ylabel="relative error of the irradiance (%)")
        ax.grid(visible=True, which="both", alpha=0.2)
        ax.legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)
