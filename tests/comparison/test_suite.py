"""The public suite: its hash, the admissible submissions, and recomputed rows of its table."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

from barbalat.comparison.contest.entrant import entrants_of
from barbalat.comparison.suite.suite import PUBLIC, Submission, Suite, _place, standings, stored_table
from barbalat.open_numbers.path import FieldPath
from barbalat.report.documents import as_json
from barbalat.report.page import suite as suite_page
from barbalat.report.suite import PAGE_COLUMNS, page_rows, rebuilt, without
from barbalat.validate import InputError

PUBLIC_TEXT = (resources.files("barbalat.comparison.suite") / "public.toml").read_text("utf-8")


def test_the_public_suite_is_the_one_whose_hash_is_written_down():
    suite = Suite.read()
    assert suite.is_public and suite.sha256 == PUBLIC[suite.name] and set(suite.quick) <= set(suite.tables)
    problems = [suite.case(name).problem for name in suite.tables]
    assert any(one.truth is not None for one in problems) and any(one.faults for one in problems)


def test_a_changed_suite_is_refused_or_is_another_one(tmp_path):
    file = tmp_path / "suite.toml"
    file.write_text(PUBLIC_TEXT.replace("members = 16", "members = 8"))
    with pytest.raises(InputError, match="a changed suite needs a different name"):
        Suite.read(file)
    file.write_text(PUBLIC_TEXT.replace("members = 16", "members = 8").replace('"public-1"', '"mine"'))
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
    with pytest.raises(InputError, match=r"all controllers have sample_time = 0\.01"):
        submitted(tmp_path, 'name = "lossy"\n' + table.format(0.005))
    with pytest.raises(InputError, match=r"\[uncertainty\] of .* differs from that of the suite's case 'lossy'"):
        submitted(tmp_path, 'name = "lossy"\n[uncertainty]\nlower = [0.4, 0.4]\nupper = [0.6, 0.6]\n' + table.format(0.01))
    with pytest.raises(InputError, match="has the cases"):
        submitted(tmp_path, 'name = "losy"\n' + table.format(0.01))


LAW = """
from dataclasses import dataclass
from barbalat import Adrc, InputError
from barbalat.controllers import Sampled
from barbalat.interfaces import TuningGrid

@dataclass(frozen=True)
class Law:
    name: str = "Law"
    def bind(self, known):
        if known.matched.gain_unknown and GAIN_KNOWN:
            raise InputError("Law takes plants with a known input gain")
        return MADE.bind(known)
    def knobs(self, reach):
        return TuningGrid(scheme="ADRC", values={}, make=lambda: self if GAIN_KNOWN else MADE)
