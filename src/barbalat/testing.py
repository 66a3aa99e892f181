"""Checks of a controller or an adaptive law of one's own, as the tests of the package hold its own schemes to them.

``check(MyLaw())`` binds it to problems of every kind, compares runs with an integration by SciPy that shares no code with the
kernel, and looks at ensembles, a freeze and the exported C. It returns what was found, as plain sentences, and raises
``CheckFailed``, which lists what is wrong.
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
from barbalat.loop.binding import bound, check_controller
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import flatten, unflatten
from barbalat.loop.sampling import Acting
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.output_plant import OutputPlant, OutputReferenceModel
from barbalat.problem.plant import Plant
from barbalat.problem.reference_model import ReferenceModel
from barbalat.problem.regressors import Polynomial
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, Sample, SampledEquations, feedback_of
from barbalat.run.ensemble import simulate_ensemble
from barbalat.run.simulate import simulate
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError, show

SIMULATION = Simulation(t_end=2.0, dt=2e-3)
"""Of the runs; their solver is RK4."""
SAMPLE_TIME = 1e-2
"""[s], of a continuous controller that is wrapped to be frozen and exported; a whole number of steps."""
REFERENCE_TOLERANCE = 1e-10
"""Of SciPy's integration, relative and absolute."""
AGREEMENT_FLOOR, AGREEMENT_FACTOR = 1e-7, 4.0
"""A run may differ from the reference by so much of the largest state, or by so many times its difference from a run at half the
step: where the method keeps its order, or falls to the first at a corner, its error is at most twice that difference."""
FROZEN_SAMPLES = 5
"""Random states from which a freeze is tried."""


class CheckFailed(AssertionError):
    """What a controller does not keep, as a list of sentences."""


@dataclass(frozen=True)
class Report:
    """What was found of a controller, as sentences, a line for each in its text."""

    name: str
    sentences: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join([f"{self.name}: nothing is wrong", *(f"  {sentence}" for sentence in self.sentences)])


def check(law: Any, problems: Mapping[str, TrackingProblem] | None = None) -> Report:
    """Check a controller, or an adaptive law within the normalised MRAC; a class that needs no settings may be given itself.

    problems  by their names, instead of ``problem_kinds``

    Raises CheckFailed with all that is wrong, and InputError for what is neither a controller nor a law. A problem that ``bind``
    refuses by an InputError is no fault, as long as another one is taken.
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
            told.append(f"{kind}: it is refused ({error})")
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
                    break  # what can't be traced can't run
    if not taken and not wrong:
        wrong.append("none of the problems is taken: bind refuses every one")
    if wrong:
        listed = "\n".join(f"  {sentence}" for sentence in wrong)
        raise CheckFailed(f"{controller.name} does not keep what a controller has to:\n{listed}")
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
    """One small problem of each kind that a controller may meet; ``feedback`` is "state" or "output"."""
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
        "no known set": replace(one, uncertainty=None),
        "a regressor of second degree": replace(one, plant=curved, uncertainty=None),
        "several inputs": Problem(
            plant=several,
            reference_model=ReferenceModel(k_0=[[1.0, 0.0], [0.5, 1.0]]),
            reference=[Sine(1.0, 0.7), Sine(0.5, 1.9)],
        ),
        "an unknown input gain": replace(one, input_gain=(0.5, 2.0)),
        "limits of the input": replace(one, plant=replace(plant, input=PlantInput(saturation=[-0.8, 0.8]))),
        "a delay": replace(one, plant=replace(plant, input=PlantInput(delay=0.02))),
    }


def _of_the_output() -> dict[str, TrackingProblem]:
    one = OutputProblem(
        plant=OutputPlant(num=[2.0], den=[1.0, 1.0]),
        reference_model=OutputReferenceModel(num=[3.0], den=[1.0, 3.0]),
        reference=Sine(1.0, 0.7),
    )
    return {
        "one output": one,
        "limits of the input": replace(one, plant=replace(one.plant, input=PlantInput(saturation=[-0.8, 0.8]))),
        "a delay": replace(one, plant=replace(one.plant, input=PlantInput(delay=0.02))),
    }


Check = Callable[[Any, Any], str]
"""What looks at a controller on a problem: a sentence, or CheckFailed."""


def _checks(problem: TrackingProblem) -> Iterator[Check]:
    yield _traces
    if problem.delay == 0:
        yield _agrees_with_scipy
    yield _is_alone_what_it_is_among_others
    yield _rests_in_a_freeze
    yield _has_the_bits_of_its_export


def _traces(problem: TrackingProblem, controller: Controller) -> str:
    """Its equations on numbers and on symbols."""
    check_controller(controller, problem)
    return "its equations say the same on numbers and on symbols"


def _agrees_with_scipy(problem: TrackingProblem, controller: Controller) -> str:
    """The kernel's run against SciPy's integration of the lines themselves."""
    runs = [simulate(problem, [controller], replace(SIMULATION, dt=SIMULATION.dt / k))[controller.name] for k in (1, 2)]
    if any(run.diverged_at is not None for run in runs):
        return f"it diverges at t = {runs[0].diverged_at or runs[1].diverged_at:.3g} s, and is not compared with SciPy"
    found, finer = (_ends(run.loop, run.states[-1]) for run in runs)
    expected = _integrated(problem, controller)
    size = max(1.0, float(np.abs(expected).max()))
    apart, step = float(np.abs(found - expected).max()), float(np.abs(found - finer).max())
    if not apart <= AGREEMENT_FLOOR * size + AGREEMENT_FACTOR * step:
        raise CheckFailed(
            f"after {SIMULATION.t_end:g} s its run differs by {apart:.2g} from SciPy's integration, where half the step "
            f"changes it by {step:.2g}: does limit move states of which derivative knows nothing?"
        )
    return f"its run is what SciPy integrates, to {apart:.1g} at states up to {size:.2g}"


def _ends(loop: ClosedLoop, flat: Array) -> Array:
    """x, x_m and the controller's own state, of a flat state of the loop."""
    state = loop.unpack(flat)
    return np.concatenate([state.x, state.x_m, flatten((state.controller, np.zeros(0)))])


