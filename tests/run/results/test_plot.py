"""Results plot themselves and describe themselves on one line."""

from html import escape

import numpy as np
import pytest
from matplotlib.figure import Figure

from barbalat import (  # fmt: skip
    DirectMrac,
    KnownParameters,
    Mrac,
    NetworkMrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    certify,
    load_case,
    simulate,
    simulate_ensemble,
)
from barbalat.laws import FixedSigma  # fmt: skip
from barbalat.problem.command_gain import command_warning, gains_at_rest
from barbalat.results import Results, plot  # fmt: skip
from barbalat.run.results.outcome import ends_of, text_of
from barbalat.run.results.picture import panels
from barbalat.signals import Constant, Sine, Step, Steps  # fmt: skip
from barbalat.solvers import EULER  # fmt: skip
from barbalat.studies import check_numerics, delay_margins  # fmt: skip
from barbalat.study.tau_limit import TauLimits
from independent import refusal

SHORT = Simulation(2.0, 1e-2)


def problem(k_0=4.0, reference=None, **known):
    plant = Plant([[0, 1], [-4, -2]], [0, 1], [1, -1])
    return Problem(plant, ReferenceModel(k_0), Step(1.0) if reference is None else reference, **known)


@pytest.fixture(scope="module")
def results():
    return simulate(problem(), [Mrac(5), Mrac(50), Sampled(Mrac(5), 0.1), Sampled(Mrac(5), 0.2)], SHORT)


def test_of_one_name_all_but_the_first_are_numbered(results):
    assert list(results) == ["MRAC", "MRAC 2", "MRAC 3", "MRAC 4"]
    assert [result.name for result in results.values()] == list(results)
    assert results["MRAC 2"].controller.gamma == 50
    assert list(certify(problem(), [Mrac(5), Mrac(50)], SHORT)) == ["MRAC", "MRAC 2"]


def test_any_collection_of_controllers_or_one(results):
    given = Mrac(5), Mrac(50)
    for controllers in (given, iter(given), {"a": given[0], "b": given[1]}.values()):
        assert list(simulate(problem(), controllers, SHORT)) == ["MRAC", "MRAC 2"]
    np.testing.assert_array_equal(simulate(problem(), Mrac(5), SHORT)["MRAC"].x, results["MRAC"].x)
    for nothing in ([], {}, "MRAC", None):
        assert "controller" in refusal(lambda nothing=nothing: simulate(problem(), nothing, SHORT))


def test_a_result_on_one_line_and_in_a_notebook(results):
    text = repr(results["MRAC"])
    assert "\n" not in text and len(text) < 250 and "max |e|" in text
    html = results["MRAC"]._repr_html_()
    assert "<table>" in html and "data:image/svg+xml;base64," in html


def test_the_estimates_at_the_end_are_all_that_a_scheme_adapts():
    """For direct MRAC they are k_r and theta_hat, for a network the largest of its many weights."""
    network = NetworkMrac(5.0, gamma_v=1.0, neurons=6, leakage=FixedSigma(0.1))
    direct, plain, net = simulate(problem(), [DirectMrac(10.0, gamma_r=5.0), Mrac(5.0), network], SHORT).values()
    assert ends_of(direct) == f"{text_of(direct.theta_hat[-1].tolist())}; k_r {direct.reported['k_r_hat'][-1][0]:.4g}"
    assert ends_of(plain) == text_of(plain.theta_hat[-1].tolist())
    weights = np.abs(net.reported["V_hat"][-1])
    assert ends_of(net).endswith(f"; V {weights.max():.4g}, the largest of {weights.size} entries")
    assert f"<td>{ends_of(direct)}</td>" in direct._repr_html_()


def test_several_results_are_a_dictionary_that_shows_itself(results):
    """The dictionary prints on one line. In a notebook it shows a row for each run and one picture of all. Otherwise it behaves
    like a plain dictionary."""
    assert isinstance(results, dict) and results == dict(results)
    assert isinstance(check_numerics(results), Results)
    text = repr(results)
    assert "\n" not in text and len(text) < 60 * len(results) and all(repr(name) in text for name in results)
    html = results._repr_html_()
    assert html.count("<tr>") == 1 + len(results) and html.count("<img") == 1
    assert [axes.get_title() for axes in results.plot().axes] == [axes.get_title() for axes in plot(results).axes]
    assert "no runs" in Results()._repr_html_()


