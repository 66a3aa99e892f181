"""Measures how tight the guaranteed bounds on e are for Section V: the ratio of each bound to the worst run that a search finds.

Run as a script, it prints the second table of docs/laboratory/bounds.md. The bound for all commands is compared with the worst
run for any command of the case's size, and the bound for the case's command with the worst run under that command. Theta is
searched in both. The worst command is found by the signs of the loop's response, which is exact for linear loops, or by mutation.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from barbalat import (
    DirectMrac,
    L1Adaptive,
    Mrac,
    MracClosedLoop,
    Problem,
    Simulation,
    certify,
    input_filter,
    simulate,
    simulate_ensemble,
)
from barbalat.designs import pi_feedback
from barbalat.papers.jafari_2013 import section_v
from barbalat.protocols import Controller
from barbalat.signals import Step, Steps

KEYS = ("error_bound", "error_bound_worst", "error_bound_command")
MUTANTS, ROUNDS, SWITCHES = 48, 12, 10
GAMMA = 1e4
"""Gain of L1-AC, as in the case."""


def at(problem: Problem, theta: np.ndarray, reference: object = None) -> Problem:
    return replace(problem, plant=replace(problem.plant, theta=theta), reference=reference or problem.reference)


def over_theta(problem: Problem, controller: Controller, simulation: Simulation, rng: np.random.Generator) -> tuple:
    """The worst theta and its largest |e_i| under the problem's command, from the box's corners, random points and a local
    search."""
    box = problem.uncertainty
    thetas = np.vstack([box.extreme_points(rng, 4), box.drawn(rng, 12)])
    worst, width = (0.0, thetas[0]), 0.2
    for _ in range(5):
        members = [(at(problem, theta), controller) for theta in thetas]
        peaks = simulate_ensemble(members, simulation).metrics.max_abs_e.max(axis=1)
        k = int(np.argmax(peaks))
        worst = max(worst, (float(peaks[k]), thetas[k]), key=lambda one: one[0])
        thetas = box.brought_in(worst[1] + width * (box.upper - box.lower) * rng.normal(size=(16, box.size)))
        width /= 2
    return worst


def of_a_linear_loop(problem: Problem, controller: Controller, simulation: Simulation, theta: np.ndarray) -> float:
    """The largest |e_i| of each component under the command that takes its signs from the impulse response reversed in time."""
    size, at_rest = problem.reference.bound, replace(problem, plant=replace(problem.plant, x0=np.zeros(2)))
    (run,) = simulate(at(at_rest, theta, Step(amplitude=size)), [controller], simulation).values()
    largest = 0.0
    for i in range(2):
        turns = run.t[1:][np.diff(np.sign(np.diff(run.e[:, i])), prepend=0.0) != 0]
        times = np.unique(simulation.t_end - turns)
        times = times[times > 0]
        for sign in (-1.0, 1.0):
            values = sign * size * (-1.0) ** np.arange(len(times))
            command = Steps(times=tuple(times), values=tuple(values), initial=-sign * size)
            (found,) = simulate(at(problem, theta, command), [controller], simulation).values()
            largest = max(largest, *found.figures["max_abs_e"])
    return largest


def by_mutation(problem: Problem, L: np.ndarray, gamma_r: float, rng: np.random.Generator) -> float:
    """The largest error of MRACs with Gamma = 1, by mutation of theta and of the instants of a command that jumps between its
    ends. It uses plain NumPy and RK4.

    L is the gain of the closed-loop model, and gamma_r is the gain of k_r in a direct MRAC. Both are zero for other schemes.
    """
    box, size, known, h, T = problem.uncertainty, problem.reference.bound, problem.known, 1e-3, 4.0
    A_m, b, k_0, count = known.A_m, known.b, float(known.k_0), MUTANTS
    P = solve_continuous_lyapunov((A_m + L).T, -np.eye(2))

    def peaks(thetas: np.ndarray, switches: np.ndarray, first: np.ndarray) -> np.ndarray:
        def rates(s: list[np.ndarray], r: np.ndarray) -> list[np.ndarray]:
            x, x_m, x_c, theta_hat, k_r = s
            e_c, u = x - x_c, k_r * r - (theta_hat * x).sum(1)
            Pb_e = (e_c @ P @ b)[:, None]
            rate = Pb_e * x
            rate[(theta_hat >= box.upper) & (rate > 0) | (theta_hat <= box.lower) & (rate < 0)] = 0
            pushed = np.outer(k_0 * r, b)
            moved = x @ A_m.T + np.outer((thetas * x).sum(1) + u, b)
            return [moved, x_m @ A_m.T + pushed, x_c @ A_m.T + pushed - e_c @ L.T, rate, -gamma_r * Pb_e[:, 0] * r]

        x0 = np.tile(known.x0, (count, 1))
        s = [x0, x0, x0, np.zeros((count, 2)), np.full(count, k_0)]
        largest = np.zeros(count)
        for k in range(round(T / h)):
            r = first * size * (-1.0) ** (switches <= k * h).sum(1)
            k_1 = rates(s, r)
            k_2 = rates([a + h / 2 * d for a, d in zip(s, k_1, strict=True)], r)
            k_3 = rates([a + h / 2 * d for a, d in zip(s, k_2, strict=True)], r)
            k_4 = rates([a + h * d for a, d in zip(s, k_3, strict=True)], r)
            s = [a + h / 6 * (p + 2 * q + 2 * v + w) for a, p, q, v, w in zip(s, k_1, k_2, k_3, k_4, strict=True)]
            s[3] = np.clip(s[3], box.lower, box.upper)
            largest = np.maximum(largest, np.abs(s[0] - s[1]).max(1))
        return largest

    thetas, switches, first = box.drawn(rng, count), rng.uniform(0, T, (count, SWITCHES)), rng.choice([-1.0, 1.0], count)
    best = (np.zeros(0), np.zeros((0, 2)), np.zeros((0, SWITCHES)), np.zeros(0))
    for k in range(ROUNDS):
        found = (peaks(thetas, switches, first), thetas, switches, first)
        together = [np.concatenate(pair) for pair in zip(best, found, strict=True)]
        kept = np.argsort(-together[0])[:6]
        best, width = tuple(one[kept] for one in together), 0.3 * 0.8**k
        parent = rng.integers(0, 6, count)
        thetas = box.brought_in(best[1][parent] + width * (box.upper - box.lower) * rng.normal(size=(count, 2)))
        switches, first = np.abs(best[2][parent] + width * T * rng.normal(size=(count, SWITCHES))), best[3][parent]
    return float(best[0][0])


def main() -> None:
    rng, problem = np.random.default_rng(28), section_v.problem()
    short, fine = Simulation(t_end=6.0, dt=5e-4), Simulation(t_end=60.0, dt=1e-3)
    L = -np.eye(2)
    rows: list[tuple[str, Controller, Simulation, bool]] = [
        ("MRAC, Γ = 1", Mrac(gamma=1.0, name="MRAC"), short, False),
        ("MRAC, closed-loop model, L = −I, Γ = 1", MracClosedLoop(gamma=1.0, model_feedback=L, name="closed"), short, False),
        ("direct MRAC, Γ = 1", DirectMrac(gamma=1.0, name="direct"), short, False),
        ("L1-AC, Γ = 1e4, κ = 0.02 s", L1Adaptive(gamma=GAMMA, filter=input_filter(0.02), name="L1"),
         Simulation(t_end=40.0, dt=1e-5), True),
        ("PI, for a delay of 10 ms", pi_feedback(problem.known, unmodelled_delay=0.01), fine, True),
    ]  # fmt: skip
    for said, controller, simulation, linear in rows:
        found = certify(problem, [controller], Simulation(t_end=60.0, dt=1e-4), keys=KEYS)[controller.name]
        bound = found.values.get("error_bound_worst", found.values["error_bound"])
        peak, theta = over_theta(problem, controller, simulation, rng)
        if linear:
            tried = (theta, *problem.uncertainty.extreme_points(rng, 4))
            any_command = max(of_a_linear_loop(problem, controller, simulation, one) for one in tried)
        else:
            of_model = controller.model_feedback if isinstance(controller, MracClosedLoop) else np.zeros((2, 2))
            any_command = by_mutation(problem, of_model, float(isinstance(controller, DirectMrac)), rng)
        any_command, command = max(any_command, peak), found.values["error_bound_command"]
        numbers = f"{bound:.4g} | {any_command:.4g} | {bound / any_command:.2f} | {command:.4g} | {peak:.4g}"
        sys.stdout.write(f"| {said} | {numbers} | {command / peak:.2f} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
