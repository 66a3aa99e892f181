"""The robust MRAC against L1-AC in every respect that the paper names, each a number of its own, whichever side it helps.

Where the paper names them: transient performance and robustness (abstract, II.B, VI), the tracking error (III.B, Figures 2 and 3),
learning (Figures 2 and 3), numerical problems (abstract, VI), unmodelled dynamics (III.B). Beside them bounded disturbances, which
Section IV names for its extension without comparing, and what the filter's proponents ask for: the control's size, measurement
noise in it, and equal time constants tau = kappa.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from barbalat.papers.claim import Claim, Listing, Measurement, Reading, of_readings, verdict
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics.onset import SWEEP_RATE
from barbalat.papers.jafari_2013.section_v import figures
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.metrics import Metrics
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import delay_margins_ensemble
from barbalat.validate import Array

GAMMA, MODERATE_GAMMA = 1e4, 100.0
"""Of L1-AC: Figure 3's and 4's; and one that h = 2e-4 s resolves, which tracks equally, for what takes many runs."""
EQUAL_TAU = section_v.KAPPA
"""[s]: tau set to the filter's time constant."""
BETWEEN_TAU = 0.07
"""[s]: between the two, found by trial: from 0.08 s on the peak beside d = 20 is larger than L1-AC's, below 0.06 s the delay borne is shorter."""
STEPS = np.array([section_v.T_END / round(section_v.T_END / h) for h in np.geomspace(1e-5, 0.2, 14)])
"""[s], of the search for the largest that RK4 bears; each divides the run."""
DISTURBANCES: dict[str, Signal] = {"d = 20": Constant(20.0), "d = 20 sin 2t": Sine(20.0, 2.0)}
"""About a hundredth of the largest control."""
NOISE = Noise(std=0.1, sample_time=1e-3)
"""On both states: about a thousandth of the largest |x|."""


@dataclass(frozen=True)
class Respect:
    """One thing to be compared, less being better unless said: robust MRAC of Figure 2, L1-AC, robust MRAC with tau = kappa and with a tau between."""

    name: str
    unit: str
    values: tuple[float, ...]
    named: bool = True
    more_is_better: bool = False

    def beats_l1(self, value: float) -> bool:
        """Whether a robust MRAC with this value does better."""
        return value > self.values[1] if self.more_is_better else value < self.values[1]

    @property
    def holds(self) -> bool:
        """Whether that of Figure 2 does."""
        return self.beats_l1(self.values[0])

    @property
    def shown(self) -> tuple[str, ...]:
        """The values with their unit."""
        return tuple(f"{value:.3g}{self.unit}" for value in self.values)

    @property
    def reading(self) -> Reading:
        """Return the reading as the ledger states it."""
        which = "named by the paper" if self.named else "not named by the paper"
        of_figure_2, of_l1, equal, between = self.shown
        measured = f"robust MRAC {of_figure_2}, L1-AC {of_l1}; the robust MRAC with tau = kappa {equal}, with tau = {BETWEEN_TAU:g} s {between}"
        return Reading(f"{self.name} ({which})", verdict(holds=self.holds), measured)


def robust(tau: float = section_v.TAU) -> Controller:
    """The robust MRAC of Figure 2, with the filter time tau in s."""
    return section_v.robust_mrac("robust", tau)


def contestants(gamma: float) -> tuple[Controller, Controller, Controller, Controller]:
    """The robust MRAC of Figure 2, L1-AC, the robust MRAC with the filter's time constant, and with one between."""
    return robust(), section_v.l1("L1", gamma), robust(EQUAL_TAU), robust(BETWEEN_TAU)


TAUS = {0: section_v.TAU, 2: EQUAL_TAU, 3: BETWEEN_TAU}
"""The tau [s] of the robust MRACs, by their place among the contestants."""


