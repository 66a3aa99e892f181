"""The second term of (17): the runs compared with SciPy's, the norm compared with a quadrature, and the readings for other
numbers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat.linear.systems import TransferFunction
from barbalat.papers.jafari_2013.robustness import delta_2
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.problem.actuation import PlantInput
from papers import by_hand


@pytest.mark.parametrize("alpha_0", [0.0, delta_2.ALPHA_0])
def test_the_runs_are_those_of_scipy(alpha_0):
    tau, mu, t = 0.25, 0.016, np.linspace(0, 10, 10_001)
    e, _ = by_hand.robust_mrac(lambda time: float(delta_2.COMMAND(np.array(time))), t, tau=tau, alpha_0=alpha_0, mu=mu)
    path = PlantInput(multiplicative=TransferFunction([-mu, 0.0], [delta_2.DERIVATIVE_POLE, 1.0]))
    controller = replace(delta_2.controller(tau, alpha_0), projection=False)
    found = figures([(variant(input=path, reference=delta_2.COMMAND), controller)], 10.0, delta_2.STEP)
    # RK4's step is half of the realisation's time constant, whose mode is damped; four digits are enough for an exponent
    np.testing.assert_allclose(found.max_abs_e[0], np.abs(e).max(axis=0), rtol=1e-3)


def test_the_norm_of_delta():
    """||s W_m||_1 = 1 + integral of |c_0'A_m e^(A_m t) b| with c_0'b = 1, by trapezoids."""
    h, state, values = 1e-3, by_hand.B, []
    step = expm(by_hand.A_M * h)
    for _ in range(60_000):
        values.append(by_hand.C_0 @ by_hand.A_M @ state)
        state = step @ state
    assert delta_2.norm_per_size() == pytest.approx(1 + np.trapezoid(np.abs(values), dx=h), rel=1e-4)


def errors(power: float, of_tau: float) -> delta_2.Errors:
    """Errors whose tail is proportional to mu^power and whose peak is proportional to tau^of_tau."""
    taus, shape = delta_2.TAUS, (len(delta_2.TAUS), len(delta_2.SIZES))
    peak = taus**of_tau
    return delta_2.Errors(
        peak=np.broadcast_to(peak[:, None], shape).copy(),
        tail=np.broadcast_to(delta_2.SIZES**power, shape).copy(),
        peak_without=peak,
        tail_without=np.zeros(len(taus)),
    )


def test_other_errors_are_told_apart():
    np.testing.assert_allclose(errors(1.5, 1.0).exponents, 1.5)
    assert delta_2._proportional({"": errors(1.0, 1.0)}).holds
    assert not delta_2._proportional({"": errors(1.5, 1.0)}).holds
    proportional, root = (delta_2.constants(errors(1.0, of_tau))[None] for of_tau in (1.0, 0.5))
    assert delta_2._one_constant(proportional).holds
    assert not delta_2._one_constant(root).holds  # sqrt(tau)/tau grows
    np.testing.assert_allclose(proportional, 1.0)
