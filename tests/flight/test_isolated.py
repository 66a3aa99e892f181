"""A process of its own: what it returns, what it refuses, and what breaks in it."""

import os
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
