"""The simulations of Section V: every run that Figures 2-5 show or speak of, and what is needed to judge them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from barbalat.adaptation.laws import LeastSquares
from barbalat.budget import Progress, part_of
from barbalat.cases.load import load_case
from barbalat.controllers import L1Adaptive, Mrac, NormalizedMrac, RobustMrac
from barbalat.linear.systems import input_filter
from barbalat.papers.jafari_2013.printed_sign import PrintedSign
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.run.engine.check_numerics import check_numerics
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.result import Result
from barbalat.solvers.simulation import Simulation

T_END = 60.0
COARSE_STEP, FINE_STEP = 1e-4, 1e-5
KAPPA = 0.02
TAU = 0.5
COVARIANCE0 = 500.0
C_0 = (1.0, 1.0)
"""As printed, in seconds: horizon, both steps, kappa and tau; P(0) and c_0 of the robust MRAC."""
ERRATUM_TAUS = (0.1, 0.05)
"""Two values below the loop's own time constants, where proportional to tau means what it says."""
MODERATE_GAIN = 10.0
"""Of the standard MRAC beside them: h times its adaptation frequency stays near 0.2 at the coarse step."""


@dataclass(frozen=True, eq=False)
class Runs:
    """Results by name, at the two steps of the paper."""

    coarse: dict[str, Result]
    fine: dict[str, Result]


def robust_mrac(name: str, tau: float = TAU, *, projection: bool = True) -> RobustMrac:
    """The robust MRAC as in Figure 2."""
    law = LeastSquares(covariance0=COVARIANCE0)
    return RobustMrac(c_0=C_0, tau=tau, law=law, projection=projection, name=name)


def l1(name: str, gamma: float, kappa: float = KAPPA, *, projection: bool = True) -> L1Adaptive:
    """The L1 controller as in Figures 3-5."""
    return L1Adaptive(gamma=gamma, filter=input_filter(kappa), projection=projection, name=name)


@cache
def problem() -> Problem:
    """Plant, model, command and known set of Section V."""
    given = load_case("paper").problem
    assert isinstance(given, Problem)
    return given


def coarse_controllers() -> list[Controller]:
    """What runs at the coarse step."""
    return [
        robust_mrac("Robust MRAC"),
        robust_mrac("Robust MRAC, no projection", projection=False),
        NormalizedMrac(c_0=C_0, law=LeastSquares(covariance0=COVARIANCE0), name="Robust MRAC, no auxiliary input"),
        *(robust_mrac(f"tau {tau}", tau) for tau in ERRATUM_TAUS),
        *(PrintedSign(controller=robust_mrac(f"tau {tau}, printed sign", tau)) for tau in ERRATUM_TAUS),
        l1("L1", 1e4),
        l1("L1, no projection", 1e4, projection=False),
        l1("L1, kappa/2", 1e4, KAPPA / 2),
        Mrac(gamma=MODERATE_GAIN, name="MRAC"),
    ]


def fine_controllers() -> list[Controller]:
    """What runs at the fine step."""
    return [
        l1("L1, gamma 1e4", 1e4),
        l1("L1, gamma 1e4, no projection", 1e4, projection=False),
        l1("L1, gamma 1e6", 1e6),
        l1("L1, gamma 1e6, no projection", 1e6, projection=False),
    ]


def run(progress: Progress | None = None) -> Runs:
    """All runs, those that are labelled numerically unstable with their check at a finer step."""
    given, coarse, fine = problem(), coarse_controllers(), fine_controllers()
    runs = Runs(
        coarse=simulate(given, coarse, Simulation(t_end=T_END, dt=COARSE_STEP), progress=part_of(progress, 0.0, 0.1)),
        fine=simulate(given, fine, Simulation(t_end=T_END, dt=FINE_STEP), progress=part_of(progress, 0.1, 0.3)),
    )
    return Runs(
        coarse=check_numerics(runs.coarse, progress=part_of(progress, 0.4, 0.2)),
        fine=check_numerics(runs.fine, progress=part_of(progress, 0.6, 0.4)),
    )
