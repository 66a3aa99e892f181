"""A separate process: its results, rejections and failures."""

import os
import select
import subprocess
import sys
import time

import pytest

from barbalat import InputError
from barbalat.flights import SimulatorFailed
from barbalat.validate import positive
from barbalat.vehicles.isolated import isolated


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
    with pytest.raises(SimulatorFailed, match=r"did not finish within 0.5 s"):
        isolated(0.5, time.sleep, 600)


KILLED = """
from barbalat.vehicles.isolated import isolated
isolated(600, exec, "import time; told = open('told', 'w'); print(flush=True, file=told); time.sleep(600)")
"""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipe tells here when a process ends")
def test_it_ends_with_the_process_that_asked_and_leaves_no_folder(tmp_path):
    own = tmp_path / "temporary"
    own.mkdir()
    environment = {**os.environ, "TMPDIR": str(own), "PYTHONPATH": os.pathsep.join(part for part in sys.path if part)}
    told = tmp_path / "told"
    os.mkfifo(told)
    with (
        subprocess.Popen([sys.executable, "-c", KILLED], cwd=tmp_path, env=environment) as parent,
        told.open("rb", buffering=0) as said,  # returns when the child has opened it too
    ):
        assert said.read(1) == b"\n"
        assert any(own.iterdir())
        parent.kill()
        ended, _, _ = select.select([said], [], [], 60.0)
        assert ended, "the child runs on"
        assert said.read(1) == b""
    assert not any(own.iterdir())
