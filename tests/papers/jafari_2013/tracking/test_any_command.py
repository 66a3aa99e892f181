"""The commands are bounded and of all kinds, their runs agree with SciPy's, and with a modelling error the error would not
decrease."""

import numpy as np
import pytest

from barbalat.controllers import Mrac
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.papers.jafari_2013.tracking import any_command
from barbalat.problem.actuation import PlantInput
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.signals import Sines
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from papers import by_hand


def test_the_commands():
    tried = any_command.commands(3, 400.0)
    assert [kind for kind, _ in tried] == [kind for kind in any_command.KINDS for _ in range(3)]
    t = np.linspace(0, 400, 40_001)
    values = np.array([command(t) for _, command in tried])
    assert (np.abs(values).max(axis=1) <= any_command.LARGEST_COMMAND * (1 + 1e-12)).all()
    assert len({tuple(row[::400]) for row in values.round(9)}) == len(tried)  # no two are the same
    again = np.array([command(t) for _, command in any_command.commands(3, 400.0)])
    assert (values == again).all()


@pytest.mark.parametrize("kind", ["sum of sines", "chirp"])
def test_the_runs_are_those_of_scipy(kind):
    command = next(command for name, command in any_command.commands(1, 20.0) if name == kind)
    t = np.linspace(0, 20, 20_001)
    e, _ = by_hand.robust_mrac(lambda time: float(command(np.array(time))), t, tau=section_v.TAU)
    found = figures([(variant(reference=command), section_v.robust_mrac("r", projection=False))], 20.0, any_command.STEP)
    np.testing.assert_allclose(found.max_abs_e[0], np.abs(e).max(axis=0), rtol=1e-4)
    np.testing.assert_allclose(found.tail_max_abs_e[0], np.abs(e[t >= 15]).max(axis=0), rtol=1e-3)


def test_an_error_that_rises_again_is_no_counterexample_to_a_limit():
    """The standard MRAC's error under the first sum of sines is twice as large in the last quarter as in the second."""
    tried = [one for one in any_command.commands(1, 400.0) if one[0] in ("sum of sines", "constant")]
    robust, standard = any_command.followed(tried, 400.0)
    assert (robust.ratios < 1).all() and standard.ratios.max() > 2
    assert standard.fell.startswith("1 of 2 errors fell") and standard.small.holds and not standard.small.decides
    spent = standard.squared * any_command.MRAC_GAIN / 25  # V(0) = |theta~(0)|^2/Gamma, theta = [4, -3]
    assert (spent > 0).all() and (spent < 1).all()


def test_the_standard_mracs_quarters_and_integral_are_those_of_a_finer_step():
    command = next(command for name, command in any_command.commands(1, 20.0) if name == "sum of sines")
    (found, squared), (fine, of_fine) = (
        any_command.quarter_errors(command, 20.0, Mrac(gamma=any_command.MRAC_GAIN), h)
        for h in (any_command.MRAC_STEP, any_command.MRAC_STEP / 8)
    )
    np.testing.assert_allclose(found, fine, rtol=1e-2)
    assert squared == pytest.approx(of_fine, rel=1e-2)


def test_with_a_modelling_error_it_stays():
    """The row's property does not hold for every run. The same controller with a delay and two sines violates it."""
    given, simulation = (
        variant(reference=Sines((30.0, 20.0), (0.5, 1.7)), input=PlantInput(delay=0.03)),
        Simulation(t_end=400.0, dt=any_command.STEP),
    )
    found = simulate_ensemble([(given, section_v.robust_mrac("r"))], simulation, quarters=True).quarters
    second, last = found[0, [1, 3]].max(axis=1) / ReferenceMotion.of(given, simulation).largest
    assert last > 0.7 * second
    assert last > 5 * any_command.SMALL_ERROR_SHARE
