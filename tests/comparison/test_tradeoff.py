"""Trade-offs: fronts compared with brute force, all bundled cases, and the page's text."""

from __future__ import annotations

import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console

from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.comparison import grids
from barbalat.comparison.grids import default_knobs
from barbalat.comparison.plants import plants_of
from barbalat.comparison.tradeoff.tradeoff import Cloud, TradeOff, pareto_front, trade_off
from barbalat.controllers import SCHEMES, Mrac
from barbalat.controllers.robust_mrac import NormalizedMrac
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.folders import Folder
from barbalat.loop.binding import bound
from barbalat.pictures.labels import LabelPlaces
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import Known, ParameterBox, Problem
from barbalat.report import documents, tradeoff, write
from barbalat.report.terminal.layout import Screen
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine
from barbalat.solvers import RK4
from barbalat.solvers.simulation import Simulation
from barbalat.study.ideal_benchmark import Judging
from barbalat.validate import InputError
from independent import refusal
from turns import drawn

STATE_FEEDBACK = ("f16-short-period", "first-order", "lateral-aircraft", "third-order", "wing-rock")


def test_pareto_front_against_brute_force():
    random = np.random.default_rng(1)
    for _ in range(200):
        size = int(random.integers(1, 40))
        error, margin = random.integers(1, 12, size) / 4.0, random.integers(0, 12, size) / 4.0
        error[random.random(size) < 0.1] = np.nan
        front = pareto_front(error, margin)
        usable = [i for i in range(size) if np.isfinite(error[i]) and margin[i] > 0]
        best = {
            (error[i], margin[i])
            for i in usable
            if not any(
                error[j] <= error[i] and margin[j] >= margin[i] and (error[j], margin[j]) != (error[i], margin[i]) for j in usable
            )
        }
        assert {(error[i], margin[i]) for i in front} == best
        assert len(front) == len(best)
        assert (np.diff(margin[front]) > 0).all()


def test_trade_off_of_one_scheme_and_its_page(section_v, tmp_path):
    chosen = (TuningGrid(scheme="MRAC", values={"gamma": np.array([1e-3, 1e-1])}, make=lambda gamma: Mrac(gamma=gamma)),)
    seen = []
    found = trade_off(section_v, Simulation(t_end=20.0, dt=1e-3), knobs=chosen, plants=3, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    (cloud,) = found.clouds
    assert cloud.error.shape == cloud.onset.shape == cloud.loss.shape == (2, 3)
    assert (cloud.onset <= cloud.loss).all()
    np.testing.assert_array_equal(found.thetas[0], section_v.plant.theta)
    assert all(section_v.uncertainty.contains(theta) for theta in found.thetas)
    np.testing.assert_array_equal(cloud.at("worst", "loss")[1], cloud.loss.min(axis=1))
    document = json.loads(documents.as_json(tradeoff.as_document(found)))
    assert document["schemes"]["MRAC"]["tunings"] == [{"gamma": 1e-3}, {"gamma": 1e-1}]
    assert document["schemes"]["MRAC"]["onset"] == cloud.onset.tolist()
    folder = Folder(tmp_path)
    write.write_tradeoff(folder, found)
    assert not [path for path in tmp_path.iterdir() if path.is_file()]  # nothing is visible before everything is written
    folder.commit()
    assert "Tracking error against the delay" in (tmp_path / "report.html").read_text()
    assert (tmp_path / "tradeoff.svg").stat().st_size > 1000


TURN = {"first-order", *drawn(STATE_FEEDBACK, 3)}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.bulk] * (name not in TURN)) for name in STATE_FEEDBACK])
@pytest.mark.short(kept=lambda name: name == "first-order")
def test_every_bundled_case_with_measured_state(name):
    """A few tunings over a sixth of the run. Each scheme has some that follow the command, and these tolerate some delay before
    loss."""
    case = load_case(name)
    simulation = replace(case.simulation, t_end=case.simulation.t_end / 6)
    found = trade_off(case.problem, simulation, density=2, plants=1)
    assert [cloud.scheme for cloud in found.clouds][:2] == ["MRAC", "L1-AC"]
    takes_robust = case.problem.input_gain is None
    third = found.clouds[2].scheme if len(found.clouds) == 3 else None
    assert third == ("Robust MRAC" if takes_robust else "Baseline")
    assert any("Robust MRAC is omitted: robust-mrac takes" in sentence for sentence in found.notes) == (not takes_robust)
    for cloud in [one for one in found.clouds if one.scheme != "Baseline"]:  # which need not follow on this plant
        assert (cloud.loss[np.isfinite(cloud.error)] > 0).any()


