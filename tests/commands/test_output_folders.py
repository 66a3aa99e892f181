"""The files that the commands leave on disk: all files of a run or none, and one sentence if the system rejects."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from barbalat.cases.bundled import bundled
from barbalat.cli import main

CASE = bundled()["paper"].read_text().replace("t_end = 60.0", "t_end = 0.5").replace("dt = 1e-4", "dt = 1e-3")
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONDONTWRITEBYTECODE": "1"}
"""No bytecode is written, because on a full disk Python would leave half of a module's code, with which the next process
fails."""


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    return path


def command(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "barbalat", *map(str, arguments)],
        stderr=subprocess.PIPE,
        env=ENVIRONMENT,
        check=False,
        text=True,
        **options,
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "s3://bucket/case.toml"],
        ["certify", "first-order", "--out", "s3://bucket/pages"],
        ["explore", "first-order", "--out", "s3://page.html"],
        ["new", "ftp://host/case.toml"],
    ],
)
def test_a_url_is_no_path(arguments, tmp_path, monkeypatch, capsys):
    """A URL taken as a path would create a folder named after its scheme."""
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert "must be a path on this computer, not a URL" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def one_sentence(text):
    return len(text.splitlines()) == 1 and text.startswith("barbalat: ")


def test_a_later_run_takes_the_place_of_an_earlier_one(case_file, tmp_path):
    out = tmp_path / "out"
    assert main(["run", str(case_file), "--out", str(out)]) == 0
    assert {path.name for path in out.glob("*.csv")} == {"1-robust-mrac.csv", "2-l1.csv", "3-mrac.csv"}
    for name in ("4-mine.csv", "notes.txt"):
        (out / name).write_text("mine")
    case_file.write_text(CASE[: CASE.index("[[controller]]")] + '[[controller]]\nname = "A"\nscheme = "mrac"\ngamma = 1.0\n')
    assert main(["run", str(case_file), "--out", str(out), "--no-plots"]) == 0
    assert {path.name for path in out.iterdir()} == {"run.json", "datapackage.json", "1-a.csv", "4-mine.csv", "notes.txt"}


@pytest.mark.skipif(sys.platform == "win32", reason="no flock")
def test_two_processes_do_not_share_a_folder(case_file, tmp_path, capsys):
    import fcntl

    out = tmp_path / "out"
    out.mkdir()
    handle = os.open(out, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    assert main(["run", str(case_file), "--out", str(out)]) == 2
    assert "in use by another run" in capsys.readouterr().err and not list(out.iterdir())
    os.close(handle)  # or the end of the process
    assert main(["run", str(case_file), "--out", str(out), "--no-plots"]) == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("arguments", [["run", "--json"], ["run", "--no-plots"], ["certify"], ["cases"]])
@pytest.mark.short(kept=lambda arguments: arguments in (["run", "--json"], ["cases"]))
def test_a_full_standard_output_is_one_sentence(arguments, case_file, tmp_path):
    name, *options = arguments
    with Path("/dev/full").open("w") as full:
        done = command(name, *([] if name == "cases" else [case_file]), *options, stdout=full, cwd=tmp_path)
    assert done.returncode == 1 and one_sentence(done.stderr) and "No space left" in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of resources")
@pytest.mark.dear
def test_a_full_disk_is_one_sentence_and_leaves_nothing(case_file, tmp_path):
    """A limit on file sizes simulates a full disk; the previous run stays complete."""
    import resource

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))

    for out in (tmp_path / "new", tmp_path / "old"):
        pictures = [] if out.name == "new" else ["--no-plots"]
        if out.name == "old":
            assert main(["run", str(case_file), "--out", str(out), "--no-plots"]) == 0
        before = {path.name: path.read_bytes() for path in out.iterdir()} if out.exists() else None
        done = command("run", case_file, "--out", out, "--json", *pictures, stdout=subprocess.PIPE, preexec_fn=limit)
        assert done.returncode == 1 and one_sentence(done.stderr), done.stderr
        assert ({path.name: path.read_bytes() for path in out.iterdir()} if out.exists() else None) == before


def test_an_empty_name_is_no_folder(case_file, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for arguments in (
        ["run", str(case_file), "--out", ""],
        ["reproduce", "--out", ""],
        ["tradeoff", "paper", "--out", ""],
        ["new", ""],
    ):
        assert main(arguments) == 2
        assert one_sentence(capsys.readouterr().err)
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]


@pytest.mark.parametrize(
    ("file", "reason"),
    [("file/case.toml", "is a file"), ("file/deep/case.toml", "is a file"), ("/proc/case.toml", "no files can be created")],
)
def test_new_says_why_a_folder_cannot_be_used(file, reason, tmp_path, capsys):
    (tmp_path / "file").write_text("kept")
    assert main(["new", str(tmp_path / file)]) == 2
    said = capsys.readouterr().err
    assert one_sentence(said) and reason in said


def test_what_stayed_empty_goes_again(tmp_path, case_file, monkeypatch):
    from barbalat.run.engine import simulate

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(simulate, "simulate", interrupted)
    (tmp_path / "there").mkdir()
    assert main(["run", str(case_file), "--out", str(tmp_path / "there" / "deep" / "out")]) == 130
    assert not list((tmp_path / "there").iterdir())


def test_json_of_what_is_not_finite():
    from barbalat.report.documents import as_json

    assert json.loads(as_json({"a": [float("nan"), 1.0], "b": (float("inf"), {"c": -float("inf")})})) == {
        "a": [None, 1.0],
        "b": [None, {"c": None}],
    }


def test_an_interrupt_after_the_runs_says_what_is_kept(tmp_path, case_file, monkeypatch, capsys):
    """The metrics and trajectories are complete. There is no page, not even an older one."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    folder = tmp_path / "out"
    monkeypatch.setattr("barbalat.certificates.certify.certified_case", interrupted)
    assert main(["run", str(case_file), "--out", str(folder)]) == 130
    said = capsys.readouterr().err
    assert f"the metrics and trajectories are kept in {folder}, without a page" in said and said.endswith("interrupted\n")
    assert json.loads((folder / "run.json").read_text())["controllers"] and list(folder.glob("*.csv"))
    assert not list(folder.glob("*.html")) and not list(folder.glob(".*"))


def test_certify_leaves_page_and_json(case_file, tmp_path, capsys):
    assert main(["certify", str(case_file), "--out", str(tmp_path / "out"), "--json"]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"certify.json", "report.html"}
    assert json.loads((tmp_path / "out" / "certify.json").read_text("utf-8")) == json.loads(capsys.readouterr().out)
