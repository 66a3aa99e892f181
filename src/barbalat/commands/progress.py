"""Shows a command's progress and notes to a person, on standard error."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
import time
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Task

    from barbalat.budget import Progress


SECONDS_EACH_STEP = 10e-9
"""Speed for a small loop on one core, in steps per second."""
TOLD_FRACTION = 0.02
"""Fraction of a part after which its pace, and not the expectation, determines its duration."""

KNOWN_AFTER = ((0.1, 2.0), (0.02, 30.0))
"""Fraction of a part, or the seconds since its first report, after which the pace is known within a factor of two and the
remaining time is printed. Measured on sweep, tune, tradeoff and reproduce, with other work on the machine."""
FEWEST_REPORTS = 3
"""Smallest number of reports of a part after which its pace is known."""
RECENT_SHARE = 0.5
"""The recent pace is measured over this fraction of the work done since a part's first report."""
AGREEING = 2.0
"""If the two paces differ by at most this factor, a value between them is used."""

OVERDUE_SHARE = 0.5
"""Overdue work is expected to take this fraction of the time since the last report; it is as likely to take longer as shorter."""


SHORTEST_SECONDS = 1e-9
"""Smallest assumed difference [s] between two readings of a clock, used if the clock has not advanced."""
CERTAIN_AFTER = 1.0
"""Time [s] after which the measured fraction of a core is used."""


class Work:
    """The finished fraction of a command's work and the remaining seconds, from the expected seconds of its parts.

    Messages in the meantime go to ``console``, above the bar.
    """

    def __init__(self, expected: Mapping[str, float], console: Console) -> None:
        self.to_come, self.console = dict(expected), console
        self.started = self.begun = self.updated = time.perf_counter()
        self.computed, self.here = time.process_time(), True
        self.name, self.fraction, self.told, self.expected = "", 0.0, 0.0, 0.0
        self.reports: list[tuple[float, float]] = []

    @contextlib.contextmanager
    def part(self, name: str, *, here: bool = True) -> Iterator[Progress]:
        """Start one of the parts. Yield a function that takes the finished fraction of the part.

        here whether this process does the work; its share of a core then gives the factor by which everything takes longer
        """
        self.expected, self.name, self.fraction = self.to_come.pop(name, 1.0), name, 0.0
        self.begun = self.updated = time.perf_counter()
        self.here, self.reports = here, []
        yield self._advanced
        self.name = ""

    def _advanced(self, fraction: float) -> None:
        if fraction > self.fraction:
            self.fraction, self.updated = fraction, time.perf_counter()
            self.reports.append((self.updated, fraction))

    @property
    def left(self) -> float:
        """The expected number of remaining seconds."""
        if not self.name:
            return sum(self.to_come.values()) * self._stretch
        now, rest = time.perf_counter(), self.expected * self._stretch
        if self.fraction >= TOLD_FRACTION:
            rest = (1 - self.fraction) / math.sqrt(math.prod(self._paces))
        behind = now - (self.updated if self.fraction >= TOLD_FRACTION else self.begun)
        return sum(self.to_come.values()) * self._stretch + max(rest - behind, OVERDUE_SHARE * behind)

    @property
    def known(self) -> bool:
        """Whether ``left`` is right within a factor of two.

        This requires that the pace of the current part determines it rather than the expectation for other parts. An expectation
        may be wrong by a factor of three; if it is the smaller half of a sum, the sum is wrong by at most a factor of two.
        """
        if len(self.reports) < FEWEST_REPORTS:
            return False
        (first, told), to_come = self.reports[0], sum(self.to_come.values()) * self._stretch
        seen = any(self.fraction - told >= share and self.updated - first >= seconds for share, seconds in KNOWN_AFTER)
        slower, faster = sorted(self._paces)
        return seen and faster <= AGREEING * slower and to_come <= self.left / 2

    @property
    def _paces(self) -> tuple[float, float]:
        """The fractions of the part that are finished per second, since the first report and in the recent past."""
        if len(self.reports) < FEWEST_REPORTS:
            in_all = self.fraction / max(self.updated - self.begun, SHORTEST_SECONDS)
            return in_all, in_all
        first = self.reports[0]
        wanted = first[1] + (1 - RECENT_SHARE) * (self.fraction - first[1])
        lately = self.reports[min(bisect_right(self.reports, wanted, key=lambda one: one[1]), len(self.reports) - 1) - 1]
        return self._since(*first), self._since(*lately)

    def _since(self, instant: float, fraction: float) -> float:
        return (self.fraction - fraction) / max(self.updated - instant, SHORTEST_SECONDS)

    @property
    def _stretch(self) -> float:
        """The elapsed seconds per second of computing, which is the factor by which work takes longer than on an idle machine."""
        if not self.here:
            return 1.0
        computed = time.process_time() - self.computed
        return max((self.gone + CERTAIN_AFTER) / (computed + CERTAIN_AFTER), 1.0)

    @property
    def gone(self) -> float:
        """The number of seconds since the start."""
        return time.perf_counter() - self.started

    @property
    def over(self) -> float:
        """The elapsed fraction of the time, which never decreases."""
        self.told = max(self.told, self.gone / (self.gone + self.left + 1e-9))
        return self.told


