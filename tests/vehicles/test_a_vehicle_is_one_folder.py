"""A vehicle from outside the package is one folder that an entry point names. ``fly`` flies it through failures and with random
numbers."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vehicles import toy_boat


@pytest.fixture(scope="module")
def harbour(tmp_path_factory) -> Path:
    """A folder with the package and the files that an installer writes for its distribution."""
    folder = tmp_path_factory.mktemp("harbour")
    (folder / "harbour").mkdir()
    (folder / "harbour" / "__init__.py").touch()
    shutil.copy(toy_boat.__file__, folder / "harbour" / "vehicle.py")
    made = folder / "harbour-1.0.dist-info"
    made.mkdir()
    (made / "METADATA").write_text("Metadata-Version: 2.1\nName: harbour\nVersion: 1.0\n")
    (made / "entry_points.txt").write_text("[barbalat.vehicles]\nboats = harbour\n")
    return folder


def fly(harbour: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(harbour), *(part for part in sys.path if part)])}
    command = [sys.executable, "-m", "barbalat", "fly", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, cwd=harbour)


def test_it_flies_through_its_failures_and_has_its_pages(harbour):
    done = fly(harbour, "boat", "--delays", "--json", "--out", "flown")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["losses"] == {"Plain": 0, "ADRC": 0, "L1": 0} and list(document["failures"]) == ["none", "rudder-50"]
    errors = {name: flights["rudder-50"]["rms_e"] for name, flights in document["controllers"].items()}
    # with half a rudder x' = -x + u/2: without feedback of the error half the command is missing in the end
    assert 0.8 * toy_boat.RATE / 2 < errors["Plain"] < toy_boat.RATE / 2
    assert max(errors["ADRC"], errors["L1"]) < errors["Plain"] / 2
    # the open loop tolerates any delay that is tried
    assert document["delay_borne"]["Plain"] == pytest.approx(1.0)
    plain, adaptive = (document["controllers"][name] for name in ("Plain", "L1"))
    assert plain["none"]["verdict"]["class"] == adaptive["none"]["verdict"]["class"] == "follows"
    plain = plain["rudder-50"]["verdict"]
    assert plain["class"] == "off"
    assert plain["error"] == pytest.approx(toy_boat.RATE / 2, rel=0.1) and plain["at_limit"] == [0.0] and "suspect" not in plain
    assert "Plain: follows in 1, is off in 1 of 2 flights" in (harbour / "flown" / "report.html").read_text()
    left = {file.name for file in (harbour / "flown").iterdir()}
    assert left >= {"report.html", "flight.gif", "flight-rudder-50.csv", "path-rudder-50.png"}


def test_draws_of_it_are_flown(harbour):
    done = fly(harbour, "boat", "--schemes", "plain,l1", "--dispersions", "3", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["conditions"] == ["in calm water"] and document["units"]["travel"] == "deg/s"
    assert document["failures"]["none"]["L1"]["lost"]["count"] == 0
    assert 0.8 < document["first_draw"]["dispersion.drag"] < 1.2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("ship",), "NAME must be one of f16-pitch, f16-roll, quadrotor, boat"),
        (("boat", "--schemes", "lqr"), "here it is plain"),
        (("boat", "--mach", "0.5"), "a boat has no altitude"),
    ],
)
def test_bad_input_is_one_sentence(harbour, arguments, said):
    done = fly(harbour, *arguments)
    assert done.returncode == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1
