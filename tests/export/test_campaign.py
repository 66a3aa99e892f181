"""A campaign's metrics, compared with runs of the simulation, which has the same faults without C."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.flight_cases import CASES

from barbalat.cases.load import load_case
from barbalat.commands.export import _show
from barbalat.export.campaign import LOST_SHARES, STARTS, TOLERATED, Campaign, Degradation, Search, export_campaign
from barbalat.export.in_the_loop import simulate_export
from barbalat.plants import Dropout, Jitter, Shell, Spike
from barbalat.report.terminal.layout import Screen
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.simulate import simulate, with_missed_samples
from barbalat.signals import Square
from barbalat.solvers.simulation import Simulation
from export.examples import T
from export.targets import needs_gcc
from export.test_shell import one, surrounded

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "campaign.txt"
RUN = Simulation(t_end=8.0, dt=T / 2)
DRAWS = 2


def largest(problem, controller) -> np.ndarray:
    batch = Batch.of([(problem, controller)], RUN)
    run([batch], problem.signals, RUN)
    return batch.metrics(RUN).max_abs_e[0]


@needs_gcc
@pytest.mark.parametrize("scheme", ["Mrac-state-midpoint", "MracOutput-output-midpoint"])
@pytest.mark.short(kept=lambda scheme: scheme.startswith("Mrac-"))
def test_its_figures_are_those_of_the_simulation(scheme) -> None:
    faults = (Spike(size=0.5, share=0.05), Dropout(share=0.2, seed=5))
    problem, controller = surrounded(scheme, Shell(longest_outage=0.04, fallback="fade", fade=0.1), faults)
    found = export_campaign(problem, controller, RUN, draws=DRAWS)
    assert found.nominal == tuple(largest(replace(problem, faults=()), controller))
    own, one_percent = found.rows[:2]
    drawn = [tuple(replace(fault, seed=fault.seed + k) for fault in faults) for k in range(DRAWS)]
    assert own.worst == tuple(np.max([largest(replace(problem, faults=each), controller) for each in drawn], axis=0))
    lost = [(Dropout(share=LOST_SHARES[0], seed=k),) for k in range(DRAWS)]
    assert one_percent.worst == tuple(np.max([largest(replace(problem, faults=each), controller) for each in lost], axis=0))
    t = np.arange(round(RUN.t_end / T)) * T
    assert one_percent.missed == pytest.approx(np.mean([fault.there(t, 0).mean() for (fault,) in lost]))


@needs_gcc
def test_with_an_observer_the_errors_are_those_of_all_states(capsys) -> None:
    """Only two of the four states are measured, and their names once stood above the errors of the first two."""
    case = load_case("flexible-joint")
    controller = next(one for one in case.controllers if one.name == "ADRC")
    found = export_campaign(case.problem, controller, replace(case.simulation, t_end=1.0), draws=1)
    assert found.names == ("theta", "alpha", "theta_dot", "alpha_dot")
    assert found.units == ("rad", "rad", "rad/s", "rad/s")
    assert len(found.nominal) == len(found.names)
    _show(Screen(), found)
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines())) <= 80
    for row in found.rows:  # one line each, with the component that grows most
        i = int(np.argmax(np.array(row.worst) / found.nominal))
        assert found.worst_component(row) == i
        assert f"{row.worst[i]:.4g} in {found.names[i]} [{found.units[i]}]" in said


@needs_gcc
def test_the_longest_outage_is_tolerated_and_the_next_one_is_not() -> None:
    problem, controller = one("Mrac-state-midpoint")
    found = export_campaign(problem, controller, RUN, draws=1)
    assert 0 < found.longest < found.most

    def tolerated(samples: int) -> bool:
        outages = [Dropout(times=((start - T / 2, start + (samples - 0.5) * T),)) for start in found.starts]
        errors = [largest(replace(problem, faults=(each,)), controller) for each in outages]
        return bool((np.array(errors) <= TOLERATED * np.array(found.nominal)).all())

    assert tolerated(found.longest) and not tolerated(found.longest + 1)
    assert found.worst in found.starts and len(found.starts) > STARTS


@needs_gcc
def test_outages_are_tried_where_they_do_harm() -> None:
    """With a square command the worst outages begin just after its jump; evenly spread instants miss them."""
    problem, controller = one("Mrac-state-midpoint")
    found = export_campaign(replace(problem, reference=Square(amplitude=1.0, frequency=1.2)), controller, RUN, draws=1)
    jump = np.pi / 1.2
    assert found.worst is not None and any(-0.1 <= found.worst - k * jump <= 0.3 for k in (1, 2, 3))


def test_the_search_finds_the_worst_neighbour_and_the_shortest_outage_everywhere() -> None:
    """The tolerated length is 40 samples at most instants, and falls to 7 at sample 103."""
    tried: list[tuple[int, int]] = []

    def tolerates(k: int, samples: int) -> bool:
        tried.append((k, samples))
        return samples <= min(40, 7 + 3 * abs(k - 103))

    search = Search(1000, tolerates)
    assert search.longest([100, 500, 900]) == 7 and search.worst == 103
    assert all((k, 7) in tried for k in search.tried) and (103, 8) in tried
    assert Search(1000, lambda k, samples: True).longest([1, 2]) == 1000
    assert Search(1000, lambda k, samples: False).longest([1, 2]) == 0


@needs_gcc
def test_regular_outages_are_just_within_the_longest_one() -> None:
    """Of every six samples five are lost, in each phase: no fallback acts, and the metrics are the simulation's with these times
    written out."""
    problem, controller = surrounded("Mrac-state-midpoint", Shell(longest_outage=5 * T, fallback="zero"), ())
    regular = export_campaign(problem, controller, RUN, draws=DRAWS).rows[-1]
    assert (regular.faults, regular.draws) == ("5 of every 6 samples lost", DRAWS)
    samples = range(round(RUN.t_end / T))
    lost = [tuple(((k - 0.5) * T if k else 0.0, (k + 0.5) * T) for k in samples if k % 6 != first) for first in (0, 3)]
    drawn = [replace(problem, faults=(Dropout(times=times),)) for times in lost]
    assert regular.worst == tuple(np.max([largest(each, controller) for each in drawn], axis=0))
    runs = [with_missed_samples(simulate(each, [controller], RUN))[controller.name].missed for each in drawn]
    assert [(run.in_a_row, run.fallback) for run in runs] == [(5, 0), (5, 0)] and regular.missed == pytest.approx(5 / 6, abs=0.01)


@needs_gcc
def test_a_jitter_within_the_shells_band_is_taken_and_so_is_one_without_a_band() -> None:
    """The status reports both kinds of jitter. Neither counts as a missed sample."""
    for shell in (None, Shell(longest_outage=0.04, jitter=0.45)):
        problem, controller = surrounded("Mrac-state-midpoint", shell, (Jitter(time=0.002),))
        found = simulate_export(problem, controller, replace(RUN, t_end=1.0, dt=T / 10))
        assert found.refused == 0


@needs_gcc
def test_a_campaign_in_32_bits_flies_them() -> None:
    problem, controller = one("Mrac-state-midpoint")
    short = replace(RUN, t_end=2.0)
    wide, narrow = (export_campaign(problem, controller, short, draws=1, float32=bits) for bits in (False, True))
    assert wide.nominal != narrow.nominal
    np.testing.assert_allclose(wide.nominal, narrow.nominal, rtol=1e-3)


def test_what_the_longest_outage_is_worth_is_told(capsys) -> None:
    row = Degradation(faults="15 of 16 lost", draws=1, missed=0.9375, beyond=0.996, worst=None, lost=1, classes={"lost": 1})
    found = Campaign(
        controller="c", names=("a",), units=(), sample_time=T, nominal=(1.0,), rows=(row,), starts=(T, 2 * T), longest=3, most=9,
        worst=2 * T, allowed=5,
    )  # fmt: skip
    _show(Screen(), found)
    said = " ".join(capsys.readouterr().out.split())
    assert "any of 2 instants tried: 3 samples, 0.03 s; one sample longer from t = 0.02 s on did harm. This is an" in said
    assert "The shell's longest_outage is longer, 5 samples" in said and "94 % 100 %" in said
    _show(Screen(), replace(found, allowed=3))
    assert "longest_outage" not in capsys.readouterr().out


def test_a_verdict_is_shown_only_where_it_differs_from_that_without_faults(capsys) -> None:
    """A table of two states has one line for each kind of fault on a screen of 80 columns."""
    row = Degradation(faults="10 % lost, in bursts of 10", draws=8, missed=0.1, beyond=0.2, worst=(2.0, 3.0), lost=0)
    same, worse = replace(row, classes={"off": 8}), replace(row, faults="50 % lost", classes={"off": 7, "limit cycle": 1})
    found = Campaign(
        controller="c", names=("theta", "omega"), units=("rad", "rad/s"), sample_time=T, nominal=(1.0, 2.0), rows=(same, same),
        starts=(T,), longest=3, most=9, verdict="off", sentence="off by 9 % in omega",
    )  # fmt: skip
    _show(Screen(), found)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[-5:] for line in lines if "in bursts of 10" in line] == [["20", "%", "2", "3", "2"]] * 2
    assert max(map(len, lines)) <= 80 and not any("verdict  " in line for line in lines)
    _show(Screen(), replace(found, rows=(same, worse)))
    said = capsys.readouterr().out
    assert "none: verdict off," in said and "50 % lost: verdict off 7, limit cycle 1," in said
    assert "10 % lost, in bursts of 10: missed samples 10 %," in said


def test_a_component_without_any_error_does_not_count() -> None:
    row = Degradation(faults="", draws=1, missed=0.0, beyond=0.0, worst=(0.0, 3.0), lost=0)
    found = Campaign(
        controller="c", names=("a", "b"), units=(), sample_time=T, nominal=(0.0, 2.0), rows=(row,), starts=(), longest=0, most=1
    )
    assert found.factor(row) == 1.5
    assert found.factor(replace(row, worst=(1e-3, 3.0))) == np.inf


def test_every_controller_whose_cost_is_counted_has_a_row() -> None:
    rows = [line.split("|")[1].strip() for line in PAGE.read_text(encoding="utf-8").splitlines()[2:]]
    assert rows == [name for name, _, _ in CASES]


@needs_gcc
def test_each_row_has_the_judges_classes_of_its_runs() -> None:
    """The metrics equal those of the simulation. Holding a lost measurement in the judge's continuation would open the loop."""
    problem, controller = one("Mrac-state-midpoint")
    short = replace(RUN, t_end=4.0)
    found = export_campaign(problem, controller, short, draws=2)
    row = found.rows[1]
    drawn = [replace(problem, faults=(Dropout(share=LOST_SHARES[1], seed=k),)) for k in range(2)]
    verdicts = [simulate(each, controller, short)[controller.name].verdict for each in drawn]
    kinds = [str(each.kind) for each in verdicts if each is not None]
    assert row.classes == {kind: kinds.count(kind) for kind in kinds}
    assert found.verdict and found.sentence
