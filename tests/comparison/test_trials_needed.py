"""The smallest number of tunings of a search, as stated in the command's help."""

import pytest

from barbalat import InputError
from barbalat.cases.load import CaseText
from barbalat.cli import main
from barbalat.comparison.ranges import Range, Space
from barbalat.comparison.search.aim import Aim
from barbalat.comparison.search.search import least_trials
from barbalat.comparison.tune.tune import DEFAULT_TRIALS, Tuner
from barbalat.open_numbers.path import FieldPath


def test_the_help_says_the_least_number(capsys):
    with pytest.raises(SystemExit):
        main(["tune", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    several = f"with more than three tuned parameters, default and minimum are {least_trials(4)}"
    assert f"default {DEFAULT_TRIALS}, minimum {least_trials(3)}; {several}" in said


def test_fewer_are_refused_with_the_least_number():
    text = CaseText.read("first-order")
    aim = Aim.of("rms_e", [], maximize=False, plants=1, quantile=1.0, seed=0)
    space = Space({FieldPath.parse("controller[0].gamma"): Range(1.0, 10.0)})
    with pytest.raises(InputError, match=f"trials must .* {least_trials(1)}"):
        Tuner(text, text.case(), aim, 100).tuned(0, space, None)