def claim(*, full: bool = False) -> Claim:
    """The row on all respects in which one scheme may do better than another."""
    respects = [*_on_the_nominal_plant(), *_numerics(), *_robustness(60.0 if full else 30.0), *_disturbed(), *_in_the_control()]
    named = [respect for respect in respects if respect.named]
    lost = {tau: [r for r in respects if not r.beats_l1(r.values[which])] for which, tau in TAUS.items()}
    readings = (*(respect.reading for respect in respects), _at_one_tau(lost, len(respects)))
    better = {tau: len(named) - sum(r.named for r in respects) for tau, respects in lost.items()}
    unbeaten = ", ".join(f"{tau:g} s" for tau, found in lost.items() if not found) or "none"
    told = "; ".join(f"with tau = {tau:g} s {_named(found)}" for tau, found in lost.items())
    return Claim(
        "robust-mrac-better", "Abstract; Sections III.B, VI", "The robust MRAC does better than L1-AC in every respect",
        of_readings(readings),
        f"against Figure 3's settings the robust MRAC is worse: {told}. Of the {len(named)} respects that the paper names it is better in "
        + ", ".join(f"{count} with tau = {tau:g} s" for tau, count in better.items()),
        f"Section V, RK4, 60 s; L1-AC with Gamma = {GAMMA:g} at h = 1e-5 s (nominal plant), {MODERATE_GAMMA:g} at h = 2e-4 s and below for the rest, at which it tracks equally",
        listings=(_listing(respects),),
        number=f"lost of {len(respects)} respects: {len(lost[section_v.TAU])} at tau {section_v.TAU:g} s, {len(lost[BETWEEN_TAU])} at {BETWEEN_TAU:g} s",
        readings=readings,
        condition=f"tau is chosen so; of those tried {unbeaten} loses nothing to L1-AC. Lost: {told}. Peaks beside a disturbance are the large initial "
        "covariance's, which takes d for the plant's",
        would_change="confirmed: no respect lost at Figure 2's tau, nor at tau = kappa; not confirmed: no tau tried that wins all respects, and one of them lost by each",
        sharpened="delays searched over 60 s",
    )  # fmt: skip


def _named(respects: Sequence[Respect]) -> str:
    """Their names."""
    return "; ".join(respect.name for respect in respects) or "none"


def _at_one_tau(lost: Mapping[float, Sequence[Respect]], count: int) -> Reading:
    """Return the reading that one setting wins everything: what each setting that was tried loses."""
    return Reading(
        "in every respect, named or not, with one tau for all of them",
        verdict(holds=not all(lost.values())),
        f"of {count} respects "
        + "; ".join(f"tau = {tau:g} s loses {len(found)}: {_named(found)}" for tau, found in lost.items()),
    )


def _in_order(ours: Array, of_l1: Array) -> tuple[float, ...]:
    """From the robust MRACs, in the order of TAUS, and L1-AC: in that of the contestants."""
    first, *others = ours.tolist()
    return first, float(of_l1[0]), *others


def _runs(given: Problem, gamma: float, h: float) -> tuple[Metrics, Metrics]:
    """The robust MRACs at Figure 2's step, and L1-AC at the step h."""
    of_l1 = figures([(given, section_v.l1("L1", gamma))], section_v.T_END, h)
    return figures([(given, robust(tau)) for tau in TAUS.values()], section_v.T_END, section_v.COARSE_STEP), of_l1


def _on_the_nominal_plant() -> list[Respect]:
    """Transient, tracking, learning, control."""
    given = section_v.problem()
    found = _runs(given, GAMMA, section_v.FINE_STEP)

    def respect(name: str, of: Callable[[Metrics], Array], *, named: bool = True) -> Respect:
        return Respect(name, "", _in_order(*(of(metrics) for metrics in found)), named=named)

    return [
        respect("transient: the largest |e| from e(0) = 0", lambda m: m.max_abs_e.max(axis=1)),
        respect("tracking: the largest |e| in the tail", lambda m: m.tail_max_abs_e.max(axis=1)),
        respect(
            "learning: |theta_hat - theta*| at the end", lambda m: np.linalg.norm(m.theta_hat_final - given.plant.theta, axis=1)
        ),
        respect("effort: the largest |u|", lambda m: m.max_abs_u.reshape(len(m.max_abs_e), -1).max(axis=1), named=False),
    ]