def test_largest_gain_along_a_run_against_the_bound_of_certify(section_v):
    """|x| along the run is below the bound that certify uses. The gain is therefore larger, by a factor explained by the bound on
    a sine."""
    simulation = Simulation(t_end=60.0, dt=1e-3)
    bound = certify(section_v, (Mrac(gamma=1.0),), simulation)["MRAC"].values["gamma_max"]
    found, how = grids.largest_gain(section_v, simulation)
    assert (found, how) == (bound, "gamma_max of certify")
    along = grids._largest_along_the_ideal_run(section_v, simulation)
    assert bound < along < 10 * bound


def test_oscillator_of_two_inputs_is_that_of_each_where_they_are_apart():
    """Two equal independent plants have the modes of one plant twice, with the square of its characteristic polynomial."""
    A_m, b = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([0.0, 1.0])
    zero = np.zeros((2, 2))
    one = Known(A_m=A_m, b=b, k_0=1.0, x0=np.zeros(2), estimate_set=None)
    two = Known(
        A_m=np.block([[A_m, zero], [zero, A_m]]),
        b=np.kron(np.eye(2), b[:, None]),
        k_0=np.eye(2),
        x0=np.zeros(4),
        estimate_set=None,
    )
    single, double = (Oscillator(known, RK4, np.zeros(0)) for known in (one, two))
    assert double.bPb == pytest.approx(single.bPb, rel=1e-12)
    g = np.array([0.3, 7.0])
    for modes, twice in zip(single.modes(g), double.modes(g), strict=True):
        np.testing.assert_allclose(np.poly(twice), np.polymul(np.poly(modes), np.poly(modes)), rtol=1e-9)
    assert double.largest_g(1e-3) == pytest.approx(single.largest_g(1e-3), rel=1e-9)


def test_refusals(section_v):
    simulation = Simulation(t_end=1.0, dt=0.01)
    assert "known set" in refusal(lambda: trade_off(replace(section_v, uncertainty=None), simulation))
    still = load_case("wing-rock").problem
    still = replace(still, reference=section_v.reference.__class__(amplitude=0.0, frequency=1.0))
    still = replace(still, plant=replace(still.plant, x0=np.zeros(2)))
    assert "the regressor phi(x) stays zero" in refusal(lambda: default_knobs(still, simulation))


SMALL = Problem(
    plant=Plant(A_m=[[-2.0]], b=[1.5], theta=[1.0]),
    reference_model=ReferenceModel(k_0=1.3),
    reference=Sine(amplitude=1.0, frequency=2.0),
    uncertainty=ParameterBox(lower=[-3.0], upper=[3.0]),
)
BRIEF = Simulation(t_end=4.0, dt=4e-3)


def _two_gains(make=lambda gamma: Mrac(gamma=gamma)):
    return (TuningGrid(scheme="MRAC", values={"gamma": np.array([1.0, 10.0])}, make=make),)


def test_the_error_includes_the_noise_of_the_case_and_the_delay_does_not():
    noisy = replace(SMALL, sensor=Sensor(noise=Noise(std=0.05, sample_time=0.1)))
    (plain,) = trade_off(SMALL, BRIEF, knobs=_two_gains(), plants=2).clouds
    found = trade_off(noisy, BRIEF, knobs=_two_gains(), plants=2)
    np.testing.assert_array_equal(found.clouds[0].onset, plain.onset)
    assert (found.clouds[0].error != plain.error).all()
    assert any("without the case's measurement noise" in note for note in found.notes)


@pytest.mark.parametrize("gain", [None, 2.0])
def test_a_known_set_without_zero_starts_in_its_middle(gain):
    """With an unknown input gain every scheme used to be left out, and the page was empty. Without an unknown gain, the scheme's
    default initial estimates were rejected."""
    plant = SMALL.plant if gain is None else replace(SMALL.plant, input=PlantInput(gain=gain))
    known = None if gain is None else (1.5, 3.0)
    apart = replace(SMALL, plant=plant, uncertainty=ParameterBox(lower=[0.5], upper=[2.5]), input_gain=known)
    chosen, left_out = default_knobs(apart, BRIEF, density=2)
    assert {"MRAC", "L1-AC"} <= {one.scheme for one in chosen}
    assert ("Baseline" in {one.scheme for one in chosen}) == (gain is not None)  # no other fixed loop accepts an unknown gain
    assert any("estimates start at its centre, [1.5]" in sentence for sentence in left_out)
    for one in [each for each in chosen if each.scheme != "Baseline"]:
        start = bound(apart, one.make(**next(one.tunings()))).initial().theta_hat
        assert start[0] == 1.5
    assert grids.start_of(SMALL) is None  # otherwise each scheme starts as before


