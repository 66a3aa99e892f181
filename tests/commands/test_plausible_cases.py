"""The fuzzer itself: its cases are plausible, and it detects the faults that it is meant to detect. ``./dev fuzz`` runs it."""

import copy
import random

import pytest

import fuzz
import plausible
from barbalat.cases.load import CaseText, bundled


@pytest.fixture
def folder(tmp_path):
    plausible.write_files(tmp_path)
    return tmp_path


def test_four_cases_in_five_are_taken_by_the_package(folder, sample):
    """Otherwise the fuzzer would spend most of its time on rejections, which other tests cover."""
    count = sample(40, 300)
    taken = sum(plausible.accepted(fuzz.drawn(seed, None, folder), folder) for seed in range(count))
    assert taken >= 0.8 * count


@pytest.mark.full
def test_every_scheme_and_signal_of_the_schema_is_drawn(folder):
    draw = plausible.Draw(random.Random(0), folder)
    cases = [plausible.Draw(random.Random(seed), folder).case() for seed in range(400)]
    commands = [
        one for case in cases for one in (case["reference"] if isinstance(case["reference"], list) else [case["reference"]])
    ]
    for problem in ("Problem", "OutputProblem"):
        keys = draw.properties(draw.definition(problem))
        assert {one["scheme"] for case in cases for one in case["controller"]} >= draw.variants(
            keys["controller"]["items"]
        ).keys()
        assert {one["kind"] for one in commands} >= draw.variants(keys["reference"]).keys()


def test_a_seed_names_a_case(folder):
    assert fuzz.drawn(7, None, folder) == fuzz.drawn(7, None, folder)
    assert fuzz.drawn(7, None, folder) != fuzz.drawn(8, None, folder)


def test_a_given_case_is_varied_and_stays_a_case(folder):
    given = fuzz.early(CaseText.read("first-order").data())
    found = [fuzz.drawn(seed, copy.deepcopy(given), folder) for seed in range(6)]
    assert all(case["plant"].keys() >= given["plant"].keys() for case in found)
    assert len({str(case) for case in found}) == len(found)


def test_a_traceback_a_refusal_and_a_result_are_told_apart(folder, monkeypatch):
    case = folder / "case.toml"
    case.write_text("name = 3\n", encoding="utf-8")
    words = ["run", str(case), "--no-plots"]
    assert fuzz.judged(fuzz.call(words, 60), words) == ("refused", None)
    words = ["run", str(bundled()["first-order"]), "--no-plots"]
    ended, given = fuzz.judged(fuzz.call(words, 60), words)
    assert ended == "done" and given["controllers"]

    def broken(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(fuzz, "main", broken)
    ended, failure = fuzz.judged(fuzz.call(words, 60), words)
    assert ended == "failed" and failure.kind == "ZeroDivisionError"


def test_what_takes_too_long_is_stopped(folder, monkeypatch):
    def endless(*_):
        while True:
            pass

    monkeypatch.setattr(fuzz, "main", endless)
    ended, failure = fuzz.judged(fuzz.call(["run"], 1), ["run"])
    assert ended == "failed" and failure.kind == "hang"


def test_a_bound_that_no_finer_step_keeps_is_a_failure(folder):
    case = fuzz.early(CaseText.read("first-order").data())
    run = fuzz.judged(fuzz.call(["run", "first-order", "--no-plots"], 60), ["run"])[1]
    name = next(iter(run["controllers"]))
    largest = max(run["controllers"][name]["max_abs_e"])

    def certified(bound):
        return {"controllers": {name: {"guaranteed": ["error_bound"], "error_bound": bound}}}

    assert [ended for _, ended, _ in fuzz.broken_bounds(case, folder, run, certified(2 * largest))] == ["held"]
    assert [ended for _, ended, _ in fuzz.broken_bounds(case, folder, run, certified(1e-6 * largest))] == ["failed"]