@contextlib.contextmanager
def work(expected: Mapping[str, float]) -> Iterator[Work]:
    """Show a bar on standard error for parts with these expected seconds or, without a terminal, an occasional line."""
    from rich.progress import BarColumn, ProgressColumn, TextColumn
    from rich.progress import Progress as Bars
    from rich.text import Text

    from barbalat.report.terminal.layout import console

    class Left(ProgressColumn):
        max_refresh = 0.5

        def render(self, task: Task) -> Text:
            bars.update(task.id, completed=running.over, description=running.name)
            return Text(_how_far(running))

    screen = console(to_standard_error=True)
    running = Work(expected, screen)
    bars = Bars(
        TextColumn("{task.description}"), BarColumn(bar_width=20), Left(),
        console=screen, transient=True, disable=not screen.is_terminal,
    )  # fmt: skip
    with bars, contextlib.nullcontext() if screen.is_terminal else _lines(running):
        bars.add_task("", total=1.0)
        yield running


def _how_far(running: Work) -> str:
    over = running.over
    said = f"about {_duration(running.left)} left" if running.known else f"{_duration(running.gone)} so far"
    return f"{100 * over:3.0f} %, {said}"


FIRST_LINE, LONGEST_SILENCE = 20.0, 160.0
"""Time [s] until the first line if there is no bar, and longest pause [s] between two lines. Each pause is twice the previous
one."""


@contextlib.contextmanager
def _lines(running: Work) -> Iterator[None]:
    """Report the progress to a log or a reader of the command's standard error."""
    over = threading.Event()

    def tell() -> None:
        pause = FIRST_LINE
        while not over.wait(pause):
            say(f"{running.name or 'working'}: {_how_far(running).strip()}")
            pause = min(2 * pause, LONGEST_SILENCE)

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        over.set()
        teller.join()


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 99.5 else f"{seconds / 60:.0f} min"


def say(text: str) -> None:
    """Print a line on standard error. On a narrow terminal the line is folded, but not within a number."""
    if not text.isprintable():
        from barbalat.validate import printable

        text = printable(text)
    if sys.stderr.isatty() and len(text) > NARROWEST:
        from barbalat.report.terminal.layout import Screen, console

        Screen(console(to_standard_error=True), longest=len(text)).line(text.strip(), "", INDENT, text[: -len(text.lstrip())])
        return
    print(text, file=sys.stderr)  # noqa: T201


NARROWEST = 40
"""Number of columns that every terminal is assumed to have."""
INDENT = " " * len("barbalat: ")
"""Indentation of the continuation lines of a sentence."""
