"""Progress, injected: library functions take any of these and know nothing of terminals."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any, Protocol, TypeVar

T = TypeVar("T")


class Progress(Protocol):
    """Wraps an iterable of known length and tells how far it is."""

    def __call__(self, items: Iterable[T], what: str, total: int) -> Iterator[T]:
        """Yield the items of a task called `what`."""
        ...


def no_progress(items: Iterable[T], what: str, total: int) -> Iterator[T]:
    """Yield the items and say nothing."""
    yield from items


def terminal_progress(items: Iterable[T], what: str, total: int) -> Iterator[T]:
    """Bar with rate and time left on standard error; plain lines where that is no terminal."""
    if sys.stderr.isatty():
        yield from _bar(items, what, total)
    else:
        yield from _lines(items, what, total)


def _bar(items: Iterable[T], what: str, total: int) -> Iterator[T]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    class Rate(TextColumn):
        def render(self, task: Any) -> Any:
            from rich.text import Text

            return Text(_rate(task.speed) if task.speed else "")

    columns = (TextColumn(f"{what:<32}"), BarColumn(), MofNCompleteColumn(), Rate(""), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        yield from bar.track(items, total=total)


def _lines(items: Iterable[T], what: str, total: int, every_s: float = 20.0) -> Iterator[T]:
    start = last = time.monotonic()
    done = 0
    for item in items:
        yield item
        done += 1
        now = time.monotonic()
        if now - last >= every_s and done < total:
            rate = done / (now - start)
            left = f"{(total - done) / rate:.0f} s left"
            print(f"{what}: {done}/{total}, {_rate(rate)}, {left}", file=sys.stderr, flush=True)
            last = now
    print(f"{what}: {done} in {time.monotonic() - start:.1f} s", file=sys.stderr, flush=True)


def _rate(a_second: float) -> str:
    """Items over time in the unit that reads best."""
    for unit, seconds in (("s", 1), ("min", 60)):
        if (rate := a_second * seconds) >= 1:
            return f"{rate:.0f}/{unit}" if rate >= 100 else f"{rate:.3g}/{unit}"
    return f"{a_second * 3600:.3g}/h"
