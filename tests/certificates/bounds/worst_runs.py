"""Searches for the runs in which |e| is as large as possible, with which ``tightness`` compares the guaranteed bounds.

The worst command and the worst disturbance of a linear loop follow from the signs of its impulse response. For adaptive loops
``by_mutation`` varies theta, the initial estimates, the input gain, and the instants at which command and disturbance jump.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from barbalat import Problem, Simulation, simulate
from barbalat.plants import PlantInput
from barbalat.protocols import Controller
from barbalat.signals import Constant, Steps

MUTANTS, KEPT, SWITCHES = 48, 6, 10


class Largest(NamedTuple):
    """The largest |e_i|, |x_i| and |u| of runs."""

    e: float
    x: float = 0.0
    u: float = 0.0


def steps(values: np.ndarray, h: float) -> Steps | Constant:
    """A signal that has one value after the other for h seconds each."""
    at = np.flatnonzero(np.diff(values)) + 1
    if not len(at):
        return Constant(float(values[0]))
    return Steps(times=tuple(at * h), values=tuple(values[at]), initial=float(values[0]))


def disturbance_size(problem: Problem) -> float:
    return 0.0 if problem.disturbance is None else float(problem.disturbance.bound)


def acted_on(problem: Problem, r: Any, d: Any) -> Problem:
    """The problem with this command, and with this disturbance if there is one."""
    return replace(problem, reference=r, disturbance=None if problem.disturbance is None else d)


def largest_of(problem: Problem, controller: Controller, simulation: Simulation) -> Largest:
    (run,) = simulate(problem, [controller], simulation).values()
    return Largest(max(run.figures["max_abs_e"]), float(np.abs(run.x).max()), float(run.figures["max_abs_u"]))


def by_pulses(problem: Problem, controller: Controller, horizon: float, T: float, parts: int = 1) -> tuple[Largest, float]:
    """The largest e, x and u of a linear loop at rest under the worst command and disturbance, and the largest e under the
    problem's command and the worst disturbance.

    The command changes every T seconds, at the samples of a sampled loop, and the disturbance also at the ends of ``parts`` parts
    of this time. The response to a pulse in each part gives the signs of the worst sequences, which are then simulated. The
    pulses act after T seconds, because some laws take their first sample differently.
    """
    r, d = problem.reference.bound, disturbance_size(problem)
    h, count = T / parts, round(horizon / T)
    simulation, still = Simulation(t_end=count * T, dt=h, record_points=count * parts + 1), Constant(0.0)
    fine = replace(simulation, dt=h / 8)  # e is a small difference of large signals

    def rows(command: Any, disturbance: Any, samples: int = count) -> np.ndarray:
        longer = replace(simulation, t_end=samples * T, record_points=samples * parts + 1)
        (run,) = simulate(acted_on(problem, command, disturbance), [controller], longer).values()
        assert len(run.t) == samples * parts + 1
        return np.hstack([run.e, run.x, run.u.reshape(len(run.t), -1)])

    unit = np.eye(2 * parts)[parts:]
    of_r = rows(steps(np.append(r * unit.sum(axis=0), 0.0), h), still, count + 1)[parts:]
    of_d = [rows(still, steps(np.append(d * one, 0.0), h), count + 1)[parts:] for one in unit] if d else []
    n = problem.plant.n

    def signs(end: int, i: int) -> tuple[np.ndarray, np.ndarray]:
        """The signs of r and d in every part up to ``end`` with which row i is as large as possible there."""
        starts = np.arange(0, end, parts)
        signs_of_r = np.repeat(np.sign(of_r[end - starts, i]), parts)
        signs_of_d = np.column_stack([np.sign(one[end - starts, i]) for one in of_d]).reshape(-1) if d else 0 * signs_of_r
        return signs_of_r, signs_of_d

    ends = range((count - 1) * parts + 1, count * parts + 1)
    sums = np.array([sum(np.abs(one[end::-parts]).sum(axis=0) for one in (of_r, *of_d)) for end in ends])
    found = Largest(0.0)
    for group in (range(n), range(n, 2 * n), range(2 * n, sums.shape[1])):
        i = max(group, key=lambda row: sums[:, row].max())
        of_command, of_disturbance = signs(ends[int(sums[:, i].argmax())], i)
        worst = acted_on(problem, steps(r * of_command, h), steps(d * of_disturbance, h))
        run = largest_of(worst, controller, fine)
        found = Largest(*(max(pair) for pair in zip(found, run, strict=True)))
    own = rows(problem.reference, still)[:, :n]
    pushed = np.zeros_like(own)
    for one in of_d:
        for start in range(parts):
            pushed[start::parts] += np.cumsum(np.abs(one[start::parts, :n]), axis=0)
    end, i = np.unravel_index(int((np.abs(own) + pushed).argmax()), own.shape)
    against = steps(d * np.sign(own[end, i]) * signs(int(end), int(i))[1], h) if d else still
    return found, largest_of(acted_on(problem, problem.reference, against), controller, fine).e


def of_noise(problem: Problem, T: float, w: float) -> Largest:
    """The largest e, x and u of u = k_0 r - theta'(x + noise), held for T seconds, at rest without delay and actuator, for the
    worst command and a noise of at most w on each state. The recursion is that of the samples and does not use the package's."""
    known, theta, r = problem.known, problem.plant.theta, problem.reference.bound
    k_0, n = float(known.k_0), len(theta)

    def held(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        whole = expm(T * np.block([[A, b[:, None]], [np.zeros((1, n + 1))]]))
        return whole[:n, :n], whole[:n, n]

    (Phi, G), (Phi_m, G_m) = held(known.A_m + np.outer(known.b, theta), known.b), held(known.A_m, known.b * k_0)
    none, one = np.zeros((n, n)), np.eye(n)
    M = np.block([[Phi - np.outer(G, theta), none], [none, Phi_m]])
    pushed = np.column_stack([r * np.append(G * k_0, G_m), w * np.vstack([-np.outer(G, theta), none])])
    rows = np.vstack([np.hstack([one, -one]), np.hstack([one, none]), np.append(-theta, np.zeros(n))])
    largest = np.append(np.zeros(2 * n), k_0 * r + w * np.abs(theta).sum())
    for _ in range(4000):
        largest, pushed = largest + np.abs(rows @ pushed).sum(axis=1), M @ pushed
    return Largest(float(largest[:n].max()), float(largest[n:-1].max()), float(largest[-1]))


def by_steps(problem: Problem, controller: Controller, simulation: Simulation, *, known: bool = False) -> float:
    """The largest |e_i| under the command and the disturbance whose signs are those of the derivatives of the responses to steps,
    reversed in time. With ``known`` the command is that of the problem."""
    size, d = problem.reference.bound, disturbance_size(problem)
    at_rest = problem
    if isinstance(problem, Problem):
        at_rest = replace(problem, plant=replace(problem.plant, x0=np.zeros(problem.plant.n)))

    def run_of(one: Any, command: Any, disturbance: Any) -> Any:
        (run,) = simulate(acted_on(one, command, disturbance), [controller], simulation).values()
        return run

    def turned(run: Any, i: int, size: float, sign: float, end: float) -> Any:
        slopes = np.sign(np.diff(run.e[:, i]))
        turns = end - run.t[1:-1][np.diff(slopes) != 0]
        times = np.unique(turns[turns > 0])
        first = sign * size * (-1.0) ** len(times) * (slopes[slopes != 0][:1].sum() or 1.0)
        if not len(times):
            return Constant(first)
        return Steps(times=tuple(times), values=tuple(-first * (-1.0) ** np.arange(len(times))), initial=first)

    still, from_rest = Constant(0.0), Constant(0.0)
    of_r = run_of(at_rest, Constant(size), from_rest)
    of_d = run_of(at_rest, still, Constant(d)) if d else None
    own, largest = run_of(problem, problem.reference, still), 0.0
    for i in range(own.e.shape[1]):
        if known and of_d is not None:
            pushed = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(of_d.e[:, i])))])
            k = int((np.abs(own.e[:, i]) + pushed).argmax())
            against = turned(of_d, i, d, float(np.sign(own.e[k, i])), float(own.t[k]))
            largest = max(largest, *run_of(problem, problem.reference, against).figures["max_abs_e"])
            continue
        for sign in (-1.0, 1.0):
            command = turned(of_r, i, size, sign, simulation.t_end)
            against = turned(of_d, i, d, sign, simulation.t_end) if of_d is not None else still
            largest = max(largest, *run_of(problem, command, against).figures["max_abs_e"])
    return largest


