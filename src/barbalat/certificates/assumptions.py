"""The assumptions of certificates, each checked on the case: the signals that act on the plant, the initial estimates, the known
set."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from barbalat.certificates import theorems
from barbalat.certificates.entry import Assumption
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import EstimateSet
from barbalat.problem.measurement import Sensor
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import BoundedSignal, SettlingSignal

FROZEN_LAW = (
    "gamma_max and step_max freeze the state or the regressor in the plain adaptive law: they are estimates, not guarantees"
)
LINEAR_LOOP_ONLY = "margins are exact for the named linear loop, not for the adaptive loop in motion"
FREQUENCIES_TRIED = (
    "mu is exact at the frequencies tried (a grid, the critical frequencies, and each refined peak), not between them"
)
BEYOND_ONE_LINEAR_INPUT = (
    "conditions, and margins that hold for any state, are known only for one input with phi(x) = x and a known gain, but this "
    "plant is not of that kind"
)
ON_THE_BOX = "|phi(x)| is bounded if every |x_i| is at most the sum of the bounds on the model's state and on e"
ERROR_ASSUMED = "this assumes |e| <= nu_0/sqrt(Gamma), which is not proven for this scheme"

OUTSIDE_THE_SET = "theta outside the known set"

THE_CASE_S = Assumption("theta and the input gain are those given in the case")
"""This holds by construction of a sampled linear loop, whose bounds are for no other plant of the known set."""

START_TOGETHER = Assumption("x_m(0) = x(0), and the predictor also starts there")
"""This holds by construction: the model and every predictor start at the plant's x0."""


ACTS_CONTINUOUSLY = Assumption("the controller acts in continuous time", theorem=theorems.SAMPLED)
"""For a sampled controller, nothing is claimed that depends on this assumption (see ``schemes/sampled.py``)."""


def beyond_the_paper(problem: Problem) -> bool:
    """Whether the plant has several inputs, a regressor other than x or an unknown gain: ``BEYOND_ONE_LINEAR_INPUT``."""
    return problem.plant.inputs > 1 or not problem.plant.is_linear or problem.input_gain is not None


def nominal(problem: TrackingProblem, *, gain_adapted: bool = False, acting: Assumption | None = None) -> tuple[Assumption, ...]:
    """The plant is (1) without additions, nothing else acts on it, and the command belongs to the class that is tracked.

    ``acting`` replaces the assumption on the signals that act on the plant.
    """
    plant = exact_plant(problem, gain_adapted=gain_adapted), acting or undisturbed(problem), measured(problem)
    return *plant, bounded_command(problem), START_TOGETHER, ACTS_CONTINUOUSLY


def of_linear_loop(*assumptions: Assumption) -> tuple[Assumption, ...]:
    """The same assumptions for a linear loop, which needs other theorems without them than an adaptive loop."""
    return tuple(replace(one, theorem=theorems.of_linear_loop(one.theorem)) for one in assumptions)


def exact_plant(problem: TrackingProblem, *, gain_adapted: bool = False) -> Assumption:
    """No dynamics, limits or delay before the plant; with ``gain_adapted`` the scheme supports any input gain."""
    known = not gain_adapted and (not isinstance(problem, Problem) or problem.input_gain is None)
    found = [departure for path in problem.plant.paths for departure in _on_the_way(path, known)]
    if isinstance(problem, Problem) and problem.derived is not None and problem.derived.unmatched:
        found.append((problem.derived.unmatched, theorems.UNMATCHED_RESTS))
    return _without_departures("the plant is (1): matched uncertainty, no unmodelled dynamics, no delay or limits", found)


def _without_departures(sentence: str, found: Iterable[tuple[str, str]]) -> Assumption:
    """An assumption that is broken by deviations, each described in a few words, with the theorem that would cover them."""
    listed = dict.fromkeys(found)
    return Assumption(sentence, ", ".join(dict.fromkeys(word for word, _ in listed)), theorems.joined(t for _, t in listed))


NO_FAULTS = Assumption("every sample arrives as it was measured", "the case has faults; see the notes")
EVERY_SAMPLE = Assumption("the shell uses every sample", "the shell may reject samples; see the notes")
WHOLE_RANGES = Assumption(
    "the known set contains every theta that the parameters' ranges allow",
    "the parameter ranges exceed the set given in the case; see the notes",
)
"""The assumptions that the simulated loop or the declared ranges do not satisfy, so guarantees hold for the design only."""


def unmet_by(problem: TrackingProblem) -> list[Assumption]:
    """The assumptions that restrict a case's guarantees to its design, apart from its [truth]."""
    derived = problem.derived if isinstance(problem, Problem) else None
    unmet = [NO_FAULTS] if problem.faults else []
    if problem.shell is not None and problem.shell.checks_samples:
        unmet.append(EVERY_SAMPLE)
    if derived is not None and derived.outside:
        unmet.append(WHOLE_RANGES)
    if derived is not None and derived.around:
        moved = f"the parameters' ranges change {', '.join(derived.around)}"
        unmet.append(Assumption("the input paths, the sensor and the initial state are as declared", moved))
    return unmet