def _integrated(problem: TrackingProblem, controller: Controller) -> Array:
    """The same at the end by SciPy, from the equations' own lines: nothing of the loop and its kernel takes part."""
    equations: Any = bound(problem, controller)
    sampled = isinstance(equations, SampledEquations)
    own, T = equations.initial(), equations.sample_time if sampled else SIMULATION.t_end
    x, x_m, held_model = problem.dynamics.x0, problem.model.x0, problem.model.x0
    before, u = None, None
    for k in range(round(SIMULATION.t_end / T)):
        t = k * T
        if sampled:
            if before is not None:
                held_model = _flow(lambda _, z, r=before.r: problem.model.derivative(z, r), held_model, (t - T, t))
            now = Sample(problem.dynamics.output(x), problem.model.output(held_model), _command(problem, t))
            own = own if before is None else equations.advance(own, before, u, now)
            before, u = now, np.asarray(equations.control(own, *now))
        x, x_m, own = _moved(problem, equations, (x, x_m, own), (t, t + T), u if sampled else None)
    if sampled:
        return np.concatenate([x, x_m, flatten((own, np.zeros(0)))])
    return np.concatenate([x, x_m, flatten((equations.limit(own), np.zeros(0)))])


def _moved(problem: TrackingProblem, equations: Any, start: Any, span: tuple[float, float], held: Array | None) -> Any:
    """Plant, model and a continuous controller over a span of time; ``held`` is a sampled controller's control."""
    flat = np.asarray(flatten(start), dtype=float)

    def rates(t: float, z: Array) -> Array:
        (x, x_m, own), r = unflatten(start, z, 0)[0], _command(problem, t)
        own = own if held is not None else equations.limit(own)
        y, y_m = problem.dynamics.output(x), problem.model.output(x_m)
        u = np.asarray(equations.control(own, y, y_m, r)) if held is None else held
        own_rates = (
            equations.derivative(own, y, y_m, r, u) if held is None else unflatten(own, 0 * flatten((own, np.zeros(0))), 0)[0]
        )
        v = u if problem.known.saturation is None else np.clip(u, *problem.known.saturation)
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
    """An ensemble's members have the bits of single runs; of state feedback, whose plants can start elsewhere."""
    if not isinstance(problem, Problem):
        members = [(problem, controller)] * 2
    else:
        members = [
            (replace(problem, plant=replace(problem.plant, x0=s * problem.plant.x0)), controller) for s in (1.0, -0.5, 2.0)
        ]
    together = simulate_ensemble(members, SIMULATION).metrics.max_abs_e
    alone = [simulate(one, [controller], SIMULATION)[controller.name].metrics.max_abs_e[0] for one, _ in members]
    if not np.array_equal(together, np.array(alone), equal_nan=True):
        raise CheckFailed("a member of an ensemble is another run than it is alone: something is remembered outside the state")
    return "the members of an ensemble have the bits of single runs"


def _sampled(problem: TrackingProblem, controller: Controller) -> Controller:
    """It, as a flight computer runs it."""
    if isinstance(bound(problem, controller), SampledEquations):
        return controller
    return Sampled(controller=controller, sample_time=SAMPLE_TIME, discretization="euler")


def _rests_in_a_freeze(problem: TrackingProblem, controller: Controller) -> str:
    """What its roles call estimates and memory keeps its bits where the freeze switch is on, from whatever state."""
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
    """The exported C in the loop, sample by sample, where this machine has a compiler."""
    try:
        require_compiler()
    except InputError as error:
        return f"the exported C was not compared: {error}"
    sampled = _sampled(problem, controller)
    origin = simulate(problem, [sampled], SIMULATION)[sampled.name]
    if origin.diverged_at is not None:
        return f"sampled every {SAMPLE_TIME:g} s it diverges, and its export was not compared"
    found = simulate_export(problem, sampled, SIMULATION)
    if found.refused:
        raise CheckFailed(f"the exported C refuses {found.refused} of its samples")
    if differs := found.differs_from(origin):
        raise CheckFailed(f"the exported C is not the simulation: {differs}")
    return "the exported C has the bits of the simulation"
