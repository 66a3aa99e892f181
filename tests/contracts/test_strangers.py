"""Classes from outside the package run, and the output states what is unknown about them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from adaptation.examples import LAW_EXAMPLES
from barbalat.adaptation.laws import LAWS, Gradient
from barbalat.certificates.bounds.laws import guarantee_of, kept_from_zero
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.comparison.tradeoff.tradeoff import trade_off
from barbalat.controllers import Mrac, NormalizedMrac, RobustMrac, Sampled
from barbalat.controllers.tuning_grid import TuningGrid
from barbalat.run.engine.check_numerics import check_numerics
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import delay_margins
from foreign import Bare, Plain, Proportional
from independent import refusal

SIMULATION = Simulation(t_end=2.0, dt=1e-3)


@dataclass(frozen=True)
class Strange:
    """The gradient law without its declarations."""

    gamma: float

    def initial(self, n):
        return ()

    def rates(self, theta_hat, memory, estimation, known_set):
        return Gradient(gamma=self.gamma).rates(theta_hat, memory, estimation, known_set)

    def limit(self, memory):
        return memory


@pytest.mark.parametrize("scheme", [NormalizedMrac, lambda law: RobustMrac(tau=0.2, law=law)])
def test_a_law_from_outside_runs_as_the_law_that_it_copies(problems, scheme):
    """The same equations give the same run bit for bit, continuous and sampled by Euler steps."""
    for make in (lambda c: c, lambda c: Sampled(controller=c, sample_time=5e-3, discretization="euler")):
        runs = [simulate(problems[2], [make(scheme(law=law))], SIMULATION) for law in (Strange(7.0), Gradient(gamma=7.0))]
        found, expected = (next(iter(run.values())) for run in runs)
        np.testing.assert_array_equal(found.states, expected.states)


def test_nothing_is_claimed_of_a_law_from_outside(problems):
    controller = NormalizedMrac(law=Strange(7.0))
    found = certify(problems[2], [controller], SIMULATION)[controller.name]
    assert "step_max" not in found.values and "gamma_max" not in found.values
    for scheme in (controller, RobustMrac(tau=0.2, law=Strange(7.0))):
        (column,) = table_1(problems[2], [scheme], certify(problems[2], [scheme], SIMULATION)).columns
        for key in ("stability", "tracking", "transient", "estimates", "modelling_error"):
            assert not column.cells[key].applies, key
        assert "no guarantee is known for Strange" in column.cells["stability"].why
    sampled = Sampled(controller=controller, sample_time=5e-3)
    message = refusal(lambda: simulate(problems[2], [sampled], SIMULATION))
    assert "sampled_step" in message and "Strange" in message and "'euler'" in message


def test_a_scheme_from_outside(problems):
    """The scheme runs, continuous and sampled. Only the class itself could have a midpoint form."""
    plain = Plain(5.0)
    run = simulate(problems[2], [plain], SIMULATION)["plain"]
    assert np.isfinite(run.states).all() and run.adapting.on_bounds is None and run.adapting.excitation is None
    euler = Sampled(controller=plain, sample_time=5e-3, discretization="euler")
    results = simulate(problems[2], [euler], SIMULATION)
    assert results["plain"].stiffness.radius_max is not None
    assert check_numerics(results).keys() == results.keys()
    assert "midpoint" in refusal(lambda: simulate(problems[2], [replace(euler, discretization="midpoint")], SIMULATION))


def test_the_form_of_a_class_from_outside_does_not_matter(problems):
    """The results are the same bit for bit whether or not the class is a dataclass or keeps its equations in a separate object,
    also if numbers vary."""
    runs = [simulate_ensemble([(problems[2], make(g)) for g in (1.0, 2.0, 5.0)], SIMULATION) for make in (Plain, Bare)]
    assert runs[0].varied == runs[1].varied == 1
    np.testing.assert_array_equal(runs[0].metrics.rms_e, runs[1].metrics.rms_e)
    assert "2.0" in refusal(lambda: simulate_ensemble([(problems[2], Plain(g)) for g in (1, 2)], SIMULATION))


def test_simulated_margins_and_trade_offs_of_classes_from_outside(problems):
    """The margins and trade-offs equal those of MRAC with the same equations. Margins are accessed by name, like results."""
    problem, simulation = problems[2], Simulation(t_end=5.0, dt=1e-2)
    controllers = [Mrac(gamma=10.0, projection=False), Plain(10.0), Bare(10.0), Proportional([1.0, 1.0])]
    found = delay_margins(problem, controllers, simulation, scan=4, resolution=0.2)
    assert list(found) == ["MRAC", "plain", "bare", "proportional"]
    for name in ("plain", "bare"):
        assert found[name].loss.tolerates == found["MRAC"].loss.tolerates
        assert found[name].onset.tolerates <= found[name].loss.tolerates
    knobs = [TuningGrid(scheme=m.__name__, values={"gamma": np.array([1.0, 10.0])}, make=m) for m in (Plain, Bare)]
    own = trade_off(problem, simulation, knobs=tuple(knobs), plants=2).clouds
    np.testing.assert_array_equal(own[0].error, own[1].error)
    np.testing.assert_array_equal(own[0].loss, own[1].loss)


def test_what_is_no_law():
    assert "initial, rates and limit" in refusal(lambda: NormalizedMrac(law=3.0))


@pytest.mark.parametrize("name", LAWS)
def test_every_registered_law_knows_what_it_guarantees(name):
    """The words are bounded and, without a set and modifications, converging to zero, unless the law's example says otherwise."""
    example = LAW_EXAMPLES[name]
    found = guarantee_of(LAWS[name](**example.numbers), None)
    assert found.bounded == found.error_to_zero == example.unexcited
    assert ("nothing is guaranteed" in kept_from_zero(found)) == (not found.bounded)
