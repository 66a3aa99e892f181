"""A process of its own: what it returns, what it refuses, and what breaks in it."""

import os
import subprocess
import sys
import time

import pytest

from barbalat import InputError, SimulatorFailed
from barbalat.flight.isolated import isolated
from barbalat.validate import positive


def test_it_is_another_process_and_its_printing_stays_there(capfd):
    assert isolated(60, os.getpid) != os.getpid()
    assert isolated(60, max, [3, 1], default=0) == 3
    isolated(60, print, "JSBSim says hello")
    assert capfd.readouterr() == ("", "")


def test_what_a_function_refuses_is_refused_here():
    with pytest.raises(InputError, match=r"^mach must be positive, got -1"):
        isolated(60, positive, "mach", -1)


@pytest.mark.parametrize(
    ("function", "given", "sentence"),
    [
        (os.abort, (), "the simulator's process ended by signal 6"),
        (sys.exit, ("no such property: aero/alfa",), "ended with exit code 1, saying: no such property: aero/alfa"),
    ],
)
def test_a_crash_is_one_sentence(function, given, sentence):
    with pytest.raises(SimulatorFailed, match=sentence) as found:
        isolated(60, function, *given)
    assert "\n" not in str(found.value)


def test_what_does_not_end_is_stopped():
    with pytest.raises(SimulatorFailed, match=r"not done after 0.5 s"):
        isolated(0.5, time.sleep, 600)


def test_it_ends_with_the_process_that_asked(tmp_path):
    """However that ends: nothing computes on for nobody, and nothing of it lies about."""
    temporary = {"TMPDIR": str(tmp_path), "TEMP": str(tmp_path), "TMP": str(tmp_path)}
    busy = f"import pathlib\npathlib.Path({str(tmp_path / 'busy')!r}).touch()\nwhile True: pass"
    program = f"from barbalat.flight.isolated import isolated; isolated(60, exec, {busy!r})"
    asking = subprocess.Popen([sys.executable, "-c", program], env={**os.environ, **temporary})
    assert _comes((tmp_path / "busy").exists)
    asking.kill()
    asking.wait()
    assert _comes(lambda: [one.name for one in tmp_path.iterdir()] == ["busy"])


def _comes(holds, seconds=30.0):
    """Whether it holds before so many seconds are over."""
    end = time.monotonic() + seconds
    while not (found := holds()) and time.monotonic() < end:
        time.sleep(0.05)
    return found
