"""Signals and options that a page computes differently from a run: the metrics are identical to the metrics of a run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from barbalat import Mrac, Simulation, load_case, simulate
from barbalat.cases.load import CaseText
from barbalat.explorer.commands import MOST_POINTS, is_computed, points_of
from barbalat.explorer.describe import Described
from barbalat.explorer.source import ObjectSource, TextSource
from barbalat.open_numbers.path import FieldPath
from barbalat.signals import Recorded, Sine, Square
from barbalat.studies import explore
from explorer.in_node import figures, needs_node
from independent import refusal

CASE = """
name = "c"
[plant]
A_m = [[0.0, 1.0], [-4.0, -2.8]]
b = [0.0, 1.0]
theta = [1.0, -0.5]
DISTURBANCE
[plant.input]
saturation = [-2.0, 3.0]
[reference_model]
k_0 = 4.0
[reference]
kind = "csv"
file = "r.csv"
[uncertainty]
lower = [-3.0, -3.0]
upper = [3.0, 3.0]
[simulation]
t_end = 4.0
dt = 1e-2
[[controller]]
scheme = "mrac"
gamma = 10.0
modified_error = { mu = MU, margin = 0.1 }
[[controller]]
scheme = "mrac"
name = "sampled"
gamma = 10.0
sample_time = 0.02
"""


def recorded_case(folder, *, mu=1.5, disturbance="", rows=40):
    """A case with times that are not on the grid. Some are before t = 0, and the last one is before the end."""
    random = np.random.default_rng(7)
    times = np.cumsum(random.uniform(0.02, 0.15, rows)) - 0.2
    lines = [f"{t!r},{v!r}" for t, v in zip(times.tolist(), random.normal(size=rows).tolist(), strict=True)]
    (folder / "r.csv").write_text("\n".join(["t,r", *lines]))
    text = CASE.replace("MU", repr(mu)).replace("DISTURBANCE", disturbance)
    (folder / "case.toml").write_text(text)
    return TextSource(CaseText.read(str(folder / "case.toml")))


@needs_node
@pytest.mark.parametrize(
    "disturbance",
    [
        "",
        pytest.param('disturbance = { kind = "sine", amplitude = 0.3, frequency = 2.0 }', marks=pytest.mark.full),
        pytest.param('disturbance = { kind = "square", amplitude = 0.3, frequency = 1.7 }', marks=pytest.mark.full),
    ],
)
def test_a_recorded_command_and_the_modified_error_have_the_bits_of_a_run(tmp_path, disturbance):
    """The page's scripts compute both together with a formula and a jumping signal whose columns are between the columns
    of the record."""
    source = recorded_case(tmp_path, disturbance=disturbance)
    described = Described.of(source)
    found = figures(described.as_data(), tmp_path)
    runs = simulate(described.case.problem, described.case.controllers, described.case.simulation)
    for name, run in runs.items():
        assert {key: found[name].get(key) for key in run.figures} == run.figures


def test_numbers_beside_a_record_have_sliders(tmp_path):
    """Every case with a changed number reads the same record again."""
    paths = {str(one.number.path): one for one in Described.of(recorded_case(tmp_path)).sliders}
    assert {"plant.theta[0]", "controller[0].gamma", "controller[0].modified_error.mu", "plant.input.saturation[1]"} <= set(paths)
    assert paths["plant.theta[0]"].copied and paths["controller[0].modified_error.mu"].copied


@needs_node
def test_a_slider_moves_the_modified_error_from_zero_on(tmp_path):
    """With mu = 0 the module contains the whole formula, and its results equal those without it bit for bit."""
    source = recorded_case(tmp_path, mu=0.0)
    described = Described.of(source)
    (slider,) = [one for one in described.sliders if str(one.number.path) == "controller[0].modified_error.mu"]
    other = float(slider.number.values[-1])
    at = [one is slider for one in described.sliders].index(True)
    values = [one.number.value for one in described.sliders]
    for mu in (0.0, other):
        found = figures(described.as_data(), tmp_path, values=[*values[:at], mu, *values[at + 1 :]])["MRAC"]
        case = source.at({slider.number.path: mu})
        (run, *_) = simulate(case.problem, case.controllers, case.simulation).values()
        assert {key: found.get(key) for key in run.figures} == run.figures


OBSERVED = """
name = "o"
[plant]
A = [[0.0, 1.0], [-2.0, -0.5]]
b = [0.0, 1.0]
C = [[1.0, 0.0]]
[observer]
kind = "luenberger"
poles = [-9.0, -8.0]
[sensor.noise]
std = 0.01
sample_time = 0.02
[reference_model]
poles = [-3.0, -4.0]
follow = "x_1"
[reference]
kind = "sine"
amplitude = 1.0
frequency = 2.0
[simulation]
t_end = 4.0
dt = 1e-2
[[controller]]
scheme = "mrac"
gamma = 5.0
[[controller]]
scheme = "mrac"
name = "sampled"
gamma = 5.0
sample_time = 0.02
"""


@needs_node
def test_an_observer_has_the_bits_of_a_run_and_a_slider(tmp_path):
    """There are fewer measured quantities than states, each with its own noise."""
    (tmp_path / "case.toml").write_text(OBSERVED)
    source = TextSource(CaseText.read(str(tmp_path / "case.toml")))
    described = Described.of(source)
    paths = [str(one.number.path) for one in described.sliders]
    at = paths.index("observer.poles[0]")
    slider = described.sliders[at]
    for value in (slider.number.value, float(slider.number.values[-1])):
        values = [value if i == at else one.number.value for i, one in enumerate(described.sliders)]
        found = figures(described.as_data(), tmp_path, values=values)
        case = source.at({slider.number.path: value})
        for name, run in simulate(case.problem, case.controllers, case.simulation).items():
            assert {key: found[name].get(key) for key in run.figures} == run.figures


def test_a_record_longer_than_a_page_is_refused_in_a_sentence():
    """Points beyond the longest horizon of a page are not needed."""
    times = np.arange(MOST_POINTS + 10) * 1e-3
    record = Recorded(times, np.sin(times))
    assert points_of(record, 1.0).keys() == {"times", "values"}
    said = refusal(lambda: points_of(record, 100.0))
    assert f"has {MOST_POINTS + 10} recorded points" in said and "barbalat run" in said
    assert points_of(Sine(1.0, 1.0), 1.0) is None and points_of(Square(1.0, 1.0), 1.0) is None


@dataclass(frozen=True)
class Stranger:
    """A separate table that == never finds equal to a different array-like."""

    times: np.ndarray
    values: np.ndarray

    @property
    def interpolation_points(self):
        return self.times, self.values

    def __call__(self, t):
        return np.interp(t, self.times, self.values)

    before = __call__


@needs_node
def test_a_signal_from_outside_that_knows_its_points_is_a_record_too(tmp_path):
    signal = Stranger(np.array([0.0, 0.313, 0.71]), np.array([0.0, 1.0, -0.5]))
    assert is_computed(signal)
    problem = replace(load_case("first-order").problem, reference=signal)
    page = explore(problem, Mrac(gamma=2.0), Simulation(t_end=1.0, dt=1e-2))
    assert not any(str(path).startswith("reference.") for path, _ in page.source.numbers())  # measured data has no sliders
    data = page.contents.data
    assert "plant.theta[0]" in [number["path"] for number in data["numbers"]]
    (found,) = figures(data, tmp_path).values()
    (run,) = simulate(problem, [Mrac(gamma=2.0)], Simulation(t_end=1.0, dt=1e-2, fused=False)).values()
    assert {key: found.get(key) for key in run.figures} == run.figures


@dataclass(frozen=True)
class Pulses:
    """A user-defined class with an array field, for which comparing tuples of fields raises an error."""

    instants: np.ndarray

    def __call__(self, t):
        return 1.0 * (np.searchsorted(self.instants, t, side="right") % 2)

    before = __call__


def test_signals_from_outside_are_compared_by_their_numbers():
    problem = replace(load_case("first-order").problem, reference=Pulses(np.array([0.2, 0.5])))
    case = explore(problem, Mrac(gamma=2.0), Simulation(t_end=1.0, dt=1e-2)).source.at({})
    source = ObjectSource(case)
    paths = [str(one.number.path) for one in Described.of(source).sliders]
    assert "plant.theta[0]" in paths
    assert source.at({FieldPath.parse("reference.instants[0]"): 0.3}).problem.reference.instants[0] == 0.3