"""


def law(tmp_path, made: str, *, gain_known: bool = False) -> Submission:
    """A law without settings to tune, whose declared settings claim that it is ADRC."""
    file = tmp_path / "law.py"
    file.write_text(f"{LAW}\nGAIN_KNOWN, MADE = {gain_known}, {made}\nCONTROLLERS = [Law()]\n")
    return Submission.read(str(file), Suite.read())


@pytest.mark.dear
def test_a_submitted_law_runs_at_the_cases_sample_time_and_takes_no_stored_rows_place(tmp_path):
    with pytest.raises(
        InputError,
        match=r"ADRC runs every 0\.001 s, but on the suite's case 'servo' all controllers have "
        r"sample_time = 0\.004",
    ):
        standings(submissions=[law(tmp_path, "Sampled(Adrc(bandwidth=20.0), 0.001)")], quick=True)
    found = standings(submissions=[law(tmp_path, "Sampled(Adrc(bandwidth=20.0), 0.004)")], quick=True)
    assert [(row["entry"], row["settings"]) for row in found.rows] == [("ADRC", "by the rule, submitted")]
    assert rebuilt(found) == "none of the measured rows is stored" and "ADRC" in {row["entry"] for row in found.stored_only}


@pytest.mark.dear
def test_a_case_that_an_entry_does_not_take_leaves_it_the_others(tmp_path):
    two = replace(Suite.read(), quick=("servo", "lossy"))
    found = standings(two, submissions=[law(tmp_path, "Adrc(bandwidth=8.0)", gain_known=True)], quick=True)
    assert {row["case"] for row in found.rows} == {"lossy"} and found.empty == ["servo"]
    assert "takes plants with a known input gain" in found.left_out["servo"][-1]
    with pytest.raises(InputError, match=r"nobody takes part.*on servo: "):
        standings(schemes=["robust-mrac"], quick=True)


@pytest.mark.dear
def test_a_part_of_the_table_is_rebuilt():
    """One entry of the quick case equals the stored one to nine digits on any machine."""
    found = standings(schemes=["adrc"], quick=True)
    assert [row["entry"] for row in found.rows] == ["ADRC"]
    assert (found.compared["agree"], found.compared["differ"]) == (["ADRC on servo"], []), found.rows
    page = suite_page(found)
    assert found.suite.sha256 in page and "MRAC" in page


@pytest.mark.full
def test_a_part_of_the_table_is_that_of_another_process():
    """One entry of the quick case is identical to the entry from a different process."""
    command = [sys.executable, "-m", "barbalat", "contest", "--suite", "--quick", "--schemes", "adrc", "--json"]
    by_command = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert by_command["rows"] == json.loads(as_json(standings(schemes=["adrc"], quick=True).as_json()))["rows"]


@pytest.mark.full
def test_cases_side_by_side_are_those_one_after_the_other():
    """The baseline alone has no settings to tune. It runs on every case in separate processes and is compared with the stored
    rows."""
    found = standings(schemes=["baseline"], processes=2)
    assert [row["case"] for row in found.rows] == list(found.suite.tables)
    stored = {f"{row['entry']} on {row['case']}" for row in stored_table()["rows"] if row["entry"] == "Baseline"}
    assert set(found.compared["agree"]) == stored and not found.compared["differ"]


@pytest.mark.dear
def test_what_differs_is_named(tmp_path):
    """The rule's own tuning, submitted as fixed, has the rule's error. A stored row that differs is reported."""
    row = next(one for one in stored_table()["rows"] if (one["case"], one["entry"]) == ("servo", "ADRC"))
    head = 'name = "servo"\n[[controller]]\nname = "Mine"\nscheme = "adrc"\nsample_time = 0.004\n'
    text = f"{head}bandwidth = {row['tuning']['bandwidth']!r}\n"
    found = standings(submissions=[submitted(tmp_path, text)], quick=True)
    (mine,) = found.rows
    assert mine["settings"] == "as submitted" and mine["meets_rule"] == row["meets_rule"]
    assert (mine["failed"], mine["runs"]) == (row["failed"], row["runs"])
    assert rebuilt(found) == "none of the measured rows is stored" and found.stored_only
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
    assert set(table["left_out"]) == {row["case"] for row in table["rows"]}
    assert any(
        "servo does not include" in said and "Robust MRAC" in said and "takes the input gain as known" in said
        for said in without(table)
    )
    assert len(set(places)) == len(places) and {row["settings"] for row in table["rows"]} == {"by the rule"}


def test_l1_is_tuned_over_both_filters_and_ends_of_ranges_are_marked():
    """The second time constant ranges from the first one up to a value with which the filter is practically (6). The page marks a
    tuning at an end with a star."""
    suite = Suite.read()
    case, held = suite.case("section-v"), suite.sample_time("section-v")
    entrants, _ = entrants_of(case.problem, case.simulation, schemes=("l1", "robust-mrac"), sample_time=held)
    l1, robust = (next(one for one in entrants if one.name == name) for name in ("L1-AC", "Robust MRAC"))
    ends = {name: (min(values), max(values)) for name, values in l1.knobs.values.items()}
    assert ends["slope_ratio"][0] == 1 and ends["kappa"][0] == pytest.approx(held / 2)
    kappa = 0.02
    C = l1.knobs.make(kappa=kappa, slope_ratio=1.0, gamma=1.0).controller.filter
    scale = C.den[-1]  # kept with a leading 1
    assert C.num / scale == pytest.approx([2 * kappa, 1]) and C.den / scale == pytest.approx([kappa**2, 2 * kappa, 1])
    w = np.array([0.5, 50.0])
    slow = l1.knobs.make(kappa=kappa, slope_ratio=ends["slope_ratio"][1], gamma=1.0).controller.filter
    assert np.ravel(slow.realise().response(w)) == pytest.approx(1 / (kappa * 1j * w + 1), rel=1e-2)
    assert max(robust.knobs.values["tau"]) >= 1 / robust.knobs.make(tau=1.0, covariance0=1.0).controller.normalization.delta_0
    low, high = (robust.space.ranges[FieldPath(("covariance0",))].low, robust.space.ranges[FieldPath(("covariance0",))].high)
    assert (low, high) == pytest.approx((1e-4, 1e6))
    row = {**stored_table()["rows"][0], "tuning": {"kappa": 0.1, "gamma": 2.0}, "at_edge": ["gamma"]}
    (cells,) = page_rows([row])
    assert cells[-1] == "kappa 0.1, gamma 2*" and len(cells) == len(PAGE_COLUMNS)
    for stored in stored_table()["rows"]:
        assert set(stored["at_edge"]) <= set(stored["tuning"])
