"""The simulations of Section V: every run that Figures 2-5 show or mention, and the quantities that are needed to judge them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from barbalat.adaptation.laws import LeastSquares
from barbalat.budget import Progress, part_of
from barbalat.cases.load import load_case
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.controllers import L1Adaptive, Mrac, NormalizedMrac, RobustMrac
from barbalat.controllers.parametric_model import State
from barbalat.controllers.robust_mrac import Equations
from barbalat.linear.margins import margins
from barbalat.linear.systems import TransferFunction, input_filter, two_slopes
from barbalat.papers.claim import Listing, table
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import Known, Problem
from barbalat.protocols import Controller, Signal, Value
from barbalat.run.engine.check_numerics import check_numerics
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.metrics import Metrics
from barbalat.run.results.result import Result
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

T_END = 60.0
COARSE_STEP, FINE_STEP = 1e-4, 1e-5
FIGURE_4_GAIN = 1e4
KAPPA = 0.02
TAU = 0.5
COVARIANCE0 = 500.0
C_0 = (1.0, 1.0)
"""The printed settings: the horizon, both steps, kappa and tau, all in seconds, L1-AC's gain, and P(0) and c_0 of the robust
MRAC."""
SEARCHED_KAPPAS = (1e-3, 0.5)
"""Time constants [s] between which the delay margin with a filter of two slopes rises above that with (6)."""
ERRATUM_TAUS = (0.1, 0.05)
"""Two values of tau below the loop's time constants, for which the error is proportional to tau."""
MODERATE_GAIN = 10.0
"""Gain of the standard MRAC in the comparison. At the coarse step, h times its adaptation frequency is about 0.2."""


@dataclass(frozen=True, eq=False)
class Runs:
    """Results by name at the two steps of the paper."""

    coarse: dict[str, Result]
    fine: dict[str, Result]


def robust_mrac(name: str, tau: float = TAU, *, projection: bool = True) -> RobustMrac:
    """Return the robust MRAC of Figure 2."""
    law = LeastSquares(covariance0=COVARIANCE0)
    return RobustMrac(c_0=C_0, tau=tau, law=law, projection=projection, name=name)


def l1(name: str, gamma: float, kappa: float = KAPPA, *, projection: bool = True) -> L1Adaptive:
    """Return the L1 controller of Figures 3-5."""
    return L1Adaptive(gamma=gamma, filter=input_filter(kappa), projection=projection, name=name)


def limit_delay_margin(C: TransferFunction) -> float:
    """Return the exact delay margin [s] of the limit of fast adaptation at Section V's theta."""
    return margins(fast_adaptation(problem().plant, C.realise())).delay


@cache
def two_slopes_kappa() -> float:
    """Return the kappa [s] with which the filter of two slopes has the same delay margin in the limit of fast adaptation as (6)
    with Section V's kappa."""
    from scipy.optimize import brentq

    margin = limit_delay_margin(input_filter(KAPPA))
    return float(brentq(lambda value: limit_delay_margin(two_slopes(value)) - margin, *SEARCHED_KAPPAS))


@cache
def problem() -> Problem:
    """Return the problem of Section V: plant, model, command and known set."""
    given = load_case("paper").problem
    assert isinstance(given, Problem)
    return given


def coarse_controllers() -> list[Controller]:
    """Return the controllers that run with the coarse step."""
    return [
        robust_mrac("Robust MRAC"),
        robust_mrac("Robust MRAC, no projection", projection=False),
        NormalizedMrac(c_0=C_0, law=LeastSquares(covariance0=COVARIANCE0), name="Robust MRAC, no auxiliary input"),
        *(robust_mrac(f"tau {tau}", tau) for tau in ERRATUM_TAUS),
        *(PrintedSign(controller=robust_mrac(f"tau {tau}, printed sign", tau)) for tau in (TAU, *ERRATUM_TAUS)),
        l1("L1", 1e4),
        l1("L1, no projection", 1e4, projection=False),
        l1("L1, kappa/2", 1e4, KAPPA / 2),
        Mrac(gamma=MODERATE_GAIN, name="MRAC"),
    ]


