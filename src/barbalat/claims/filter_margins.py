"""The claim that the filter reduces the robust stability margins whatever the adaptive gain, in all its readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from barbalat.actuation import PlantInput
from barbalat.certify.loops import around_equilibrium, fast_adaptation, known_parameters
from barbalat.certify.margins import margins
from barbalat.claims import section_v
from barbalat.claims.claim import Claim, Listing, verdict
from barbalat.claims.variants import variant
from barbalat.closed_loop import ClosedLoop
from barbalat.controllers import Mrac
from barbalat.ensemble import simulate_ensemble
from barbalat.grid import Simulation
from barbalat.linear import TransferFunction, input_filter
from barbalat.protocols import Controller, Signal
from barbalat.signals import Constant, Sine
from barbalat.study.delay_margin import Lost, delay_margins
from barbalat.validate import Array

SIMULATION = Simulation(t_end=40.0, dt=2e-4)
COMMANDS: dict[str, Signal] = {"r = sin 0.5t": Sine(1.0, 0.5), "r = 50 sin 0.5t": Sine(50.0, 0.5), "r = 50": Constant(50.0)}
EQUAL_GAINS = (0.01, 1.0, 100.0)
OWN_GAINS = (10.0, 100.0)
"""What a user would choose at this step: MRAC's moderate one, and for L1-AC the largest decade that the step resolves at r = 50."""
SEARCHED = np.geomspace(1e-6, 10.0, 36)
BANDWIDTHS = np.geomspace(0.2, 2000.0, 54)
DAMPING = 0.7


def claim() -> Claim:
    """Exact margins of the linear loops, and simulated ones of the adapting loops in each reading."""
    given = section_v.problem()
    plant, C = given.plant, input_filter(section_v.KAPPA).realise()
    slow = [margins(loop).delay for loop in (known_parameters(plant, plant.theta), known_parameters(plant, plant.theta, C))]
    fast = margins(fast_adaptation(plant, C)).delay
    adapting = [adapting_delay_margin(c, 1.0) for c in (Mrac(gamma=100.0), section_v.l1("L1", 100.0))]
    rows = [(name, what, pair) for name, signal in COMMANDS.items() for what, pair in _simulated(signal)]
    down = [(name, what) for name, what, pair in rows if pair[1] < pair[0] * SAME[0]]
    up = [(name, what) for name, what, pair in rows if pair[1] > pair[0] * SAME[1]]
    always = len(down) == len(rows) and fast < adapting[0] and adapting[1] < adapting[0] and slow[1] < slow[0]
    return Claim(
        "filter-reduces-margins", "Section VI", "The filter reduces the robust stability margins no matter what size adaptive gains are used",
        verdict(holds=always),
        f"exact: the filter changes the delay margin from {_change(slow)} with the estimates at rest on theta, from {_change(adapting)} with "
        f"the law working at Gamma = 100 around r = 1; for Gamma to infinity it is {fast:.3g} s with the filter, while without it the margin "
        f"falls as 1/Gamma. Simulated, {len(rows)} readings: up in {len(up)}, within 2 % in {len(rows) - len(up) - len(down)}, down in "
        f"{len(down)} (" + "; ".join(f"{what}, {name}" for name, what in down) + ")",
        "kappa = 0.02 s. Exact margins of the linear loops. Section V, RK4, h = 2e-4 s, 40 s: the exact delay [s] that the loop bears, by scan "
        "and bisection, and the smallest natural frequency [rad/s] of a second-order actuator with damping 0.7, as its inverse [s]; lost: the "
        "error in the tail grew by the largest |x_m|, or diverged. At equal gain Gamma = 0.01, 1, 100; at own gain 10 and 100; at equal error "
        "the MRAC's Gamma gives the RMS error that L1-AC has at 100",
        listings=(_listing(rows),),
    )  # fmt: skip


SAME = 0.98, 1.02
"""Ratios between which two margins count as the same: the bisection's resolution."""


