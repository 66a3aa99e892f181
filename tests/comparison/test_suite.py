"""The public suite: its hash, what a submission may be, and rows of its table that are rebuilt."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from importlib import resources

import pytest

from barbalat.comparison.suite.suite import PUBLIC, Submission, Suite, _place, standings, stored_table
from barbalat.report.page import suite as suite_page
from barbalat.report.suite import rebuilt
from barbalat.validate import InputError

PUBLIC_TEXT = (resources.files("barbalat.comparison.suite") / "public.toml").read_text("utf-8")


def test_the_public_suite_is_the_one_whose_hash_is_written_down():
    suite = Suite.read()
    assert suite.is_public and suite.sha256 == PUBLIC[suite.name] and set(suite.quick) <= set(suite.tables)
    problems = [suite.case(name).problem for name in suite.tables]
    assert any(one.truth is not None for one in problems) and any(one.faults for one in problems)


def test_a_changed_suite_is_refused_or_is_another_one(tmp_path):
    file = tmp_path / "suite.toml"
    file.write_text(PUBLIC_TEXT.replace("members = 32", "members = 16"))
    with pytest.raises(InputError, match="a changed suite needs another name"):
        Suite.read(file)
    file.write_text(PUBLIC_TEXT.replace("members = 32", "members = 16").replace('"public-1"', '"mine"'))
    assert not Suite.read(file).is_public
    file.write_text(PUBLIC_TEXT.replace("\n", "\r\n"), newline="")
    assert Suite.read(file).is_public


def submitted(tmp_path, text: str) -> Submission:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    return Submission.read(str(file), Suite.read())


def test_a_submission_changes_nothing_but_the_controllers(tmp_path):
    table = '[[controller]]\nname = "Mine"\nscheme = "adrc"\nbandwidth = 8.0\nsample_time = {}\n'
    assert submitted(tmp_path, 'name = "lossy"\n' + table.format(0.01)).case == "lossy"
    with pytest.raises(InputError, match=r"all have sample_time = 0\.01"):
        submitted(tmp_path, 'name = "lossy"\n' + table.format(0.005))
    with pytest.raises(InputError, match=r"\[uncertainty\] of .* is not that of the suite's case 'lossy'"):
        submitted(tmp_path, 'name = "lossy"\n[uncertainty]\nlower = [0.4, 0.4]\nupper = [0.6, 0.6]\n' + table.format(0.01))
    with pytest.raises(InputError, match="has the cases"):
        submitted(tmp_path, 'name = "losy"\n' + table.format(0.01))


def test_a_part_of_the_table_is_rebuilt():
    """One entry of the quick case, alone: by the command twice in every bit, and as stored to nine digits on any processor."""
    command = [sys.executable, "-m", "barbalat", "contest", "--suite", "--quick", "--schemes", "adrc", "--json"]
    once, again = (json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout) for _ in range(2))
    assert once["rows"] == again["rows"]
    found = standings(schemes=["adrc"], quick=True)
    assert [row["entry"] for row in found.rows] == ["ADRC"]
    assert (found.compared["agree"], found.compared["differ"]) == (["ADRC on servo"], []), found.rows
    page = suite_page(found)
    assert found.suite.sha256 in page and "MRAC" in page


def test_what_differs_is_named(tmp_path):
    """The tuning that the rule has found, submitted as set, has the rule's error; another stored row is called different."""
    row = next(one for one in stored_table()["rows"] if (one["case"], one["entry"]) == ("servo", "ADRC"))
    head = 'name = "servo"\n[[controller]]\nname = "Mine"\nscheme = "adrc"\nsample_time = 0.004\n'
    text = f"{head}bandwidth = {row['tuning']['bandwidth']!r}\n"
    found = standings(submissions=[submitted(tmp_path, text)], quick=True)
    (mine,) = found.rows
    assert mine["settings"] == "as submitted" and mine["meets_rule"] == row["meets_rule"]
    assert (mine["failed"], mine["runs"]) == (row["failed"], row["runs"])
    assert rebuilt(found) == "none of the measured rows is stored" and found.beside
    changed = json.loads(json.dumps(stored_table()))
    here = json.loads(json.dumps(mine, default=float))
    for other, expected in (
        ({"failed": 31}, "differ"),
        ({"median_error": here["median_error"] * (1 + 1e-8)}, "differ"),
        ({"median_error": here["median_error"] * (1 + 1e-15), "sha256": ""}, "agree"),
        ({}, "in_every_bit"),
    ):
        compared = replace(found, stored={**changed, "rows": [*changed["rows"], {**here, **other}]}).compared
        assert compared[expected] == ["Mine on servo"], other


def test_the_stored_table_is_of_this_suite():
    table = stored_table()
    assert table["sha256"] == Suite.read().sha256 and table["date"] and table["commit"]
    places = [_place(row) for row in table["rows"]]
    assert len(set(places)) == len(places) and {row["settings"] for row in table["rows"]} == {"by the rule"}
