"""Standard output and error that are closed, on a full disk or without a reader: every command behaves in the same way."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from barbalat import cli
from barbalat.cases.bundled import bundled
from barbalat.commands import cases

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no descriptors that a shell closes")
full_disk = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"} | {
    "PYTHONPATH": os.pathsep.join(sys.path)
}
CASE = bundled()["paper"].read_text().replace("t_end = 60.0", "t_end = 0.5").replace("dt = 1e-4", "dt = 1e-3")
CLOSED = "barbalat: cannot write to standard output: it is closed; redirect it to a file, to a pipe, or to the null device\n"
FULL = "barbalat: cannot write to standard output: No space left on device\n"
COMMANDS = [
    "cases",
    "schema",
    "claims",
    "claims --json",
    "completion bash",
    "--help",
    "run --help",
    "--version",
    "run case.toml --json",
    "run case.toml --no-plots",
    "certify case.toml",
    "certify case.toml --json",
    "sweep case.toml --vary controller[1].gamma=1:2:2 --json",
    "new other.toml --json",
    "explore case.toml --no-open --json",
]
KEPT = ("run --help", "run case.toml --json")


@pytest.fixture
def place(tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    return tmp_path


def shell(line, folder, **environment):
    """Run a command line with redirections and return its exit code and its standard error."""
    done = subprocess.run(
        ["bash", "-c", line.replace("barbalat", f"'{sys.executable}' -m barbalat", 1)],
        cwd=folder, env=ENVIRONMENT | environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stderr, done.stdout


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("arguments", COMMANDS)
@pytest.mark.short(kept=lambda arguments, unbuffered: arguments in KEPT and not unbuffered)
def test_a_closed_standard_output(arguments, unbuffered, place):
    """There is one sentence before any work, and no files are left."""
    assert shell(f"barbalat {arguments} >&-", place, PYTHONUNBUFFERED=unbuffered)[:2] == (1, CLOSED)
    assert shell(f"barbalat {arguments} >&- 2>&-", place, PYTHONUNBUFFERED=unbuffered)[:2] == (1, "")
    assert [file.name for file in place.iterdir()] == ["case.toml"]


@full_disk
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("arguments", COMMANDS)
@pytest.mark.short(kept=lambda arguments, unbuffered: arguments == "cases" and not unbuffered)
def test_standard_output_on_a_full_disk(arguments, unbuffered, place):
    code, said, _ = shell(f"barbalat {arguments} >/dev/full", place, PYTHONUNBUFFERED=unbuffered)
    assert code == 1 and said.splitlines(keepends=True)[-1] == FULL and "Traceback" not in said


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("arguments", COMMANDS)
@pytest.mark.short(kept=lambda arguments, unbuffered: arguments == "cases" and not unbuffered)
def test_a_reader_that_left(arguments, unbuffered, place):
    """The command is silent and has the exit code of a process ended by SIGPIPE."""
    line = f"barbalat {arguments} 2>said | true; echo ${{PIPESTATUS[0]}}"
    _, _, code = shell(line, place, PYTHONUNBUFFERED=unbuffered)
    said = (place / "said").read_text()
    assert code == "141\n" and "Traceback" not in said and "Exception" not in said and "cannot write" not in said


@pytest.mark.parametrize("lost", ["2>&-", pytest.param("2>/dev/full", marks=full_disk), "2> >(true)"])
@pytest.mark.parametrize(
    ("arguments", "code"), [("cases", 0), ("new new.toml", 0), ("runn", 2), ("run nowhere", 2), ("run case.toml --json", 0)]
)
@pytest.mark.short(kept=lambda arguments, code, lost: arguments == "new new.toml")
def test_notes_that_are_lost_change_nothing(arguments, code, lost, place):
    """Neither the exit code nor the output changes, and no note is mixed with results."""
    told = shell(f"barbalat {arguments}", place)[2]
    (place / "new.toml").unlink(missing_ok=True)
    assert shell(f"barbalat {arguments} {lost}", place) == (code, "", told)


def test_a_file_does_not_get_the_number_of_closed_standard_error(place):
    """Otherwise a library's output would go into the next file that is opened."""
    script = """
import os
from barbalat.commands.streams import notes
with notes(), open("results", "wb") as file:
    os.write(2, b"a warning")
    print(file.fileno() > 2)
"""
    (place / "script.py").write_text(script)
    done = subprocess.run(
        ["bash", "-c", f"'{sys.executable}' script.py 2>&-"],
        cwd=place, env=ENVIRONMENT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "True\n" and (place / "results").read_bytes() == b""


def test_another_pipe_that_breaks_is_told(monkeypatch, capsys):
    """An example is a worker's pipe. Only a closed standard output ends the command silently."""

    def broken(_):
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr(cases, "execute", broken)
    assert cli.main(["cases"]) == 1
    assert "Broken pipe" in capsys.readouterr().err


@pytest.mark.parametrize("unbuffered", ["", "1"], ids=["buffered", "PYTHONUNBUFFERED"])
def test_notes_come_at_once(unbuffered, tmp_path):
    """Progress appears during the work and not only at its end, also without Python's buffering."""
    code = "import os, sys\nfrom barbalat.commands.streams import notes\n"
    code += "with notes():\n    print('now', file=sys.stderr)\n    os._exit(0)"
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    with (tmp_path / "notes").open("w") as file:
        subprocess.run([sys.executable, "-c", code], stderr=file, env=environment, check=True)
    assert (tmp_path / "notes").read_text() == "now\n"
