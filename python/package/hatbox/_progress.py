"""A bar on standard error while the work lasts."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Reporter = Callable[[str, int, int], None]

_WIDTH = 30


class _Plain:
    """A bar of characters."""

    def __init__(self) -> None:
        self._length = 0

    def show(self, stage: str, done: int, total: int) -> None:
        share = min(done / total, 1.0) if total else 0.0
        text = f"{stage:>20} {'#' * round(share * _WIDTH):<{_WIDTH}} {share:4.0%}"
        sys.stderr.write("\r" + text.ljust(self._length))
        sys.stderr.flush()
        self._length = len(text)

    def close(self) -> None:
        if self._length:
            sys.stderr.write("\r" + " " * self._length + "\r")
            sys.stderr.flush()


class _Tqdm:
    """tqdm's bar, in notebooks too."""

    def __init__(self, tqdm: Any) -> None:
        self._tqdm = tqdm
        self._bar: Any = None
        self._stage = ""

    def show(self, stage: str, done: int, total: int) -> None:
        if stage != self._stage:
            self.close()
            self._stage = stage
            self._bar = self._tqdm(total=total, desc=stage, leave=False, file=sys.stderr)
        self._bar.total, self._bar.n = total, min(done, total)
        self._bar.refresh()

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None


@contextmanager
def bar(visible: bool) -> Iterator[Reporter | None]:
    """A function that draws where the work is, or `None` where nobody would see it: no terminal and no notebook."""
    notebook = "ipykernel" in sys.modules
    if not visible or not (notebook or sys.stderr.isatty()):
        yield None
        return
    drawn = _make()
    try:
        yield drawn.show
    finally:
        drawn.close()


def _make() -> _Plain | _Tqdm:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return _Plain()
    return _Tqdm(tqdm)
