"""Names and units appear on the axes of a run's pictures, have the right count, and change no number."""

import re

import numpy as np
import pytest

from barbalat import Mrac, Plant, Problem, ReferenceModel, Simulation, load_case, simulate
from barbalat.plants import Labels
from barbalat.report.rendering import figure_columns
from barbalat.report.terminal import runs as terminal
from barbalat.report.terminal.layout import Screen
from barbalat.run.results.picture import panels
from barbalat.signals import Step
from independent import refusal

PLANT = Plant([[0, 1], [-4, -2]], [0, 1], [1, -1])
GIVEN = Labels(names=("angle", "rate"), units=("rad", "rad/s"), input_units=("N m",))


def run(labels):
    return simulate(Problem(PLANT, ReferenceModel(4.0), Step(1.0), labels=labels), Mrac(5), Simulation(2.0, 1e-2))["MRAC"]


def test_they_stand_on_the_axes():
    motion, error, control, *_ = panels([run(GIVEN)])
    assert "angle" in motion.title and motion.y.endswith("[rad]")
    assert control.y.endswith("[N m]")
    assert [series.label.split()[-1] for series in error.series] == ["[rad]", "[rad/s]"]


def test_tables_of_runs_have_units(capsys):
    """Units appear in the headings on pages and in notebooks, and next to each component on a terminal. Without units nothing is
    added."""
    named, bare = run(GIVEN), run(None)
    columns = figure_columns([named])
    assert columns["max_abs_e"] == "max |e| [rad, rad/s]" and columns["max_abs_u"] == "max |u| [N m]"
    assert figure_columns([bare])["max_abs_e"] == "max |e|"
    assert "RMS e [rad, rad/s]</th>" in named._repr_html_() and "[" not in re.search(r"<tr>.*?</tr>", bare._repr_html_())[0]
    terminal.show_full(Screen(), "a case", [named])
    shown = capsys.readouterr().out
    assert "e_1 [rad] " in shown and "e_2 [rad/s] " in shown and "[N m]" in shown


def test_no_number_depends_on_them():
    named, bare = run(GIVEN), run(None)
    np.testing.assert_array_equal(named.x, bare.x)
    assert named.figures == bare.figures


def test_the_aircrafts_have_them():
    assert load_case("f16-short-period").problem.labels.units == ("rad", "rad/s")
    assert load_case("lateral-aircraft").problem.labels.input_units == ("deg", "deg")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"units": ("rad",)}, "labels.units must have 2 entries, got 1"),
        ({"input_units": ("N", "N")}, "labels.input_units must have 1 entry, got 2"),
        ({"names": "angle"}, "labels.names must be a list of strings"),
        ({"names": ("a\nb", "c")}, "control characters"),
    ],
)
def test_other_counts_and_what_is_no_text_are_refused(given, words):
    assert words in refusal(lambda: run(Labels(**given)))