def _listing(rows: list[tuple[str, str, Array]]) -> Listing:
    return Listing(
        "What the loop bears without and with the filter: the largest delay [s], or the slowest actuator as the inverse of its natural "
        "frequency [s]",
        ("command", "reading", "without filter", "with filter", ""),
        tuple(
            (
                name,
                what,
                f"{pair[0]:.3g}",
                f"{pair[1]:.3g}",
                "up" if pair[1] > pair[0] * SAME[1] else "down" if pair[1] < pair[0] * SAME[0] else "",
            )
            for name, what, pair in rows
        ),
    )


def _change(pair: list[float]) -> str:
    without, with_filter = pair
    return f"{without:.3g} to {with_filter:.3g} s ({'up' if with_filter > without else 'down'})"


def adapting_delay_margin(controller: Controller, r: float) -> float:
    """Exact, of the loop linearised with its law at the constant command r [s]."""
    return margins(around_equilibrium(ClosedLoop.of(section_v.problem(), controller), r)).delay


def _simulated(signal: Signal) -> list[tuple[str, Array]]:
    """(reading, [without, with filter]) for delays and actuators under one command."""
    problem = variant(reference=signal)
    gains = [*EQUAL_GAINS, OWN_GAINS[0], _equal_error(signal)]
    filtered_gains = [*EQUAL_GAINS, OWN_GAINS[1], OWN_GAINS[1]]
    names = [*(f"Gamma {gain:g}" for gain in EQUAL_GAINS), "own gains", "equal error"]
    without, filtered = [Mrac(gamma=g) for g in gains], [section_v.l1("L1", g) for g in filtered_gains]
    delays = [delay_margins([(problem, c) for c in group], SIMULATION, resolution=0.05).bears for group in (without, filtered)]
    actuators = [_actuator_margins(signal, group) for group in (without, filtered)]
    found = [(f"delay, {name}", np.array(pair)) for name, pair in zip(names, zip(*delays, strict=True), strict=True)]
    return found + [(f"actuator, {name}", np.array(pair)) for name, pair in zip(names, zip(*actuators, strict=True), strict=True)]


def _equal_error(signal: Signal) -> float:
    """The MRAC's gain with the RMS error of L1-AC at its own gain, the nearest of a fine grid."""
    problem = variant(reference=signal)
    target = _rms([(problem, section_v.l1("L1", OWN_GAINS[1]))])[0]
    found = _rms([(problem, Mrac(gamma=float(g))) for g in SEARCHED])
    return float(SEARCHED[np.nanargmin(np.abs(np.log(found / target)))])


def _rms(members: list[tuple[object, Controller]]) -> Array:
    return np.asarray(np.linalg.norm(simulate_ensemble(members, SIMULATION).metrics.rms_e, axis=1))  # type: ignore[arg-type]


def _actuator_margins(signal: Signal, controllers: Sequence[Controller]) -> Array:
    """For each controller the inverse of the smallest natural frequency, above which no slower-than-that actuator is lost [s]."""
    ideal = simulate_ensemble([(variant(reference=signal), c) for c in controllers], SIMULATION).metrics.tail_max_abs_e.max(
        axis=1
    )
    make: Callable[[float], PlantInput] = lambda w: PlantInput(  # noqa: E731
        actuator=TransferFunction([w**2], [1.0, 2 * DAMPING * w, w**2])
    )
    members = [(variant(reference=signal, input=make(float(w))), c) for c in controllers for w in BANDWIDTHS]
    metrics = simulate_ensemble(members, SIMULATION).metrics
    size = 4 / 0.3 * signal.bound  # type: ignore[attr-defined]  # k_0 times the model's DC gain
    amplitude = np.full(len(members), size)
    lost = Lost().judge(metrics, np.repeat(ideal, len(BANDWIDTHS)), amplitude).reshape(len(controllers), -1)
    slowest = [np.flatnonzero(row)[-1] + 1 if row.any() else 0 for row in lost]
    return np.array([1 / BANDWIDTHS[i] if i < len(BANDWIDTHS) else 0.0 for i in slowest])
