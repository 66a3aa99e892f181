"""The robust MRAC against L1-AC in every respect that the paper names, each a number of its own, whichever side it helps.

Where the paper names them: transient performance and robustness (abstract, II.B, VI), the tracking error (III.B, Figures 2 and 3),
learning (Figures 2 and 3), numerical problems (abstract, VI), unmodelled dynamics (III.B). Beside them bounded disturbances, which
Section IV names for its extension without comparing, and what the filter's proponents ask for: the control's size, measurement
noise in it, and equal time constants tau = kappa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.claims import section_v
from barbalat.claims.claim import Claim, Listing, Reading, of_readings, verdict
from barbalat.claims.onset import SWEEP_RATE
from barbalat.claims.variants import figures
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.run.simulate import simulate
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import delay_margins_ensemble
from barbalat.validate import Array

GAMMA, MODERATE_GAMMA = 1e4, 100.0
"""Of L1-AC: Figure 3's and 4's; and one that h = 2e-4 s resolves, which tracks equally, for what takes many runs."""
EQUAL_TAU = section_v.KAPPA
"""[s]: tau set to the filter's time constant."""
STEPS = np.array([section_v.T_END / round(section_v.T_END / h) for h in np.geomspace(1e-5, 0.2, 14)])
"""[s], of the search for the largest that RK4 bears; each divides the run."""
DISTURBANCES: dict[str, Signal] = {"d = 20": Constant(20.0), "d = 20 sin 2t": Sine(20.0, 2.0)}
"""About a hundredth of the largest control."""
NOISE = Noise(std=0.1, sample_time=1e-3)
"""On both states: about a thousandth of the largest |x|."""


@dataclass(frozen=True)
class Respect:
    """One thing to be compared, less being better unless said: robust MRAC of Figure 2, L1-AC, robust MRAC with tau = kappa."""

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
        """As the ledger has it."""
        which = "named by the paper" if self.named else "not named by the paper"
        of_figure_2, of_l1, equal = self.shown
        measured = f"robust MRAC {of_figure_2}, L1-AC {of_l1}; with tau = kappa the robust MRAC {equal}"
        return Reading(f"{self.name} ({which})", verdict(holds=self.holds), measured)


def robust(tau: float = section_v.TAU) -> Controller:
    """Figure 2's."""
    return section_v.robust_mrac("robust", tau)


def contestants(gamma: float) -> tuple[Controller, Controller, Controller]:
    """The robust MRAC of Figure 2, L1-AC, and the robust MRAC with the filter's time constant."""
    return robust(), section_v.l1("L1", gamma), robust(EQUAL_TAU)


def claim(*, full: bool = False) -> Claim:
    """All respects."""
    respects = [*_on_the_nominal_plant(), *_numerics(), *_robustness(60.0 if full else 30.0), *_disturbed(), *_in_the_control()]
    named = [respect for respect in respects if respect.named]
    worse = [respect.name for respect in respects if not respect.holds]
    readings = tuple(respect.reading for respect in respects)
    lost_when_equal = [r.name for r in respects if not r.beats_l1(r.values[2])]
    holds = sum(respect.holds for respect in named)
    return Claim(
        "robust-mrac-better", "Abstract; Sections III.B, VI", "The robust MRAC does better than L1-AC in every respect",
        of_readings(readings),
        f"Figure 2's settings against Figure 3's: better in {holds} of the {len(named)} respects that the paper names, and in {sum(r.holds for r in respects) - holds} of {len(respects) - len(named)} others; "
        f"worse: {'; '.join(worse) or 'none'}. With tau = kappa = {EQUAL_TAU:g} s worse: {'; '.join(lost_when_equal) or 'none'}",
        f"Section V, RK4, 60 s; L1-AC with Gamma = {GAMMA:g} at h = 1e-5 s (nominal plant), {MODERATE_GAMMA:g} at h = 2e-4 s and below for the rest, at which it tracks equally",
        listings=(_listing(respects),),
        number=f"in which the robust MRAC is better: {holds} of {len(named)} respects",
        readings=readings,
        condition="no disturbance acts while the robust MRAC learns, which its large initial covariance takes for the plant's",
        would_change="confirmed: settings with which the robust MRAC's peak beside a disturbance is the smaller too, and no respect is lost for it",
        sharpened="delays searched over 60 s",
    )  # fmt: skip