def _numerics() -> list[Respect]:
    ours = _largest_steps([robust(tau) for tau in TAUS.values()])
    of_l1, moderate = _largest_steps([section_v.l1("L1", gamma) for gamma in (GAMMA, MODERATE_GAMMA)])
    of_rk4, at = "the largest step that RK4 bears", f"numerics, L1-AC with Gamma = {MODERATE_GAMMA:g}"
    return [
        Respect(f"numerics: {of_rk4}", " s", _in_order(ours, np.array([of_l1])), more_is_better=True),
        Respect(f"{at}: {of_rk4}", " s", _in_order(ours, np.array([moderate])), named=False, more_is_better=True),
    ]


def _largest_steps(controllers: Sequence[Controller]) -> Array:
    """For each the first of STEPS, from above, at which the run neither diverges nor its estimates sweep their known set; 0 if none."""
    given, borne = section_v.problem(), np.zeros(len(controllers))
    for h in STEPS[::-1]:
        rates = figures([(given, c) for c in controllers], section_v.T_END, float(h)).theta_hat_variation_rate.max(axis=1)
        borne[(borne == 0) & (rates < SWEEP_RATE)] = h
        if (borne > 0).all():
            break
    return borne


def _robustness(t_end: float) -> list[Respect]:
    """Measure robustness by simulation: the delay at which the loop oscillates, and at which the motion is lost."""
    given = section_v.problem()
    ours = delay_margins_ensemble(
        [(given, robust(tau)) for tau in TAUS.values()], Simulation(t_end=t_end, dt=1e-3), resolution=0.05
    )
    other = delay_margins_ensemble(
        [(given, section_v.l1("L1", MODERATE_GAMMA))], Simulation(t_end=t_end, dt=2e-4), resolution=0.05
    )

    return [
        Respect("unmodelled dynamics: the delay before it oscillates", " s", _in_order(ours.onset.bears, other.onset.bears), more_is_better=True),
        Respect("unmodelled dynamics: the delay before it is lost", " s", _in_order(ours.loss.bears, other.loss.bears), more_is_better=True),
    ]  # fmt: skip


def disturbed(signal: Signal) -> Problem:
    """Section V with a matched disturbance."""
    return replace(section_v.problem(), disturbance=signal)


def _disturbed() -> list[Respect]:
    respects = []
    for name, signal in DISTURBANCES.items():
        found = _runs(disturbed(signal), MODERATE_GAMMA, section_v.COARSE_STEP)
        for part, errors in (("peak", [m.max_abs_e for m in found]), ("tail", [m.tail_max_abs_e for m in found])):
            values = _in_order(*(error.max(axis=1) for error in errors))
            respects.append(Respect(f"{part} error beside a disturbance {name}", "", values, named=False))
    return respects


def _in_the_control() -> list[Respect]:
    """What noise does to u: the RMS difference to the run without, in the second half."""
    given, simulation = section_v.problem(), Simulation(t_end=10.0, dt=section_v.COARSE_STEP, record_points=5000)
    noisy = replace(given, sensor=Sensor(noise=NOISE))
    values = tuple(_difference(noisy, given, c, simulation) for c in contestants(MODERATE_GAMMA))
    return [Respect("measurement noise that reaches u, RMS", "", values, named=False)]


def _difference(noisy: Problem, given: Problem, controller: Controller, simulation: Simulation) -> float:
    one, other = (simulate(problem, [controller], simulation)[controller.name] for problem in (noisy, given))
    return float(np.sqrt(np.mean((one.u - other.u)[len(one.t) // 2 :] ** 2)))


def _listing(respects: Sequence[Respect]) -> Listing:
    return Listing(
        f"Robust MRAC (tau = {section_v.TAU:g} s), L1-AC (kappa = {section_v.KAPPA:g} s), and the robust MRAC with other tau",
        (
            "respect",
            "named",
            "robust MRAC",
            "L1-AC",
            f"robust, τ = κ = {EQUAL_TAU:g} s",
            f"robust, τ = {BETWEEN_TAU:g} s",
            "better",
        ),
        tuple((r.name, "yes" if r.named else "no", *r.shown, "robust MRAC" if r.holds else "L1-AC") for r in respects),
    )


ROWS = (
    Measurement(
        claim,
        6.5,
        {"robust-mrac-better": "the robust MRAC against L1-AC in every respect"},
        place=330,
        sharper=partial(claim, full=True),
        sharper_seconds=7.0,
    ),
)
