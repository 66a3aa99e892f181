"""Checks your own controller or adaptive law with the tests that the package applies to its schemes.

``check(MyLaw())`` binds it to problems of every kind, compares runs with SciPy's integration, which shares no code with the
kernel, and tests ensembles, a freeze and the exported C. The function returns the findings as plain sentences, or raises
``CheckFailed``, which lists all failures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from barbalat.adaptation.law import AdaptiveLaw
from barbalat.controllers import NormalizedMrac, Sampled
from barbalat.export.compiler import require_compiler
from barbalat.export.in_the_loop import simulate_export
from barbalat.linear.systems import TransferFunction
from barbalat.loop.binding import bound, check_controller
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import flatten, map_arrays, unflatten
from barbalat.loop.sampling import Acting
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.regressors import Polynomial
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Sample, SampledEquations, feedback_of
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError, show

__all__ = ["CheckFailed", "Report", "check", "problem_kinds"]

SIMULATION = Simulation(t_end=2.0, dt=2e-3)
"""Settings of the runs; the solver is RK4."""
SAMPLE_TIME = 1e-2
"""Sample time [s] at which a continuous controller is sampled for freezing and export; a whole number of steps."""
REFERENCE_TOLERANCE = 1e-10
"""Relative and absolute tolerance of SciPy's integration."""
AGREEMENT_FLOOR, AGREEMENT_FACTOR = 1e-7, 4.0
"""The largest admissible difference between a run and the reference, relative to the largest state, or as a multiple of the
difference between the run and a run at half the step. The error is at most twice that difference if the method keeps its order,
or if the order falls to one at a corner. Halving the step must not increase the error, as it would if each stage changed the
state."""
SEVERAL_INPUTS = "several inputs"
FOR_ONE_INPUT = "only this problem fails: if the law is for one input, let bind raise InputError where known.inputs > 1"
FROZEN_SAMPLES = 5
"""The number of random states from which a freeze is tested."""


class CheckFailed(AssertionError):
    """The failed checks of a controller, as a list of sentences."""


@dataclass(frozen=True)
class Report:
    """The findings about a controller, one sentence per line."""

    name: str
    sentences: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join([f"{self.name}: nothing is wrong", *(f"  {sentence}" for sentence in self.sentences)])


def check(law: Any, problems: Mapping[str, TrackingProblem] | None = None) -> Report:
    """Check a controller, or an adaptive law within the normalised MRAC; a class without required settings may be passed instead
    of an instance.

    problems  problems by name, in place of those of ``problem_kinds``

    Raises CheckFailed with all failures, and InputError for an object that is neither a controller nor a law. A problem that
    ``bind`` rejects with an InputError does not count as a failure if another problem is accepted.
    """
    controller = _controller(law)
    kinds = problem_kinds(feedback_of(controller)) if problems is None else problems
    told: list[str] = []
    wrong: list[str] = []
    taken = 0
    for kind, problem in kinds.items():
        try:
            controller.bind(problem.known)
        except InputError as error:
            told.append(f"{kind}: it is rejected ({error})")
            continue
        except Exception as error:  # noqa: BLE001 (a stranger's lines may raise anything, which is then what is wrong)
            wrong.append(f"{kind}: bind raises {type(error).__name__}: {error}")
            continue
        taken += 1
        for one in _checks(problem):
            try:
                told.append(f"{kind}: {one(problem, controller)}")
            except (InputError, CheckFailed) as error:
                wrong.append(f"{kind}: {error}")
                if one is _traces:
                    break  # equations that can't be traced can't be simulated
    if not taken and not wrong:
        wrong.extend(["none of the problems can be used", *told])
    if wrong:
        if all(sentence.startswith(f"{SEVERAL_INPUTS}: ") for sentence in wrong):
            wrong.append(FOR_ONE_INPUT)
        listed = "\n".join(f"  {sentence}" for sentence in wrong)
        raise CheckFailed(f"{controller.name} does not meet the requirements on a controller:\n{listed}")
    return Report(controller.name, tuple(told))


