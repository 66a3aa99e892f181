"""The measure of an oscillation for known signals, and the oscillation of a run compared with the frequency of adaptation."""

import numpy as np
import pytest

from barbalat.controllers import Mrac
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter import control_oscillation
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation


def test_tones():
    t = np.linspace(0, 10, 100_001)
    slow = 1000 * np.sin(0.5 * t) + 200 * t
    one = control_oscillation.oscillation(t, slow + 3 * np.sin(2000 * t))
    assert one.mean == pytest.approx(2000, rel=0.01)
    assert one.peak == pytest.approx(2000, rel=0.01)
    assert one.rms == pytest.approx(3 / np.sqrt(2), rel=0.01)
    two = control_oscillation.oscillation(t, slow + 3 * np.sin(2000 * t) + np.sin(8000 * t))
    assert two.mean == pytest.approx((9 * 2000 + 8000) / 10, rel=0.01)  # weighted by the power
    assert two.peak == pytest.approx(2000, rel=0.01)


def test_the_ringing_of_the_equations():
    """Without a filter and with a step that resolves it, the strongest frequency is sqrt(Gamma b'P b) |x|."""
    gamma, given = 100.0, section_v.problem()
    run = simulate(given, [Mrac(gamma=gamma)], Simulation(t_end=4.0, dt=2e-5, record_points=100_000))["MRAC"]
    # P A_m + A_m'P = -I by hand: p_12 = 1/0.6, p_22 = (1 + 2 p_12)/2
    w = np.sqrt(gamma * (1 + 2 / 0.6) / 2) * np.linalg.norm(run.x, axis=1)[run.t > 2.0]
    found = control_oscillation.oscillation(run.t, run.u)
    assert 0.9 * w.min() < found.peak < 1.1 * w.max()
    assert found.mean < 1.5 * w.max()