def test_the_baseline_alone_takes_part_beside_a_baseline_whose_parameters_are_the_start():
    case = load_case("aircraft-lqi")
    chosen, left_out = default_knobs(case.problem, case.simulation, density=2)
    assert "Baseline" in {one.scheme for one in chosen}
    assert "Baseline" not in {one.scheme for one in default_knobs(SMALL, BRIEF, density=2)[0]}
    assert grids.start_of(case.problem) is None and not any("at its centre" in sentence for sentence in left_out)
    theta_0 = case.problem.known.theta_0
    for one in chosen:
        if one.scheme in ("MRAC", "L1-AC"):
            start = bound(case.problem, one.make(**next(one.tunings()))).initial().theta_hat
            np.testing.assert_array_equal(start[: len(theta_0)], theta_0)


def test_the_normalised_law_is_also_tried_far_slower_than_the_model():
    """The rate of the normalised law is at most Gamma, so its gains start at a hundredth of the slowest rate of the others."""
    times = np.array([0.1, 1.0])
    scale = TuningScale(highest_gain=1e3, highest_square=1e3, times=times, density=2, known=SMALL.known, sample_time=0.01)
    gains = NormalizedMrac.knobs(scale).values["gamma"]
    np.testing.assert_allclose(gains, [scale.frequencies[0] / 100, *scale.frequencies])


def test_a_trade_off_without_a_scheme_or_without_a_motion_is_refused(monkeypatch):
    """An empty page is of no use."""

    class Never:
        @classmethod
        def knobs(cls, reach):
            return TuningGrid(scheme="never", values={"gamma": reach.gains(1e-4, 2)}, make=lambda gamma: Refusing())

    class Refusing:
        name = "never"

        def bind(self, known):
            raise InputError("never takes no plant")

    monkeypatch.setattr(grids, "SCHEMES", {"never": Never})
    said = refusal(lambda: trade_off(SMALL, BRIEF))
    assert "no scheme takes part in the trade-off: never is omitted: never takes no plant" in said
    still = replace(SMALL, plant=replace(SMALL.plant, theta=[3.0]))
    idle = _two_gains(
        lambda gamma: Mrac(gamma=1e-9 * gamma)
    )  # x' = (-2 + 4.5) x + ...: it adapts too slowly to stabilise this plant
    assert "none of the tunings that were tried (2 of MRAC) tracks the model" in refusal(
        lambda: trade_off(still, BRIEF, knobs=idle, plants=1)
    )


def _found(section_v, onset, loss) -> TradeOff:
    """Two schemes with one tuning each, with the same error and these delays."""
    clouds = tuple(
        Cloud(scheme=name, tunings=({"gamma": 1.0},), error=np.array([[0.005]]), onset=np.array([[a]]), loss=np.array([[b]]))
        for name, a, b in zip(("one", "other"), onset, loss, strict=True)
    )
    return TradeOff(
        problem=section_v, simulation=Simulation(t_end=1.0, dt=0.01), thetas=np.zeros((1, 2)), clouds=clouds,
        by=Judging(), notes=(), runs=0, seconds=0.0,
    )  # fmt: skip


def test_the_sentence_on_the_ranking(section_v):
    flipped = tradeoff.ranking(_found(section_v, (0.1, 0.2), (0.5, 0.3)), "plant")
    assert "order of the schemes depends on the criterion" in flipped
    assert "at an error of at most 0.01 other, one by the onset, one, other by the loss" in flipped
    assert "0.001" not in flipped  # neither is as good
    same = tradeoff.ranking(_found(section_v, (0.1, 0.2), (0.31, 0.32)), "plant")
    assert "other, one by the onset, one = other by the loss" in same
    assert "does not depend" in tradeoff.ranking(_found(section_v, (0.1, 0.2), (0.3, 0.4)), "plant")
    rows = tradeoff.at_equal_error(_found(section_v, (0.0, 0.2), (0.5, 0.3)), "plant")
    assert rows[0] == ("0.001", *["no tuning"] * 4)
    assert rows[1] == ("0.01", "< 0.02", "0.2", "0.5", "0.3")


