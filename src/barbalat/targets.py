"""What commands require of a case in addition to what simulation requires. The requirements are declared here, checked by the
commands and shown in the docs.

A scheme itself declares which plants it does not support (``Scheme.beyond``) and, by its ``knobs``, which settings are tuned; the
protocols of a signal determine how a page represents it. Classes from outside the package can declare the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from barbalat.controllers.settings import beyond_of
from barbalat.controllers.tuning_grid import OutputTunable, Tunable
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import InterpolatedSignal
from barbalat.signals.smooth import Continuous
from barbalat.validate import InputError


@dataclass(frozen=True)
class Need:
    """A requirement of a target on a problem.

    words      its text in a table
    met        whether the problem meets it
    otherwise  what the target needs, as the error says it if the problem does not meet the requirement
    """

    words: str
    met: Callable[[TrackingProblem], bool]
    otherwise: str


MEASURED_STATE = Need(
    "a measured state",
    lambda problem: isinstance(problem, Problem),
    "a plant whose state is measured, but this case measures an output",
)
KNOWN_SET = Need(
    "a known set",
    lambda problem: isinstance(problem, Problem) and problem.uncertainty is not None,
    "the known set, that is, the ranges of the plant's parameters: give the parameters in [parameters] a tolerance, or give "
    "uncertainty.lower and .upper, or .center and .radius",
)
NO_CLOCK = Need(
    "a plant without t in its terms",
    lambda problem: not problem.depends_on_time,
    "a plant without t in its equations, because an exported plant has no clock",
)


@dataclass(frozen=True, kw_only=True)
class Target:
    """A command, or one of its options, that does not accept every case.

    command  the command as it is typed
    called   the target's name in sentences
    problem  the target's requirements on the problem
    sampled  whether controllers must be sampled, by definition or with a sample_time
    tunable  whether a scheme must declare its tuned settings; a scheme that does not is left out, with a message
    """

    command: str
    called: str
    problem: tuple[Need, ...] = ()
    sampled: bool = False
    tunable: bool = False

    def require(self, problem: TrackingProblem) -> None:
        """Raise InputError for a problem that the target does not accept."""
        for need in self.problem:
            if not need.met(problem):
                raise InputError(f"{self.called} needs {need.otherwise}")


EXPORT = Target(command="export", called="an export", sampled=True)
EXPORTED_LOOP = Target(command="export --closed-loop", called="an exported loop", problem=(NO_CLOCK,), sampled=True)
IN_THE_LOOP = Target(command="run --sil", called="software in the loop", sampled=True)
CONTEST = Target(command="contest", called="a contest", problem=(MEASURED_STATE, KNOWN_SET), tunable=True)
DESIGN = Target(command="design", called="a design", problem=CONTEST.problem, tunable=True)
TRADE_OFF = Target(command="tradeoff", called="the trade-off", problem=(MEASURED_STATE, KNOWN_SET), tunable=True)
TUNE = Target(command="tune without --vary", called="a search over the settings of a scheme", tunable=True)

TARGETS = (EXPORT, EXPORTED_LOOP, IN_THE_LOOP, CONTEST, DESIGN, TRADE_OFF, TUNE)
"""All targets that do not accept every case. ``run``, ``certify``, ``sweep``, ``explore`` and ``tune`` with --vary accept every
case."""


def require_sampled(name: str, *, sampled: bool) -> None:
    """Raise InputError for a controller that does not act at samples if a target requires samples."""
    if not sampled:
        raise InputError(
            f"{name} is continuous, but a flight computer needs a sampled controller: give it a sample_time [s] in its "
            "[[controller]] table, or wrap it as Sampled(controller=..., sample_time=...)"
        )


def require_continuous_reading(problem: TrackingProblem, instead: str) -> None:
    """Raise InputError for a case whose measurements no continuous controller can use; the message ends with what to do
    ``instead``."""
    sensor = problem.surroundings.sensor
    quantized = sensor is not None and sensor.quantization is not None
    what = "[[faults]]" if problem.faults else "sensor.quantization" if quantized else None
    if what is not None:
        raise InputError(f"the controllers that are compared are continuous, but {what} needs sampled controllers: {instead}")


def is_tunable(scheme: object) -> bool:
    """Whether a scheme, or its class, declares which of its settings are tuned."""
    return isinstance(scheme, (Tunable, OutputTunable))


IN_PAGES = {
    "formula": "its formula; its numbers have sliders",
    "points": "its points, up to 20,000",
    "rows": "its values, with at most 20,000 changes",
}
"""What a page stores of a signal."""


def in_pages(signal: object) -> str:
    """How a page of ``explore`` represents a signal, or a class of signals: by its formula, its points, or a table of values."""
    kind = signal if isinstance(signal, type) else type(signal)
    kind = getattr(kind, "makes", kind)  # the signal that a file format such as ``mat`` stands for
    if hasattr(kind, "interpolation_points") or isinstance(signal, InterpolatedSignal):
        return "points"
    return "formula" if issubclass(kind, Continuous) else "rows"


def left_out(scheme: type) -> str:
    """Sentences on what a scheme does not support and which targets do not accept it; empty if everything is supported."""
    beyond = beyond_of(scheme)
    said = [f"Does not support plants with {' or '.join(beyond)}."] if beyond else []
    of_output = getattr(scheme, "feedback", "state") == "output"
    closed = [one for one in TARGETS if (one.tunable and not is_tunable(scheme)) or (of_output and MEASURED_STATE in one.problem)]
    if closed:
        *first, last = (one.command for one in closed)
        said.append(f"Not for {', '.join(first)}{' and ' if first else ''}{last}.")
    return " ".join(said)