def fine_controllers() -> list[Controller]:
    """Return the controllers that run with the fine step."""
    return [
        l1("L1, gamma 1e4", 1e4),
        l1("L1, gamma 1e4, no projection", 1e4, projection=False),
        l1("L1, gamma 1e6", 1e6),
        l1("L1, gamma 1e6, no projection", 1e6, projection=False),
    ]


def run(progress: Progress | None = None) -> Runs:
    """Simulate all runs. Runs labelled numerically unstable are checked with a finer step."""
    given, coarse, fine = problem(), coarse_controllers(), fine_controllers()
    runs = Runs(
        coarse=simulate(given, coarse, Simulation(t_end=T_END, dt=COARSE_STEP), progress=part_of(progress, 0.0, 0.1)),
        fine=simulate(given, fine, Simulation(t_end=T_END, dt=FINE_STEP), progress=part_of(progress, 0.1, 0.3)),
    )
    return Runs(
        coarse=check_numerics(runs.coarse, progress=part_of(progress, 0.4, 0.2)),
        fine=check_numerics(runs.fine, progress=part_of(progress, 0.6, 0.4)),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class AsPrinted(Equations):
    """The equations with the paper's printed sign of W_c0."""

    def auxiliary_input_argument(self, state: State, x: Value) -> Value:
        estimation = self.estimation(state, x)
        return estimation.epsilon * estimation.m_s_squared - self.c_0 @ state.swapping


@dataclass(frozen=True, eq=False, kw_only=True)
class PrintedSign:
    """A robust MRAC with the printed sign."""

    controller: RobustMrac

    @property
    def name(self) -> str:
        return self.controller.name

    def bind(self, known: Known) -> AsPrinted:
        return AsPrinted(**vars(self.controller.bind(known)))


def variant(
    *,
    theta: Any = None,
    reference: Signal | None = None,
    k_0: float | None = None,
    box: ParameterBox | None = None,
    input: PlantInput | None = None,
) -> Problem:
    """Return the problem of Section V. Arguments replace the paper's values."""
    given = problem()
    plant = given.plant
    return Problem(
        plant=Plant(A_m=plant.A_m, b=plant.b, theta=plant.theta if theta is None else theta, x0=plant.x0, input=input),
        reference_model=given.reference_model if k_0 is None else ReferenceModel(k_0=k_0),
        reference=given.reference if reference is None else reference,
        uncertainty=given.uncertainty if box is None else box,
    )


def figures(members: Sequence[tuple[Problem, Controller]], t_end: float, dt: float) -> Metrics:
    """Return the metrics of an ensemble over [0, t_end] with RK4."""
    return simulate_ensemble(members, Simulation(t_end=t_end, dt=dt)).metrics


def at_instants(t: Array, instants: Sequence[float]) -> Array:
    """Return the indices of recorded instants, (k,) of (K,). Raises ValueError for an instant that was not recorded."""
    at = np.array([np.abs(t - instant).argmin() for instant in instants])
    if not np.allclose(t[at], instants, rtol=1e-9, atol=1e-9):  # rounding errors of the instants
        raise ValueError(f"the instants {instants} were not all recorded; the nearest recorded ones are {t[at]}")
    return at


def by_component(caption: str, runs: Mapping[str, Metrics]) -> Listing:
    """Return for each scheme the error in the tail and the variation of the estimates by component. Section V has two
    components of each."""
    errors = {f"|e_{i + 1}|, tail": [run.tail_max_abs_e[0, i] for run in runs.values()] for i in range(2)}
    rates = {f"theta_hat_{i + 1} moves [1/s]": [run.theta_hat_variation_rate[0, i] for run in runs.values()] for i in range(2)}
    return table(caption, {"scheme": list(runs), **errors, **rates})


def local_exponents(values: Array, settings: Array) -> Array:
    """Return the local exponent from each setting to the next, (k - 1,) for (k,)."""
    return np.asarray(np.diff(np.log(values)) / np.diff(np.log(settings)))