def _controller(law: Any) -> Controller:
    made = law() if isinstance(law, type) else law
    if isinstance(made, Controller):
        return made
    if isinstance(made, AdaptiveLaw):
        return NormalizedMrac(law=made, name=type(made).__name__)
    raise InputError(
        f"check needs a controller, with name and bind, or an adaptive law, with initial, rates and limit, got {show(law)}"
    )


def problem_kinds(feedback: str = "state") -> dict[str, TrackingProblem]:
    """One small problem of each kind that a controller may be given. ``feedback`` is "state" or "output"."""
    return _of_the_output() if feedback == "output" else _of_the_state()


def _of_the_state() -> dict[str, TrackingProblem]:
    plant = Plant(A_m=[[0.0, 1.0], [-1.0, -1.4]], b=[0.0, 1.0], theta=[0.5, -0.3], x0=[0.1, 0.0])
    one = Problem(
        plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=Sine(1.0, 0.7),
        uncertainty=ParameterBox(lower=[-2.0, -2.0], upper=[2.0, 2.0]),
    )  # fmt: skip
    curved = replace(plant, theta=[0.5, -0.3, 0.1, 0.2, -0.1], regressor=Polynomial(degree=2))
    several = Plant(A_m=[[-1.0, 0.4], [0.0, -2.0]], b=[[1.0, 0.3], [0.0, 2.0]], theta=[[0.5, -1.0], [0.3, 0.2]], x0=[0.2, -0.1])
    return {
        "one input": one,
        "a tight known set": replace(
            one, reference=Sine(5.0, 2.0), uncertainty=ParameterBox(lower=[-0.1, -0.4], upper=[0.55, 0.05])
        ),
        "no known set": replace(one, uncertainty=None),
        "a regressor of second degree": replace(one, plant=curved, uncertainty=None),
        SEVERAL_INPUTS: Problem(
            plant=several,
            reference_model=ReferenceModel(k_0=[[1.0, 0.0], [0.5, 1.0]]),
            reference=(Sine(1.0, 0.7), Sine(0.5, 1.9)),
        ),
        "an unknown input gain": replace(one, input_gain=(0.5, 2.0)),
        "limits of the input": replace(one, plant=replace(plant, input=PlantInput(saturation=[-0.8, 0.8]))),
        "a delay": replace(one, plant=replace(plant, input=PlantInput(delay=0.02))),
    }


def _of_the_output() -> dict[str, TrackingProblem]:
    one = OutputProblem(
        plant=OutputPlant(TransferFunction([2.0], [1.0, 1.0])),
        reference_model=OutputReferenceModel(TransferFunction([3.0], [1.0, 3.0])),
        reference=Sine(1.0, 0.7),
    )
    return {
        "one output": one,
        "limits of the input": replace(one, plant=replace(one.plant, input=PlantInput(saturation=[-0.8, 0.8]))),
        "a delay": replace(one, plant=replace(one.plant, input=PlantInput(delay=0.02))),
    }


Check = Callable[[Any, Any], str]
"""A check of a controller on a problem: it returns a sentence or raises CheckFailed."""


def _checks(problem: TrackingProblem) -> Iterator[Check]:
    yield _traces
    if problem.delay == 0:
        yield _agrees_with_scipy
    yield _is_alone_what_it_is_among_others
    yield _rests_in_a_freeze
    yield _has_the_bits_of_its_export


def _traces(problem: TrackingProblem, controller: Controller) -> str:
    """The equations give the same results for numbers and for symbols."""
    check_controller(controller, problem)
    return "its equations give the same results on numbers and on symbols"


def _agrees_with_scipy(problem: TrackingProblem, controller: Controller) -> str:
    """The kernel's run agrees with SciPy's integration of the same equations."""
    simulation = _simulation(problem, controller)
    runs = [simulate(problem, [controller], replace(simulation, dt=simulation.dt / k))[controller.name] for k in (1, 2)]
    if any(run.diverged_at is not None for run in runs):
        return f"it diverges at t = {runs[0].diverged_at or runs[1].diverged_at:.3g} s, and is not compared with SciPy"
    found, finer = (_ends(run.loop, run.states[-1]) for run in runs)
    expected = _integrated(problem, controller, simulation)
    size = max(1.0, float(np.abs(expected).max()))
    apart, then = (float(np.abs(one - expected).max()) for one in (found, finer))
    floor, step = AGREEMENT_FLOOR * size, float(np.abs(found - finer).max())
    if not (apart <= floor + AGREEMENT_FACTOR * step and then <= floor + apart):
        raise CheckFailed(
            f"after {simulation.t_end:g} s its run differs by {apart:.2g} from SciPy's integration, and with half the step by "
            f"{then:.2g}: does limit change states in a way that derivative does not account for?"
        )
    return f"its run agrees with SciPy's integration to within {apart:.1g} at states up to {size:.2g}"