def undisturbed(problem: TrackingProblem) -> Assumption:
    """Only u acts on the plant."""
    acts = [
        ("disturbance", problem.disturbance is not None),
        ("unmatched disturbance", bool(problem.unmatched)),
        ("disturbance at the output", problem.output_disturbance is not None),
    ]
    theorem = theorems.DISTURBANCE if problem.output_disturbance is None else theorems.OUTPUT_DISTURBANCE
    return Assumption("no disturbance acts", ", ".join(word for word, there in acts if there), theorem)


def measured(problem: TrackingProblem) -> Assumption:
    """The state is measured exactly."""
    if problem.fixed_observer is not None:
        return Assumption("the state is measured exactly", "the state is an observer's estimate", theorems.OBSERVER)
    return Assumption("the state is measured exactly", ", ".join(_of_the_sensor(problem.sensor)), theorems.MEASUREMENT)


def bounded_command(problem: TrackingProblem) -> Assumption:
    """The command is bounded, which every statement on boundedness requires."""
    known = all(isinstance(command, BoundedSignal) for command in problem.commands)
    return Assumption("r is bounded", "" if known else "r has no known bound", theorems.BOUNDED_COMMAND)


def constant_in_the_end(problem: TrackingProblem) -> Assumption:
    """The command and disturbance of the case become constant, which is required by convergence results that are proven only for
    constant signals."""
    acting = {"r": problem.commands, "d": () if problem.disturbance is None else (problem.disturbance,)}
    said = {
        name: [one.settles if isinstance(one, SettlingSignal) else None for one in signals] for name, signals in acting.items()
    }
    varying = [f"{name} never becomes constant" for name, settle in said.items() if False in settle]
    unknown = [
        f"{name} does not declare whether it becomes constant"
        for name, settle in said.items()
        if None in settle and False not in settle
    ]
    return Assumption("r and d are constant from some time on", " and ".join(varying + unknown))


def projected_onto(problem: Problem, known_set: EstimateSet) -> Assumption:
    """Theta is in the set onto which the estimates are projected; theta_hat(0) is in it by construction."""
    return Assumption(
        "theta and theta_hat(0) lie in the known set, and the estimates are projected onto it",
        "" if known_set.contains(problem.parameters) else OUTSIDE_THE_SET,
        theorems.THETA_OUTSIDE,
    )


def theta_in_the_set(problem: Problem) -> Assumption:
    """The case's theta is in the known set, so statements for every theta in the set apply to it."""
    known_set = problem.uncertainty
    outside = known_set is not None and not known_set.contains(problem.plant.theta)
    return Assumption("theta lies in the known set", OUTSIDE_THE_SET if outside else "", theorems.THETA_OUTSIDE)


MEAN_SQUARE = (
    "bounded, with the mean square of e of the order of Delta, for every sufficiently small Delta; the limit is not computed"
)


def small_enough(present: str) -> Assumption:
    """The modelling error of the case, if any, is small enough; the threshold is not known."""
    return Assumption(
        "the modelling error of the case is small enough",
        f"{present}: whether it is small enough is not known" if present else "",
    )


def departures(problem: TrackingProblem) -> tuple[str, ...]:
    """The differences between the plant of the case and (1), each in a few words."""
    return tuple(found.broken for found in (exact_plant(problem), undisturbed(problem), measured(problem)) if found.broken)


def _on_the_way(path: PlantInput, gain_known: bool) -> list[tuple[str, str]]:
    found = []
    if path.delay > 0:
        found.append((f"delay {path.delay:g} s", theorems.DELAY))
    if path.saturation is not None:
        found.append(("saturation", theorems.LIMITS))
    if path.rate_limit is not None:
        found.append(("rate limit", theorems.LIMITS))
    if path.quantization is not None:
        found.append(("quantization", theorems.QUANTIZATION))
    if path.actuator is not None:
        found.append(("actuator", theorems.ACTUATOR))
    if path.multiplicative is not None:
        found.append(("unmodelled dynamics Delta_m", theorems.UNMODELLED))
    if path.gain != 1 and gain_known:
        found.append((f"input gain {path.gain:g}, unknown to the controller", theorems.INPUT_GAIN))
    return found


def _of_the_sensor(sensor: Sensor | None) -> list[str]:
    found = []
    if sensor is not None and sensor.lag > 0:
        found.append(f"sensor lag {sensor.lag:g} s")
    if sensor is not None and sensor.noise is not None:
        found.append("measurement noise")
    if sensor is not None and sensor.quantization is not None:
        found.append("a quantised measurement")
    return found