def test_the_first_panel_is_the_motion_with_model_and_command(results):
    first, *_ = panels(list(results.values()))
    assert [series.label for series in first.series] == [*results, "model $x_{m,1}$", "command $r$"]
    np.testing.assert_array_equal(first.series[0].value, results["MRAC"].x[:, 0])
    np.testing.assert_array_equal(first.series[-2].value, results["MRAC"].x_m[:, 0])
    np.testing.assert_array_equal(first.series[-1].value, results["MRAC"].r)


def test_on_a_grey_print_the_legend_tells_lines_apart_by_their_widths(results):
    """Each compared run has a different line width, in the panel and in its legend."""
    axes = next(axes for axes in plot(list(results.values())[:3]).axes if axes.get_legend())
    shown = {line.get_label(): line.get_linewidth() for line in axes.get_legend().legend_handles}
    widths = [shown[name] for name in list(results)[:3]]
    assert len(set(widths)) == 3 and set(widths) <= {line.get_linewidth() for line in axes.get_lines()}


def test_the_estimates_stand_with_the_true_values_and_fill_their_panel(results):
    *_, estimates = panels([results["MRAC"]])
    low, high = estimates.limits
    moved = results["MRAC"].theta_hat
    assert {level.value for level in estimates.levels} <= {1.0, -1.0}
    shown = [*moved.ravel(), *(level.value for level in estimates.levels if low <= level.value <= high)]
    assert low <= min(shown) and high >= max(shown)
    assert high - low < 1.2 * np.ptp(shown)


@pytest.mark.parametrize("case", ["paper", "l1-output", "lateral-aircraft"])
@pytest.mark.short(kept=lambda case: case != "lateral-aircraft")
def test_every_kind_of_result_is_drawn(case):
    found = load_case(case)
    short = Simulation(2.0, found.simulation.dt)
    drawn = simulate(found.problem, found.controllers, short)
    for figure in (plot(drawn), plot(drawn, narrow=True), next(iter(drawn.values())).plot(), plot(list(drawn.values())[:2])):
        assert isinstance(figure, Figure)
        figure.draw_without_rendering()


def test_what_is_no_result_is_refused():
    assert "results of simulate" in refusal(lambda: plot([1]))
    assert "at least one" in refusal(lambda: plot({}))


def test_a_k_0_that_was_chosen_wrongly_is_said():
    """x_m settles at -A_m^-1 b k_0 r = k_0/4 r here."""
    assert command_warning(problem(4.0)) is None
    np.testing.assert_allclose(gains_at_rest(problem(6.0)), [[1.5], [0.0]], atol=1e-15)
    sentence = command_warning(problem(6.0))
    assert "1.5 times" in sentence and sentence.endswith("k_0 = 4")
    assert sentence in simulate(problem(6.0), Mrac(5), SHORT)["MRAC"].warnings


def test_true_values_outside_the_known_set_are_said():
    """theta = (1, -1) is inside and outside a box, and an input gain of 1 is outside its interval."""
    inside, outside = (problem(uncertainty=ParameterBox([-2, -2], [upper, 2])) for upper in (2, 0.5))
    assert inside.outside_known_set is None and problem().outside_known_set is None
    sentence = outside.outside_known_set
    assert "theta [1.0, -1.0] lies outside the known set, between [-2.0, -2.0] and [0.5, 2.0]" in sentence
    assert sentence in simulate(outside, Mrac(5), SHORT)["MRAC"].warnings
    assert "outside" in problem(input_gain=(2, 3)).outside_known_set and problem(input_gain=(0.5, 3)).outside_known_set is None


def test_a_step_response_in_numbers():
    """With theta = 0 the run is the model from zero with zeta = 1/2 and omega = 2, whose overshoot is 100 exp(-pi zeta/sqrt(1 -
    zeta^2)) percent."""
    plant = Plant([[0, 1], [-4, -2]], [0, 1], [0, 0])
    given = Problem(plant, ReferenceModel(4.0), Step(2.0, start=1.0))
    info = simulate(given, Mrac(1.0), Simulation(16.0, 1e-3, record_points=8000))["MRAC"].step_info()
    zeta = 0.5
    overshoot = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    assert info["SteadyStateValue"] == pytest.approx(2.0, abs=1e-4)
    assert info["Peak"] == pytest.approx(2 * (1 + overshoot), rel=1e-4)
    assert info["Overshoot"] == pytest.approx(100 * overshoot, rel=1e-3)
    assert info["PeakTime"] == pytest.approx(np.pi / (2 * np.sqrt(1 - zeta**2)), abs=4e-3)  # two recorded instants


