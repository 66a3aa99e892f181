"""Measures how tight the guaranteed bounds are: the ratio of each bound to the worst run that a search finds.

Run as a script, it prints the tables of docs/laboratory/bounds.md that compare bounds with searches. The bound for all commands
is compared with the worst run for any command of the case's size, and the bound for the case's command with the worst run under
that command. ``worst_runs`` has the searches. A script's argument, part of a row's name, restricts the rows.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from barbalat import (
    Adrc,
    DirectMrac,
    KnownParameters,
    L1Adaptive,
    L1PiecewiseConstant,
    Mrac,
    MracClosedLoop,
    Problem,
    Sampled,
    Simulation,
    TransferFunction,
    certify,
    input_filter,
    simulate,
    simulate_ensemble,
)
from barbalat.cases.load import load_case
from barbalat.designs import pi_feedback
from barbalat.papers.jafari_2013 import section_v
from barbalat.plants import Noise, PlantInput, Sensor
from barbalat.protocols import Controller
from barbalat.signals import Constant, Sine
from certificates.bounds.worst_runs import Composite, Loops, by_mutation, by_pulses, by_steps, of_noise

KEYS = ("error_bound", "error_bound_worst", "error_bound_command")
OF_RESPONSES = ("error_bound_held", "error_bound", "state_bound", "control_bound")
GAMMA, SIZE, GAINS, T, NOISE = 1e4, 2.0, (0.5, 2.0), 0.01, 0.05
"""Gain of L1-AC as in the case, size of the disturbance, interval of the input gain, sample time [s], and bound on the
noise."""
Row = tuple[str, float, float, float, float]


def own_laws() -> ModuleType:
    """examples/laws_with_lyapunov.py."""
    path = Path(__file__).parents[3] / "examples" / "laws_with_lyapunov.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def values(problem: Problem, controller: Controller, keys: tuple[str, ...], t_end: float = 60.0) -> dict[str, float]:
    """The guaranteed ones of these bounds."""
    found = certify(problem, [controller], Simulation(t_end=t_end, dt=1e-4), keys=keys)[controller.name]
    return {key: found.values[key] for key in keys if key in found.guaranteed}


def at(problem: Problem, theta: np.ndarray) -> Problem:
    return replace(problem, plant=replace(problem.plant, theta=theta))


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


def linear_rows(problem: Problem) -> Iterator[tuple[str, Callable[[], list[Row]]]]:
    """L1-AC, which is nearly linear, and PI, over theta; and their bounds that follow from (10) and from the small gain."""
    for said, controller, simulation in (
        ("L1-AC, Γ = 10⁴, κ = 0.02 s", L1Adaptive(gamma=GAMMA, filter=input_filter(0.02)), Simulation(t_end=40.0, dt=1e-5)),
        ("PI for a delay of 10 ms", pi_feedback(problem.known, unmodelled_delay=0.01), Simulation(t_end=60.0, dt=1e-3)),
    ):

        def rows(said: str = said, controller: Any = controller, simulation: Simulation = simulation) -> list[Row]:
            rng = np.random.default_rng(28)
            found, (peak, theta) = values(problem, controller, KEYS), over_theta(problem, controller, simulation, rng)
            tried = (theta, *problem.uncertainty.extreme_points(rng, 4))
            largest = max(peak, *(by_steps(at(problem, one), controller, simulation) for one in tried))
            general = found["error_bound"]
            return [
                (said, found["error_bound_worst"], largest, found["error_bound_command"], peak),
                (f"{said}, `error_bound`", general, largest, general, peak),
            ]

        yield said, rows


def adaptive_rows(problem: Problem) -> Iterator[tuple[str, Callable[[], list[Row]]]]:
    """MRAC and its relatives, without and with a disturbance or an unknown input gain, and laws with a Lyapunov function of their
    own."""
    L, own, disturbed = -np.eye(2), own_laws(), replace(problem, disturbance=Sine(amplitude=SIZE, frequency=1.0))
    beside = {"size": SIZE, "theta": False, "started": True}

    def mrac(start: Any) -> Controller:
        return Mrac(gamma=1.0, theta_hat0=start)

    def closed(start: Any) -> Controller:
        return MracClosedLoop(gamma=1.0, theta_hat0=start, model_feedback=L)

    def direct(start: Any) -> Controller:
        return DirectMrac(gamma=1.0, theta_hat0=start)

    unknown, both = replace(problem, input_gain=GAINS), replace(disturbed, input_gain=GAINS)
    by = f"\\|d\\| ≤ {SIZE:g}"
    rows: list[tuple[str, Loops, Callable[[Any], Any], float, float, int]] = [
        ("MRAC, Γ = 1", Loops(problem), mrac, 2.0, 1e-3, 1),
        ("MRAC with a closed-loop model, L = −I, Γ = 1", Loops(problem, L=L), closed, 4.0, 2e-3, 1),
        ("direct MRAC, Γ = 1", Loops(problem, direct=True), direct, 2.0, 1e-3, 1),
        ("MRAC, Γ = 1, input gain in [0.5, 2]", Loops(unknown, gains=GAINS), lambda _: Mrac(gamma=1.0), 0.8, 2e-4, 1),
        ("direct MRAC, Γ = 1, input gain in [0.5, 2]", Loops(unknown, direct=True, gains=GAINS), direct, 2.0, 1e-3, 1),
        (f"MRAC, Γ = 1, {by}", Loops(disturbed, **beside), mrac, 4.0, 2e-3, 2),
        (f"MRAC with a closed-loop model, {by}", Loops(disturbed, L=L, **beside), closed, 4.0, 2e-3, 2),
        (f"direct MRAC, gain in [0.5, 2], {by}", Loops(both, direct=True, gains=GAINS, **beside), direct, 4.0, 2e-3, 2),
        ("high-order tuner, γ = 1", Loops(problem, projected=False), lambda _: own.HighOrderTuner(gamma=1.0), 1.0, 5e-4, 100),
        ("composite adaptation, γ = 1, γ_c = 0.1", Composite(problem, gamma_c=0.1),
         lambda _: own.CompositeAdaptation(gamma=1.0, gamma_c=0.1), 1.5, 5e-4, 4),
        ("concurrent learning, γ = 1", Composite(problem, forgetting=0.05),
         lambda _: own.ConcurrentLearning(gamma=1.0), 2.0, 1e-3, 4),
    ]  # fmt: skip
    for said, loops, make, horizon, h, finer in rows:

        def row(said: str = said, loops: Loops = loops, make: Any = make, of_run: tuple = (horizon, h, finer)) -> list[Row]:
            horizon, h, finer = of_run
            rng = np.random.default_rng(28)

            def worst(one: Loops) -> float:
                runs = [by_mutation(one, rng, T=horizon, h=h) for _ in range(2 if one.size else 1)]
                return max(run.replayed(make(run.start), finer) for run in runs)

            largest = worst(loops)
            if loops.size:
                peak = worst(replace(loops, known=True))
            else:
                simulation, gains = Simulation(t_end=3 * horizon, dt=h / finer / 4), GAINS if loops.gains else ()
                inputs = [PlantInput(gain=one) for one in gains] or [loops.problem.plant.input]
                plants = [replace(loops.problem, plant=replace(loops.problem.plant, input=one)) for one in inputs]
                peak = max(over_theta(one, make(np.zeros(2)), simulation, rng)[0] for one in plants)
            found = values(loops.problem, make(np.zeros(2)), KEYS)
            general = found["error_bound"]
            bounds = found.get("error_bound_worst", general), found.get("error_bound_command", general)
            return [(said, bounds[0], max(largest, peak), bounds[1], peak)]

        yield said, row
    said = f"L1-AC, Γ = 10⁴, κ = 0.02 s, {by}"

    def filtered() -> list[Row]:
        controller, simulation = L1Adaptive(gamma=GAMMA, filter=input_filter(0.02)), Simulation(t_end=20.0, dt=2e-5)
        bound = values(disturbed, controller, KEYS)["error_bound"]
        known = by_steps(disturbed, controller, simulation, known=True)
        return [(said, bound, by_steps(disturbed, controller, simulation), bound, known)]

    yield said, filtered


def output_rows() -> Iterator[tuple[str, Callable[[], list[Row]]]]:
    case = load_case("l1-output")
    for controller in case.controllers:
        said = f"`l1-output`, {controller.name}"

        def row(said: str = said, controller: Any = controller) -> list[Row]:
            bound, simulation = values(case.problem, controller, KEYS[:1])["error_bound"], Simulation(t_end=12.0, dt=1e-4)
            known = by_steps(case.problem, controller, simulation, known=True)
            return [(said, bound, by_steps(case.problem, controller, simulation), bound, known)]

        yield said, row


def response_rows(problem: Problem) -> Iterator[tuple[str, Callable[[], list[str]]]]:
    """Bounds on e, x and u of linear loops at the case's theta: of Section V from rest with an actuator and a disturbance,
    continuous, or sampled and with a delay; and of the bundled quadrotor."""
    actuator = TransferFunction([100.0], [1.0, 100.0])
    rest = replace(problem.plant, x0=np.zeros(2))
    d = Sine(amplitude=SIZE, frequency=1.0)
    late = replace(problem, plant=replace(rest, input=PlantInput(delay=0.015, actuator=actuator)), disturbance=d)
    prompt = replace(problem, plant=replace(rest, input=PlantInput(actuator=actuator)), disturbance=d)
    known = KnownParameters(theta=problem.plant.theta)
    PI, adrc = pi_feedback(problem.known, unmodelled_delay=0.03), Adrc(bandwidth=15.0)
    rows: list[tuple[str, Any, Any, float, float, int]] = [
        (f"{name}, continuous", prompt, controller, 20.0, T / 4, 1)
        for name, controller in (("known parameters", known), ("PI", PI), ("ADRC", adrc))
    ]
    rows += [
        (f"{name}, sampled", late, controller, 20.0, T, 4)
        for name, controller in (
            ("known parameters", Sampled(known, T, discretization="euler")),
            ("PI", Sampled(PI, T)),
            ("ADRC", Sampled(adrc, T)),
            ("piecewise-constant L1", L1PiecewiseConstant(sample_time=T, filter=input_filter(0.05))),
        )
    ]
    case = load_case("quadrotor-pitch")
    rows += [
        (f"`quadrotor-pitch`, {one.name}", case.problem, one, 12.0, one.sample_time, 2)
        for one in case.controllers
        if not one.name.endswith("gradient law")
    ]
    for said, one, controller, horizon, sample, parts in rows:

        def row(said: str = said, one: Any = one, controller: Any = controller, of_run: tuple = (horizon, sample, parts)) -> list:
            found = values(one, controller, OF_RESPONSES, t_end=of_run[0])
            worst, known = by_pulses(one, controller, *of_run)
            bounds = found.get("error_bound_held", found["error_bound"]), found["state_bound"], found["control_bound"]
            pairs = [*zip(bounds, worst, strict=True), (found["error_bound"], known)]
            return [f"| {said} | " + " | ".join(f"{bound:.4g} | {bound / run:.3f}" for bound, run in pairs) + " |"]

        yield said, row

    said = "known parameters, sampled, noise"

    def noisy() -> list[str]:
        sensor = Sensor(noise=Noise(std=NOISE, sample_time=T, bound=NOISE))
        controller = Sampled(known, T, discretization="euler")
        found = values(replace(problem, plant=rest, sensor=sensor), controller, OF_RESPONSES, t_end=20.0)
        pairs = zip((found[key] for key in OF_RESPONSES if key != "error_bound"), of_noise(problem, T, NOISE), strict=True)
        return [f"| {said} | " + " | ".join(f"{bound:.4g} | {bound / run:.3f}" for bound, run in pairs) + " | | |"]

    yield said, noisy


def other_rows(problem: Problem) -> Iterator[tuple[str, Callable[[], list[str]]]]:
    """The bounds on estimates and on a network's weights and control."""
    own = own_laws()

    def of_estimates() -> list[str]:
        lines, one = [], at(problem, np.array([5.0, 0.0]))
        for law in (own.HighOrderTuner(gamma=1.0), own.CompositeAdaptation(gamma=1.0), own.ConcurrentLearning(gamma=1.0)):
            bound = values(one, law, ("estimates_error_bound",))["estimates_error_bound"]
            (run,) = simulate(one, [law], Simulation(t_end=0.5, dt=1e-5)).values()
            off = float(np.abs(run.theta_hat - one.plant.theta).max())
            lines.append(f"| {law.name}, `estimates_error_bound` | {bound:.4g} | {off:.4g} | {bound / off:.2f} |")
        return lines

    yield "estimates_error_bound", of_estimates

    def of_network() -> list[str]:
        case = load_case("wing-rock")
        (network,) = [one for one in case.controllers if one.name == "Network"]
        bounds = values(case.problem, network, ("W_hat_bound", "control_bound"))
        W_hat = u = 0.0
        for size in (300.0, 320.0, 340.0, 360.0, 380.0):
            pushed = replace(case.problem, disturbance=Constant(size))
            (run,) = simulate(pushed, [network], Simulation(t_end=10.0, dt=1e-4)).values()
            if run.diverged_at is None:
                W_hat, u = max(W_hat, float(np.abs(run.theta_hat).max())), max(u, run.figures["max_abs_u"])
        return [
            f"| network, `{key}` | {bounds[key]:.4g} | {worst:.4g} | {bounds[key] / worst:.2f} |"
            for key, worst in (("W_hat_bound", W_hat), ("control_bound", u))
        ]

    yield "network", of_network


def line(row: Row) -> str:
    said, bound, worst, of_command, with_command = row
    of_any = f"{bound:.4g} | {worst:.4g} | {bound / worst:.2f}"
    return f"| {said} | {of_any} | {of_command:.4g} | {with_command:.4g} | {of_command / with_command:.2f} |"


def main() -> None:
    problem, part = section_v.problem(), sys.argv[1] if len(sys.argv) > 1 else ""
    for group in (adaptive_rows(problem), linear_rows(problem), output_rows()):
        for said, rows in group:
            if part in said:
                sys.stdout.write("".join(f"{line(one)}\n" for one in rows()))
                sys.stdout.flush()
    for of_text in (response_rows(problem), other_rows(problem)):
        for said, lines in of_text:
            if part in said:
                sys.stdout.write("".join(f"{one}\n" for one in lines()))
                sys.stdout.flush()


if __name__ == "__main__":
    main()