@dataclass(frozen=True, eq=False)
class Loops:
    """MRACs with one input and phi(x) = x, many at a time; integrated here and not by the package, in steps that must be
    short enough for the fastest of them.

    gamma    adaptive gain; that of the feedforward as well if ``direct``
    L        gain of the closed-loop model; zero for other schemes
    gains    interval of the unknown input gain; ``None`` if the gain is known to be 1
    size     of the matched disturbance
    theta    whether theta is searched over the box; otherwise it is that of the problem
    started  whether the initial estimate is searched over its set; otherwise it is zero
    known    whether the command is that of the problem
    projected  whether the estimates are projected onto the box
    """

    problem: Problem
    gamma: float = 1.0
    L: Any = ((0.0, 0.0), (0.0, 0.0))
    direct: bool = False
    gains: tuple[float, float] | None = None
    size: float = 0.0
    theta: bool = True
    started: bool = False
    known: bool = False
    projected: bool = True

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """The ends of the set of the feedback's estimates: of theta, or of theta/omega."""
        box, most = self.problem.uncertainty, 1 / self.gains[0] if self.direct and self.gains else 1.0
        return box.lower * most, box.upper * most  # of a box that contains zero

    def drawn_from(self) -> tuple[np.ndarray, np.ndarray]:
        """The ends of theta, of the initial estimate and of the input gain."""
        box, fixed = self.problem.uncertainty, self.problem.plant.theta
        theta = (box.lower, box.upper) if self.theta else (fixed, fixed)
        start = self.ends if self.started else (np.zeros(2), np.zeros(2))
        omega = self.gains if self.gains and self.theta else (1.0, 1.0)
        return tuple(np.concatenate([theta[k], start[k], omega[k : k + 1]]) for k in range(2))

    def more(self, count: int) -> list[np.ndarray]:
        """Further states of the law at t = 0."""
        return []

    def further(self, s: list[np.ndarray], u: np.ndarray) -> tuple[np.ndarray | float, list[np.ndarray]]:
        """What the law adds to the rate of the estimates, and the rates of its further states."""
        return 0.0, []

    def peaks(self, genes: np.ndarray, turns: np.ndarray, T: float, h: float) -> tuple[np.ndarray, list[np.ndarray]]:
        """The largest |e_i| of each run, and the commands and disturbances in each step.

        A row of ``turns`` has the instants at which r jumps and, in the second half, at which d changes from increasing V to
        decreasing it or back. The last gene is r at t = 0 as a fraction of its size.
        """
        known, count = self.problem.known, len(genes)
        A_m, b, k_0, L = known.A_m, known.b, float(known.k_0), np.asarray(self.L)
        P = solve_continuous_lyapunov((A_m + L).T, -np.eye(2))
        thetas, omega, share = genes[:, :2], genes[:, 4], genes[:, 5]
        low, high = self.ends
        if not self.projected:
            low, high = np.full(2, -np.inf), np.full(2, np.inf)
        of_gain = (-np.inf, np.inf) if self.gains is None else self.gains
        if self.direct and self.gains is not None:
            of_gain = (k_0 / self.gains[1], k_0 / self.gains[0])
        start = np.full(count, k_0 if self.direct else 1.0)

        def rates(s: list[np.ndarray], r: np.ndarray, d: np.ndarray) -> list[np.ndarray]:
            x, x_m, x_c, theta_hat, g = s[:5]
            e_c, seen = x - x_c, (theta_hat * x).sum(1)
            u = g * r - seen if self.direct else (k_0 * r - seen) / g
            drive = self.gamma * (e_c @ P @ b)
            added, more = self.further(s, u)
            rate = drive[:, None] * x + added
            rate[(theta_hat >= high) & (rate > 0) | (theta_hat <= low) & (rate < 0)] = 0
            of_g = -drive * r if self.direct else drive * u * (self.gains is not None)
            of_g = np.where((g >= of_gain[1]) & (of_g > 0) | (g <= of_gain[0]) & (of_g < 0), 0.0, of_g)
            pushed = np.outer(k_0 * r, b)
            moved = x @ A_m.T + np.outer((thetas * x).sum(1) + omega * u + d, b)
            return [moved, x_m @ A_m.T + pushed, x_c @ A_m.T + pushed - e_c @ L.T, rate, of_g, *more]

        x0 = np.tile(known.x0, (count, 1))
        s = [x0, x0, x0, genes[:, 2:4].copy(), start, *self.more(count)]
        largest, signals = np.zeros(count), list[np.ndarray]()
        for k in range(round(T / h)):
            flips = (-1.0) ** (turns.reshape(count, 2, -1) <= k * h).sum(axis=2)
            r = share * self.problem.reference.bound * flips[:, 0]
            if self.known:
                r = np.full(count, float(self.problem.reference(np.array([k * h]))[0]))
            d = self.size * flips[:, 1] * np.where((s[0] - s[1]) @ P @ b < 0, -1.0, 1.0)
            signals.append(np.array([r, d]))
            k_1 = rates(s, r, d)
            k_2 = rates([a + h / 2 * slope for a, slope in zip(s, k_1, strict=True)], r, d)
            k_3 = rates([a + h / 2 * slope for a, slope in zip(s, k_2, strict=True)], r, d)
            k_4 = rates([a + h * slope for a, slope in zip(s, k_3, strict=True)], r, d)
            s = [a + h / 6 * (p + 2 * q + 2 * v + w) for a, p, q, v, w in zip(s, k_1, k_2, k_3, k_4, strict=True)]
            s[3], s[4] = np.clip(s[3], low, high), np.clip(s[4], *of_gain)
            largest = np.fmax(largest, np.abs(s[0] - s[1]).max(1))
        return largest, signals