def test_the_peak_of_a_step_downwards_is_a_level_that_was_reached():
    """The steps are from 1 to -1, where the largest distance is at least 2, and from 0 downwards."""
    plant = Plant([[0, 1], [-4, -2]], [0, 1], [0, 0])
    for command in (Steps(times=[0.0, 8.0], values=[1.0, -1.0]), Constant(-1.0)):
        result = simulate(Problem(plant, ReferenceModel(4.0), command), Mrac(1.0), Simulation(16.0, 1e-3))["MRAC"]
        assert result.step_info()["Peak"] == pytest.approx(result.x[:, 0].min())


def test_step_info_says_what_it_lacks():
    result = simulate(problem(reference=Constant(0.0)), Mrac(5), SHORT)["MRAC"]
    assert "jumps" in refusal(result.step_info)
    result = simulate(problem(), Mrac(5), SHORT)["MRAC"]
    assert "from 1 to 2" in refusal(lambda: result.step_info(3))


def test_an_ensemble_on_one_line_and_as_a_picture():
    found = simulate_ensemble([(problem(), Mrac(float(gamma))) for gamma in (1.0, 3.0, 10.0)], SHORT)
    assert "3 members" in repr(found) and "\n" not in repr(found)
    figure = found.plot()
    x, share = figure.axes[0].lines[0].get_data()
    np.testing.assert_allclose(x, np.sort(found.metrics.max_abs_e[:, 0]))
    np.testing.assert_allclose(share, [1 / 3, 2 / 3, 1])


def test_studies_and_ensembles_show_themselves_in_a_notebook():
    found = simulate_ensemble([(problem(), Mrac(float(gamma))) for gamma in (1.0, 3.0)], SHORT)
    margins = delay_margins(problem(reference=Sine(1.0, 2.0)), Mrac(5), SHORT, scan=4)["MRAC"]
    limits = TauLimits(
        sizes=np.array([0.01, 0.1]), taus=np.array([0.1, 1.0]), tail=np.array([[0.1, 1.0], [np.nan, 1.0]]),
        tolerates=np.array([0.1, 0.5]), loses=np.array([0.0, 0.4]), at_tolerated=np.array([0.1, 0.6]), runs=7,
    )  # fmt: skip
    for shown in (found, margins, limits):
        html = shown._repr_html_()
        assert repr(shown).strip("<>") in html and "data:image/svg+xml;base64," in html
    assert "tau from 0.1 to 0.5" in repr(limits)
    tolerated, lost = limits.plot().axes[0].lines
    np.testing.assert_array_equal(tolerated.get_xydata(), [[0.01, 0.1], [0.1, 0.5]])
    np.testing.assert_array_equal(lost.get_xydata(), [[0.1, 0.4]])  # of the first size no smaller tau was tried


def test_a_panel_that_stands_alone_has_its_whole_row(results):
    """Error and control are side by side, and the estimates are below them."""
    figure = plot(results["MRAC"])
    widths = sorted(axes.get_position().width for axes in figure.axes)
    assert len(widths) == 4 and widths[1] < 0.5 < widths[2] == widths[3]


def titles(figure):
    return [axes.get_legend().get_title().get_text().splitlines()[0] for axes in figure.axes if axes.get_legend()]


def test_panels_are_chosen_by_their_names(results):
    """The panels are in the order of the names, and each appears once. A state may be given by its number or by its name."""
    both = results["MRAC"].plot(panels=["control", "motion"])
    assert [one.split()[0] for one in titles(both)] == ["Control", "State"]
    assert len(titles(results["MRAC"].plot(panels="x_1"))) == len(titles(plot(results, panels=["motion", "x_1"]))) == 1
    own = titles(results.plot(panels="MRAC"))
    assert own and all(one.startswith("MRAC: ") for one in own)
    said = refusal(lambda: plot(results, panels="contrl"))
    assert said.startswith("panels must be one of motion, x_1, ") and said.endswith("did you mean 'control'?")
    assert "at least one" in refusal(lambda: plot(results, panels=[]))


def test_a_state_is_chosen_by_its_label():
    found = load_case("lateral-aircraft")
    result = next(iter(simulate(found.problem, found.controllers[:1], Simulation(1.0, 1e-3)).values()))
    name = next(filter(None, (found.problem.labels.name(state) for state in range(found.problem.plant.n))))
    assert len(titles(result.plot(panels=name))) == 1


