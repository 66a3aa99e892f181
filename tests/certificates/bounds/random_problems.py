"""Random problems for Theorem 1, and the ratios of their simulated errors to its bounds.

Run as a script it prints the first table of docs/laboratory/bounds.md: the problems are the ones of the tests.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from barbalat import (
    L1Adaptive,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    TransferFunction,
    simulate_ensemble,
)
from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.bounds.model import model_bounds
from barbalat.signals import Sine, Sines, Square, Steps

SIMULATION = Simulation(t_end=10, dt=1e-3)
COMMANDS = (
    Sine(amplitude=1.3, frequency=1.1),
    Square(amplitude=1.3, frequency=np.pi / 1.5),  # its jumps are on the grid
    Sines(amplitudes=(0.7, 0.4, 0.3), frequencies=(0.6, 2.3, 7.1), phases=(0.0, 1.0, 2.0)),
    Steps(times=(0.5, 2.0, 4.5, 7.0), values=(1.0, -1.3, 0.4, 1.2)),
)
MEMBERS = 40
"""Members of each random system (A_m, b, k_0, x0, C). Each has its own theta, known set, initial estimate and gain."""
SYSTEMS_9 = (13, 12, 13, 12)
"""Systems for each command, so there are 2000 problems for each n."""
SYSTEMS_10 = {1: (7, 6, 6, 6), 2: (3, 3, 3, 4), 3: (3, 3, 3, 3)}
"""Random systems for each order of C(s). Half of the problems have the first-order filter."""
FEW_9, FEW_10 = (1, 1, 1, 1), {1: (1, 1, 1, 1), 2: (1, 0, 0, 0), 3: (0, 1, 0, 0)}
"""Systems in the short tests, which contain every command and every order of C(s)."""
FASTEST_POLE = 250.0
"""Fastest pole of C(s) [rad/s], by a quarter of a step. A faster one would test the step instead of the theorem."""


@dataclass(frozen=True)
class Used:
    """The ratio of max |e| to the bound for each problem; for first-order filters, also its ratio to kappa nu_1 +
    nu_2/sqrt(Gamma)."""

    ratio: np.ndarray
    constants: np.ndarray
    oscillating: np.ndarray  # whether A_m has complex poles


def random_known(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """A Hurwitz A_m with time constants of 0.2 to 2 s, real poles and up to n/2 complex pairs, and a b such that (A_m, b) is
    controllable."""
    A = np.diag(-rng.uniform(0.5, 5, n))
    for k in range(rng.integers(0, n // 2 + 1)):
        decay, frequency = rng.uniform(0.5, 3), rng.uniform(0.5, 6)
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[-decay, frequency], [-frequency, -decay]]
    T = np.linalg.qr(rng.normal(size=(n, n)))[0] + 0.3 * rng.normal(size=(n, n))
    return T @ A @ np.linalg.inv(T), rng.normal(size=n)


def random_filter(rng: np.random.Generator, order: int, T: float) -> TransferFunction:
    """A filter C(s) with C(0) = 1 and time constants around T. It is of first order, or of second order with damping 0.4 to 1.2,
    with or without a zero, and with a further pole for the third order."""
    if order == 1:
        return TransferFunction([1.0], [T, 1.0])
    zero = rng.uniform(0.3, 1.5) * T * rng.integers(0, 2)
    num, den = np.array([zero, 1.0]), np.array([T**2, 2 * rng.uniform(0.4, 1.2) * T, 1.0])
    return TransferFunction(num, np.polymul(den, [rng.uniform(0.3, 2) * T, 1.0]) if order == 3 else den)


def system(rng: np.random.Generator, n: int, command: object) -> list[Problem]:
    """MEMBERS problems that share A_m, b, k_0, x0 (zero for half of the systems) and the command."""
    A_m, b = random_known(rng, n)
    model, x0 = ReferenceModel(k_0=rng.uniform(0.5, 2)), rng.uniform(-1, 1, n) * rng.integers(0, 2)
    result = []
    for _ in range(MEMBERS):
        half = rng.uniform(0.1, 1.0, n)
        plant = Plant(A_m=A_m, b=b, theta=rng.uniform(-half, half), x0=x0)
        box = ParameterBox(lower=-half, upper=half)
        result.append(Problem(plant=plant, reference_model=model, reference=command, uncertainty=box))
    return result


def start_of(rng: np.random.Generator, problem: Problem) -> np.ndarray:
    """A random initial estimate in the known set."""
    return rng.uniform(problem.uncertainty.lower, problem.uncertainty.upper)


def used_of_9(n: int, systems: Sequence[int] = SYSTEMS_9) -> Used:
    rng = np.random.default_rng(n)
    found = []
    for command, count in zip(COMMANDS, systems, strict=True):
        members, bounds = [], []
        for _ in range(count):
            for problem in system(rng, n, command):
                gamma, start = 10 ** rng.uniform(-1, 2), start_of(rng, problem)
                members.append((problem, Mrac(gamma=gamma, theta_hat0=start)))
                nu = theorem_1.nu_0(theorem_1.initial_parameter_error(start, problem.plant.theta), problem.known)
                bounds.append(theorem_1.mrac_bound(nu, gamma))
        found.append(_used(members, bounds, [np.nan] * len(bounds)))
    return _together(found)


def used_of_10(n: int, systems: Mapping[int, Sequence[int]] = SYSTEMS_10) -> Used:
    rng = np.random.default_rng(100 + n)
    found = []
    for order, counts in systems.items():
        for command, count in zip(COMMANDS, counts, strict=True):
            members, bounds, constants = [], [], []
            while len(members) < count * MEMBERS:
                group = system(rng, n, command)
                C = admissible_filter(rng, group, order)
                if C is None:
                    continue
                for member, bound, constant in bounded(rng, group, C):
                    members.append(member)
                    bounds.append(bound)
                    constants.append(constant)
            if members:
                found.append(_used(members, bounds, constants))
    return _together(found)


def admissible_filter(rng: np.random.Generator, group: list[Problem], order: int) -> TransferFunction | None:
    """A filter C(s) for which the condition of (10) certainly holds for the largest set of the group. None if it would be too
    fast."""
    known, largest = group[0].known, max(problem.uncertainty.theta_max for problem in group)
    T = rng.uniform(0.05, 0.9) * theorem_1.kappa_max(theorem_1.derivative_norm(known), largest)
    while True:
        C = random_filter(rng, order, T)
        if np.abs(C.poles).max() > FASTEST_POLE:
            return None
        if theorem_1.filter_condition(known, C.realise(), largest).holds:
            return C
        T /= 1.5


def bounded(rng: np.random.Generator, group: list[Problem], C: TransferFunction) -> list[tuple]:
    """For each member of the group: problem and controller, the bound (10) by ||W_b (1 - C)||_1, and the bound by nu_1 and nu_2
    or NaN."""
    known, model = group[0].known, model_bounds(group[0])
    norm, slope = theorem_1.filter_condition(known, C.realise(), 1.0).norm, theorem_1.derivative_norm(known)
    kappa = theorem_1.time_constant(C)
    result = []
    for problem in group:
        gamma, theta_max, start = 10 ** rng.uniform(-1, 3), problem.uncertainty.theta_max, start_of(rng, problem)
        nu = theorem_1.nu_0(theorem_1.initial_parameter_error(start, problem.plant.theta), known)
        bound = theorem_1.l1_bound(nu, gamma, theorem_1.small_gain(norm, theta_max), theta_max, known.k_0, model)
        constant = np.nan
        if kappa is not None:
            nu_1, nu_2 = theorem_1.first_order_constants(nu, kappa, slope, theta_max, known.k_0, model)
            constant = kappa * nu_1 + nu_2 / np.sqrt(gamma)
        result.append(((problem, L1Adaptive(gamma=gamma, filter=C, theta_hat0=start)), bound, constant))
    return result


def _used(members: list, bounds: list[float], constants: list[float]) -> Used:
    peaks = simulate_ensemble(members, SIMULATION).metrics.max_abs_e.max(axis=1)
    oscillating = np.array([np.linalg.eigvals(problem.plant.A_m).imag.any() for problem, _ in members])
    return Used(peaks / np.array(bounds), peaks / np.array(constants), oscillating)


def _together(found: list[Used]) -> Used:
    return Used(*(np.concatenate(parts) for parts in zip(*((u.ratio, u.constants, u.oscillating) for u in found), strict=True)))


def main() -> None:
    sys.stdout.write(
        "n | (9): largest, median | (10): largest, median | kappa nu_1 + nu_2/sqrt(Gamma): largest, median | problems\n"
    )
    for n in range(1, 6):
        nine, ten = used_of_9(n), used_of_10(n)
        columns = (nine.ratio, ten.ratio, ten.constants[np.isfinite(ten.constants)])
        shown = " | ".join(f"{100 * c.max():.1f} %, {100 * np.median(c):.1f} %" for c in columns)
        sys.stdout.write(f"{n} | {shown} | {len(nine.ratio)} + {len(ten.ratio)}\n")


if __name__ == "__main__":
    main()
