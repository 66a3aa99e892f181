"""The completed fraction of the work and the remaining time, by a clock that the test sets."""

import io
import sys
import time

import pytest
from rich.console import Console

from barbalat.commands import progress
from barbalat.commands.progress import Work, say


@pytest.fixture
def clock(monkeypatch):
    """Advance the clock by these seconds, in which this process had the given fraction of a core."""
    now = [100.0, 1.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(time, "process_time", lambda: 100.0 + now[1] * (now[0] - 100.0))
    return now


def test_it_never_runs_backwards_and_is_right_within_a_factor_of_two(clock):
    """One part takes four times its estimate, the other one as long as expected."""
    work, seen = Work({"simulating": 5.0, "drawing": 2.0}, Console()), []
    with work.part("simulating") as progress:
        for k in range(1, 21):
            clock[0] += 1.0
            progress(k / 20)
            progress(k / 40)  # reported late by a different thread
            true = (20 - k) + 2
            assert true / 2 <= work.left <= 2 * true
            seen.append(work.over)
    with work.part("drawing"):
        for _ in range(8):
            clock[0] += 0.25
            seen.append(work.over)
    assert seen == sorted(seen) and 0.9 < seen[-1] <= 1


def test_between_two_reports_the_time_goes_on(clock):
    work = Work({"all": 60.0}, Console())
    with work.part("all") as progress:
        clock[0] += 10
        progress(0.25)
        assert work.left == pytest.approx(30)
        clock[0] += 12
        assert work.left == pytest.approx(18)


def test_what_is_overdue_still_takes_a_moment(clock):
    work = Work({"certifying": 1.0}, Console())
    with work.part("certifying"):
        clock[0] += 20
        assert work.left == pytest.approx(10)  # unknown, so half of the elapsed time is assumed
    assert work.left == 0


def test_on_a_busy_machine_all_takes_as_much_longer(clock):
    """With a quarter of a core 20 s of work take 80 s. This does not apply to the parts done by other processes."""
    clock[1] = 0.25
    for here, whole in ((True, 80.0), (False, 20.0)):
        work = Work({"certifying": 12.0, "drawing": 8.0}, Console())
        with work.part("certifying", here=here):
            clock[0] += 10.0
            assert (whole - 10.0) / 1.5 <= work.left <= 1.5 * (whole - 10.0)


def test_no_time_is_told_before_it_is_known_within_a_factor_of_two(clock):
    """The remaining time is shown for a part with a known pace. It is not shown while most of it is only an estimate, which is
    wrong by a factor of three here."""
    work = Work({"simulating": 30.0, "drawing": 4.1}, Console())
    known = []
    with work.part("simulating") as progress:
        assert not work.known
        for k in range(1, 41):
            clock[0] += 1.0
            progress(k / 40)
            if work.known:
                known.append(k)
                true = (40 - k) + 3 * 4.1
                assert true / 2 <= work.left <= 2 * true
    assert known == list(range(5, 36))
    with work.part("drawing"):
        clock[0] += 6.0
        assert not work.known


def test_of_a_long_part_the_time_is_told_from_the_first_hundredths_on(clock):
    work, known = Work({"all": 5.0}, Console()), []
    with work.part("all") as progress:
        for k in range(1, 301):
            clock[0] += 1.0
            progress(k / 300)
            if work.known:
                known.append(k)
                assert (300 - k) / 2 <= work.left <= 2 * (300 - k)
    assert known == list(range(31, 301))


def test_what_is_started_once_is_no_pace(clock):
    """Compilation takes 20 s and everything else 10 s. The overall pace would predict 400 s, then 200 s."""
    work, known = Work({"all": 5.0}, Console()), []
    with work.part("all") as progress:
        clock[0] += 20.0
        for k in range(1, 21):
            clock[0] += 0.5
            progress(k / 20)
            if work.known:
                known.append(k)
                assert (20 - k) / 4 <= work.left <= 20 - k + 1e-9
    assert known == list(range(5, 21))


class Terminal(io.StringIO):
    """Standard error on a terminal."""

    def isatty(self):
        return True


def test_a_long_sentence_is_folded_on_a_terminal_and_one_line_elsewhere(monkeypatch):
    """No line exceeds the width or ends between a number and its unit, and nothing else is changed."""
    text = "barbalat: controller 1 (model reference adaptive): sample_time must be so many whole steps of 0.001 s, got 0.0105 s"
    for stream, lines in ((Terminal(), 3), (io.StringIO(), 1)):
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setenv("COLUMNS", "60")
        say(text)
        shown = stream.getvalue().splitlines()
        assert len(shown) == lines and " ".join(" ".join(shown).split()) == text
        assert lines == 1 or (max(map(len, shown)) <= 60 and "0.001 s," in stream.getvalue())


def test_without_a_terminal_a_long_work_says_how_far_it_is(monkeypatch, capsys):
    """In a log or a pipe there is no bar. At first there is nothing, then one line, and nothing after the end of the work."""
    monkeypatch.setattr(progress, "FIRST_LINE", 0.01)
    with progress.work({"contest": 100.0}) as running, running.part("contest") as advanced:
        advanced(0.25)
        said = ""
        while "%" not in said:
            said += capsys.readouterr().err
    assert said.startswith("contest: ") and " %, " in said and said.splitlines()[0].endswith(("so far", "left"))
    monkeypatch.undo()
    capsys.readouterr()
    with progress.work({"contest": 1.0}) as running, running.part("contest"):
        pass
    assert capsys.readouterr().err == ""