@dataclass(frozen=True, eq=False)
class Composite(Loops):
    """Composite adaptation, or concurrent learning if a rate of forgetting is given: laws of examples/laws_with_lyapunov.py."""

    gamma_c: float = 1.0
    tau: float = 0.1
    forgetting: float | None = None

    def more(self, count: int) -> list[np.ndarray]:
        known = self.problem.known
        zeta = np.full(count, known.b @ known.x0 / (known.b @ known.b))
        memory = [] if self.forgetting is None else [np.zeros((count, 2, 2)), np.zeros((count, 2))]
        return [zeta, np.zeros((count, 2)), *memory]

    def further(self, s: list[np.ndarray], u: np.ndarray) -> tuple[np.ndarray | float, list[np.ndarray]]:
        known, x, theta_hat, zeta, phi = self.problem.known, s[0], s[3], s[5], s[6]
        b_plus = known.b / (known.b @ known.b)
        z = (x @ b_plus - zeta) / self.tau
        filters = [z + x @ known.A_m.T @ b_plus + u, (x - phi) / self.tau]
        if self.forgetting is None:
            return self.gamma * self.gamma_c * phi * (z - (theta_hat * phi).sum(1))[:, None], filters
        R, Q, share = s[7], s[8], 1 / (1 + (phi**2).sum(1))
        memory = [share[:, None, None] * phi[:, :, None] * phi[:, None, :], (share * z)[:, None] * phi]
        memory = [gained - self.forgetting * kept for gained, kept in zip(memory, (R, Q), strict=True)]
        return self.gamma * self.gamma_c * (Q - np.einsum("kij,kj->ki", R, theta_hat)), [*filters, *memory]