def _simulation(problem: TrackingProblem, controller: Controller) -> Simulation:
    """The settings for two seconds, in whole samples of a sampled controller."""
    equations = bound(problem, controller)
    if not isinstance(equations, SampledEquations):
        return SIMULATION
    T = equations.sample_time
    return Simulation(t_end=max(round(SIMULATION.t_end / T), 1) * T, dt=T / max(round(T / SIMULATION.dt), 1))


def _ends(loop: ClosedLoop, flat: Array) -> Array:
    """Split a flat state of the loop into x, x_m and the controller's state."""
    state = loop.unpack(flat)
    return np.concatenate([state.x, state.x_m, flatten((state.controller, np.zeros(0)))])


def _integrated(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Array:
    """Return the same final values from SciPy's integration of the equations themselves, without the loop and its kernel."""
    equations: Any = bound(problem, controller)
    parts = problem.dynamics.x0, problem.model.x0, equations.initial()
    if isinstance(equations, SampledEquations):
        parts = _sample_by_sample(problem, equations, parts, round(simulation.t_end / equations.sample_time))
    else:
        parts = _moved(problem, equations, parts, (0.0, simulation.t_end), None)
        parts = *parts[:2], equations.limit(parts[2])
    return np.asarray(flatten((*parts, np.zeros(0))), dtype=float)


def _sample_by_sample(problem: TrackingProblem, equations: Any, parts: Any, samples: int) -> Any:
    """Integrate plant and model with a sampled controller, which also acts at the first and at the last instant."""
    T, (x, x_m, own), of_controller = equations.sample_time, parts, problem.model.x0
    before: Sample | None = None
    u = np.zeros(0)
    for k in range(samples + 1):
        r = _command(problem, k * T)
        if before is not None:
            of_controller = _flow(lambda _, z, r=before.r: problem.model.derivative(z, r), of_controller, ((k - 1) * T, k * T))
        now = Sample(problem.dynamics.output(x), problem.model.output(of_controller), r)
        own = own if before is None else equations.advance(own, before, u, now)
        before, u = now, np.asarray(equations.control(own, *now))
        if k < samples:
            x, x_m, own = _moved(problem, equations, (x, x_m, own), (k * T, (k + 1) * T), u)
    return x, x_m, own


def _moved(problem: TrackingProblem, equations: Any, start: Any, span: tuple[float, float], held: Array | None) -> Any:
    """Integrate plant, model and a continuous controller over a span of time; ``held`` is the held control of a sampled
    controller."""
    flat = np.asarray(flatten(start), dtype=float)
    ends = [path.saturation for path in problem.plant.paths]
    low, high = (
        np.array([limits[i] if limits is not None else end for limits in ends]) for i, end in enumerate((-np.inf, np.inf))
    )

    def rates(t: float, z: Array) -> Array:
        (x, x_m, own), r = unflatten(start, z, 0)[0], _command(problem, t)
        if held is None:
            own, y, y_m = equations.limit(own), problem.dynamics.output(x), problem.model.output(x_m)
            u = np.asarray(equations.control(own, y, y_m, r))
            own_rates = equations.derivative(own, y, y_m, r, u)
        else:
            u, own_rates = held, map_arrays(np.zeros_like, own)
        v = np.clip(u, low.reshape(u.shape), high.reshape(u.shape))
        return np.asarray(flatten((problem.dynamics.derivative(x, v), problem.model.derivative(x_m, r), own_rates)), dtype=float)

    return unflatten(start, _flow(rates, flat, span), 0)[0]


def _flow(rates: Any, start: Array, span: tuple[float, float]) -> Array:
    from scipy.integrate import solve_ivp

    done = solve_ivp(rates, span, start, method="DOP853", rtol=REFERENCE_TOLERANCE, atol=REFERENCE_TOLERANCE, max_step=0.05)
    return np.asarray(done.y[:, -1])


def _command(problem: TrackingProblem, t: float) -> Array:
    values = np.array([float(signal(np.array(t))) for signal in problem.commands])
    return values if isinstance(problem.reference, tuple) else values[0]


def _is_alone_what_it_is_among_others(problem: TrackingProblem, controller: Controller) -> str:
    """The members of an ensemble equal single runs bit for bit. Only problems with state feedback are tested, because only their
    plants accept a different initial state."""
    if not isinstance(problem, Problem):
        members = [(problem, controller)] * 2
    else:
        members = [
            (replace(problem, plant=replace(problem.plant, x0=s * np.asarray(problem.dynamics.x0))), controller)
            for s in (1.0, -0.5, 2.0)
        ]
    simulation = _simulation(problem, controller)
    together = simulate_ensemble(members, simulation).metrics.max_abs_e
    alone = [simulate(one, [controller], simulation)[controller.name].metrics.max_abs_e[0] for one, _ in members]
    if not np.array_equal(together, np.array(alone), equal_nan=True):
        raise CheckFailed(
            "a member of an ensemble differs from the same run on its own: something is remembered outside the state"
        )
    return "the members of an ensemble equal single runs bit for bit"


def _sampled(problem: TrackingProblem, controller: Controller) -> Controller:
    """The controller as a flight computer runs it."""
    if isinstance(bound(problem, controller), SampledEquations):
        return controller
    return Sampled(controller=controller, sample_time=SAMPLE_TIME, discretization="euler")


def _rests_in_a_freeze(problem: TrackingProblem, controller: Controller) -> str:
    """The parts whose roles are estimates or memory do not change at all while the freeze switch is on, whatever the state."""
    loop = ClosedLoop.of(problem, _sampled(problem, controller))
    computer, random = loop.computer, np.random.default_rng(0)
    assert computer is not None
    template = Acting(loop._initial.controller, loop._initial.held)
    resting = [part for part in loop.parts if part.role.rests and part.size]
    first = loop.size - len(flatten(template))
    start = np.asarray(flatten(template), dtype=float)
    for _ in range(FROZEN_SAMPLES):
        moved = start + random.uniform(0.1, 0.3, len(start))
        acting: Acting = unflatten(template, moved, 0)[0]
        y, r = acting.held.measured + random.uniform(0.1, 1.0), acting.held.r + random.uniform(0.1, 1.0)
        after = np.asarray(flatten(computer.act(acting, y, r, np.ones(()))), dtype=float)
        for part in resting:
            rows = slice(part.start - first, part.start - first + part.size)
            if not np.array_equal(after[rows], moved[rows]):
                raise CheckFailed(f"a freeze does not keep {part.path}, which is {part.role.kind}")
    if not resting:
        return "it has neither estimates nor a memory for a freeze to keep"
    return f"a freeze keeps {', '.join(part.path for part in resting)}"


def _has_the_bits_of_its_export(problem: TrackingProblem, controller: Controller) -> str:
    """In closed loop the exported C equals the kernel bit for bit at every sample. This is tested if this machine has a
    compiler."""
    try:
        require_compiler()
    except InputError as error:
        return f"the exported C was not compared: {error}"
    sampled = _sampled(problem, controller)
    simulation = _simulation(problem, sampled)
    origin = simulate(problem, [sampled], simulation)[sampled.name]
    if origin.diverged_at is not None:
        return f"sampled every {SAMPLE_TIME:g} s it diverges, and its export was not compared"
    found = simulate_export(problem, sampled, simulation)
    if found.refused:
        raise CheckFailed(f"the exported C rejects {found.refused} of its samples")
    if differs := found.differs_from(origin):
        raise CheckFailed(f"the exported C differs from the simulation: {differs}")
    return "the exported C equals the simulation bit for bit"