def _on_the_nominal_plant() -> list[Respect]:
    """Transient, tracking, learning, control."""
    given = section_v.problem()
    found = [
        figures([(given, c)], section_v.T_END, section_v.FINE if c.name == "L1" else section_v.COARSE) for c in contestants(GAMMA)
    ]
    away = tuple(float(np.linalg.norm(m.theta_hat_final[0] - given.plant.theta)) for m in found)
    return [
        Respect("transient: the largest |e| from e(0) = 0", "", tuple(float(m.max_abs_e.max()) for m in found)),
        Respect("tracking: the largest |e| in the tail", "", tuple(float(m.tail_max_abs_e.max()) for m in found)),
        Respect("learning: |theta_hat - theta*| at the end", "", away),
        Respect("effort: the largest |u|", "", tuple(float(np.max(m.max_abs_u)) for m in found), named=False),
    ]


def _numerics() -> list[Respect]:
    steps = tuple(_largest_step(c) for c in (*contestants(GAMMA), section_v.l1("L1", MODERATE_GAMMA)))
    of_rk4, moderate = "the largest step that RK4 bears", f"numerics, L1-AC with Gamma = {MODERATE_GAMMA:g}"
    return [
        Respect(f"numerics: {of_rk4}", " s", steps[:3], more_is_better=True),
        Respect(f"{moderate}: {of_rk4}", " s", (steps[0], steps[3], steps[2]), named=False, more_is_better=True),
    ]


def _largest_step(controller: Controller) -> float:
    """The first of STEPS, from above, at which the run neither diverges nor its estimates sweep their known set; 0 if none."""
    given = section_v.problem()
    for h in STEPS[::-1]:
        if figures([(given, controller)], section_v.T_END, float(h)).theta_hat_variation_rate.max() < SWEEP_RATE:
            return float(h)
    return 0.0


def _robustness(t_end: float) -> list[Respect]:
    """By simulation: the delay before the loop oscillates, and before the motion is lost."""
    given = section_v.problem()
    pair = delay_margins_ensemble(
        [(given, robust()), (given, robust(EQUAL_TAU))], Simulation(t_end=t_end, dt=1e-3), resolution=0.05
    )
    other = delay_margins_ensemble(
        [(given, section_v.l1("L1", MODERATE_GAMMA))], Simulation(t_end=t_end, dt=2e-4), resolution=0.05
    )

    def each(of_pair: Array, of_other: Array) -> tuple[float, float, float]:
        return float(of_pair[0]), float(of_other[0]), float(of_pair[1])

    return [
        Respect("unmodelled dynamics: the delay before it oscillates", " s", each(pair.onset.bears, other.onset.bears), more_is_better=True),
        Respect("unmodelled dynamics: the delay before it is lost", " s", each(pair.loss.bears, other.loss.bears), more_is_better=True),
    ]  # fmt: skip


def disturbed(signal: Signal) -> Problem:
    """Section V with a matched disturbance."""
    return replace(section_v.problem(), disturbance=signal)


def _disturbed() -> list[Respect]:
    respects = []
    for name, signal in DISTURBANCES.items():
        given = disturbed(signal)
        found = [figures([(given, c)], section_v.T_END, section_v.COARSE) for c in contestants(MODERATE_GAMMA)]
        for part, errors in (("peak", [m.max_abs_e for m in found]), ("tail", [m.tail_max_abs_e for m in found])):
            values = tuple(float(error.max()) for error in errors)
            respects.append(Respect(f"{part} error beside a disturbance {name}", "", values, named=False))
    return respects


def _in_the_control() -> list[Respect]:
    """What noise does to u: the RMS difference to the run without, in the second half."""
    given, simulation = section_v.problem(), Simulation(t_end=10.0, dt=section_v.COARSE, record_points=5000)
    noisy = replace(given, sensor=Sensor(noise=NOISE))
    values = tuple(_difference(noisy, given, c, simulation) for c in contestants(MODERATE_GAMMA))
    return [Respect("measurement noise that reaches u, RMS", "", values, named=False)]


def _difference(noisy: Problem, given: Problem, controller: Controller, simulation: Simulation) -> float:
    one, other = (simulate(problem, [controller], simulation)[controller.name] for problem in (noisy, given))
    return float(np.sqrt(np.mean((one.u - other.u)[len(one.t) // 2 :] ** 2)))


def _listing(respects: Sequence[Respect]) -> Listing:
    return Listing(
        f"Robust MRAC (tau = {section_v.TAU:g} s), L1-AC (kappa = {section_v.KAPPA:g} s), and the robust MRAC with tau = {EQUAL_TAU:g} s",
        ("respect", "named", "robust MRAC", "L1-AC", "robust, τ = κ", "better"),
        tuple((r.name, "yes" if r.named else "no", *r.shown, "robust MRAC" if r.holds else "L1-AC") for r in respects),
    )