class Found(NamedTuple):
    """The worst run: its largest |e_i| as integrated here, its plant and its command, and the initial estimate."""

    peak: float
    problem: Problem
    start: np.ndarray
    simulation: Simulation

    def replayed(self, controller: Controller, finer: int = 1) -> float:
        """The largest |e_i| of the same run by the package."""
        simulation = replace(self.simulation, dt=self.simulation.dt / finer)
        return largest_of(self.problem, controller, simulation).e


def by_mutation(loops: Loops, rng: np.random.Generator, *, T: float = 4.0, h: float = 2e-3, rounds: int = 8) -> Found:
    """The worst of the runs with T seconds, from random ones by mutation of the best."""
    low, high = loops.drawn_from()
    low, high = np.append(low, -1.0), np.append(high, 1.0)
    genes = rng.uniform(low, high, (MUTANTS, len(low)))
    turns = rng.uniform(0, 2 * T, (MUTANTS, 2 * SWITCHES))  # half of them after the end
    best = (np.zeros(0), np.zeros((0, len(low))), np.zeros((0, 2 * SWITCHES)))
    for k in range(rounds):
        found = (loops.peaks(genes, turns, T, h)[0], genes, turns)
        together = [np.concatenate(pair) for pair in zip(best, found, strict=True)]
        kept = np.argsort(-together[0])[:KEPT]
        best, width = tuple(one[kept] for one in together), 0.3 * 0.75**k
        parent = rng.integers(0, KEPT, MUTANTS)
        genes = np.clip(best[1][parent] + width * (high - low) * rng.normal(size=genes.shape), low, high)
        moved = rng.random(turns.shape) < 0.5
        turns = np.abs(best[2][parent] + moved * width * T * rng.normal(size=turns.shape))
    gene, signals = best[1][0], np.array(loops.peaks(best[1][:1], best[2][:1], T, h)[1])[:, :, 0]
    plant = replace(loops.problem.plant, theta=gene[:2])
    if loops.gains is not None:
        plant = replace(plant, input=PlantInput(gain=float(gene[4])))
    command = loops.problem.reference if loops.known else steps(signals[:, 0], h)
    problem = replace(loops.problem, plant=plant, reference=command)
    if loops.size:
        problem = replace(problem, disturbance=steps(signals[:, 1], h))
    return Found(float(best[0][0]), problem, gene[2:4], Simulation(t_end=T, dt=h))