def test_panels_are_drawn_into_axes_of_ones_own(results):
    """Earlier content is kept. Nothing in the figure changes except these axes."""
    figure = Figure(figsize=(6, 4))
    left, right = figure.subplots(1, 2)
    left.plot([0, 1], [5, 5])
    before = left.get_position().bounds
    assert results["MRAC"].plot(panels=["error", "control"], axes=[left, right]) is figure
    assert len(left.get_lines()) > 1 and right.get_lines() and left.get_position().bounds == before
    assert [one.split()[0] for one in titles(figure)] == ["Tracking", "Control"]
    figure.draw_without_rendering()
    alone = Figure().subplots()
    assert plot(results, panels="largest error", axes=alone) is alone.figure
    grid = Figure().subplots(2, 2)
    result = next(iter(results.values()))
    assert result.plot(panels=["motion", "error", "control", "estimates"], axes=grid) is grid[0, 0].figure
    said = refusal(lambda: results["MRAC"].plot(panels=["error", "control"], axes=left))
    assert said.startswith("axes must be 2 pairs of Matplotlib's axes, for error, control, got ")
    assert "1 pair of" in refusal(lambda: results["MRAC"].plot(panels="error", axes=["no axes"]))


def test_what_a_problem_is_made_of_is_one_line_at_a_prompt():
    shown = repr(problem().plant)
    assert "\n" not in shown and "theta=[ 1., -1.]" in shown and "regressor" not in shown
    boxed = problem(uncertainty=ParameterBox([-2, -2], [2, 2]))
    assert repr(boxed) == "<Problem 'problem': 2 states, 1 input; 2 unknown parameters in a known set; command Step>"
    assert repr(load_case("rohrs").problem).startswith(
        '<OutputProblem "Rohrs\' counterexample": output feedback, a plant of order 3'
    )
    assert repr(Simulation(2.0, 1e-2)) == "Simulation(t_end=2.0, dt=0.01)"
    assert repr(Simulation(2.0, 1e-2, solver=EULER)) == "Simulation(t_end=2.0, dt=0.01, solver=<Tableau 'euler' of order 1>)"


@pytest.mark.parametrize("name", ["paper", "rohrs", "lateral-aircraft"])
def test_a_case_in_a_notebook_says_what_is_given(name):
    case = load_case(name)
    html = case._repr_html_()
    assert case.problem._repr_html_() in html and html.count("<table>") == 3
    assert all(escape(one.name) in html for one in case.controllers) and "plant." in html
    assert "array(" not in html and "None" not in html


def test_an_estimate_that_moves_little_gets_axes_on_which_it_is_seen():
    """The F-16's input gain changes by 1, its other estimates by 20. On shared axes it would be a flat line."""
    found = load_case("f16-short-period")
    (mrac,) = simulate(found.problem, found.controllers[0], Simulation(20.0, 2e-3)).values()
    large, small = panels([mrac])[-2:]
    assert [one.label for one in large.series] == [r"$\hat{\theta}_{1}$", r"$\hat{\theta}_{2}$"]
    assert [one.label for one in small.series] == [r"$\hat{\omega}$"]
    assert "known set: -40" in large.note.replace("\N{NO-BREAK SPACE}", " ") and large.limits[1] < 20
    assert {level.of for level in small.levels if level.label == "true values"} == {0}
    assert small.limits[1] - small.limits[0] < 2


def test_each_of_several_commands_says_where_the_model_settles():
    found = load_case("lateral-aircraft")
    drawn = panels(list(simulate(found.problem, found.controllers[:1], Simulation(2.0, 1e-3)).values()))
    for panel in drawn[:2]:
        assert "the others at zero" in panel.note and "settles at" in panel.note
        gain = next(series.label.split(" × ")[0] for series in panel.series if " × " in series.label)
        assert gain in panel.note


def test_a_run_that_is_lost_leaves_shared_panels_to_the_others():
    """Without feedback x grows to 1e5 in 5 s, which is not divergence. MRAC's motion, of size 1, must remain visible."""
    plant = Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=[5.0, 3.0], x0=[0.1, 0.0])
    unstable = Problem(plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Sine(amplitude=1.0, frequency=1.0))
    nothing = KnownParameters(theta=[0.0, 0.0], name="nothing")
    runs = simulate(unstable, [nothing, Mrac(gamma=10.0)], Simulation(t_end=5.0, dt=1e-2))
    assert runs["nothing"].diverged_at is None and str(runs["nothing"].verdict).startswith("lost at t = ")
    assert runs["nothing"].figures["max_abs_e"][0] > 1e4
    shared = [panel for panel in panels(list(runs.values())) if {"nothing", "MRAC"} <= {series.label for series in panel.series}]
    assert len(shared) >= 3 and all(panel.limits is not None and max(map(abs, panel.limits)) < 1e3 for panel in shared)