def test_the_worst_of_several_plants_is_shown_before_the_case_s_own(section_v):
    """One scheme is best on the case's plant and does not follow the model on any other plant."""
    own = _found(section_v, (0.5, 0.3), (0.5, 0.3))
    elsewhere = ([[0.005, 0.5]], [[0.005, 0.005]])
    clouds = [
        replace(one, error=np.array(error), onset=np.repeat(one.onset, 2, axis=1), loss=np.repeat(one.loss, 2, axis=1))
        for one, error in zip(own.clouds, elsewhere, strict=True)
    ]
    said = StringIO()
    tradeoff.show(Screen(Console(file=said, width=80)), replace(own, clouds=tuple(clouds), thetas=np.zeros((2, 2))))
    worst, case = said.getvalue().split("The plant of the case")
    assert "Worst of the plants in the sample" in worst and "one, other" not in worst
    assert "at an error of at most 0.01 one, other by both criteria" in case


def test_labels_cover_neither_lines_nor_each_other():
    """There are twelve labels along a line, in a panel with room for them."""
    figure = Figure(figsize=(6, 5))
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set(xlim=(0, 10), ylim=(0, 10))
    line = np.column_stack([np.linspace(1, 9, 12), 5 + 2 * np.sin(np.linspace(0, 3, 12))])
    labels = LabelPlaces(axes, [line], 6.5)
    for point in line:
        labels.place("Gamma 690", point, "C0")
    for i, (left, low, right, high) in enumerate(labels.boxes):
        x, y = labels.taken.T
        assert not ((x > left) & (x < right) & (y > low) & (y < high)).any()
        assert not any(left < r and right > l and low < h and high > b for l, b, r, h in labels.boxes[:i])  # noqa: E741


def test_a_registered_scheme_brings_its_own_knobs(section_v, monkeypatch):
    """There is no list of schemes other than the registry. A further line there adds a scheme to the comparison."""

    class Slow:
        @classmethod
        def knobs(cls, reach):
            values = {"gamma": reach.gains(1e-4, reach.density)}
            return TuningGrid(scheme="slow", values=values, make=lambda gamma: Mrac(gamma=gamma, name="slow"))

    simulation = Simulation(t_end=20.0, dt=1e-3)
    before, _ = default_knobs(section_v, simulation, density=3)
    monkeypatch.setitem(SCHEMES, "slow", Slow)
    after, _ = default_knobs(section_v, simulation, density=3)
    assert [one.scheme for one in after] == [*(one.scheme for one in before), "slow"] == ["MRAC", "L1-AC", "Robust MRAC", "slow"]
    highest, _ = grids.largest_gain(section_v, simulation)
    np.testing.assert_allclose(after[-1].values["gamma"], highest * np.array([1e-4, 1e-2, 1.0]), rtol=1e-12)


def test_an_unknown_gain_of_one_in_the_case_makes_no_other_structure_than_the_drawn_ones():
    """The case's plant has the default gain of 1, the drawn ones have other gains, and all run in one ensemble."""
    plant = Plant(A_m=[[0.0, 1.0], [-0.3, -1.0]], b=[0.0, 1.0], theta=[1.0, -1.0])
    box = ParameterBox(lower=[-2.0, -2.0], upper=[2.0, 2.0])
    model = ReferenceModel(k_0=0.3)
    problem = Problem(
        plant=plant, reference_model=model, reference=Sine(amplitude=1.0, frequency=0.5), uncertainty=box, input_gain=[0.5, 1.5]
    )
    family = plants_of(problem, box, 4, 0)
    gains = [plant.plant.paths[0].gain for plant in family]
    assert gains[0] == 1.0
    assert len(set(gains)) == 4
    simulation = Simulation(t_end=2.0, dt=1e-3)
    members = [(one, Mrac(gamma=10.0)) for one in family]
    together = simulate_ensemble(members, simulation).metrics
    alone = [simulate(problem, controller, simulation) for problem, controller in members]
    for k, result in enumerate(alone):
        assert np.allclose(together.max_abs_e[k], result["MRAC"].metrics.max_abs_e, rtol=1e-9)
