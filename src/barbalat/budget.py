"""Budgets: the memory and time of a piece of work are estimated before anything of its size is built.

Each number that sets a size has a cost function, here or in the file that does the work: it returns an ``Estimate``, from costs
per unit that were measured once. The estimates are accurate to within a small factor and are the same on every machine, so a
faster machine or more memory does not change what is rejected. Seconds are seconds of one core.

    with Budget.parse("16GiB,5h"):
        simulate(problem, controllers, simulation)
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Self, TypeVar

from barbalat.validate import InputError, positive, show

Given = TypeVar("Given")
Found = TypeVar("Found")

KIB, MIB, GIB = 2.0**10, 2.0**20, 2.0**30
MINUTE, HOUR, DAY, YEAR = 60.0, 3600.0, 86400.0, 365.25 * 86400.0
DEFAULT_MEMORY, DEFAULT_SECONDS = 4 * GIB, HOUR
TOLD_SECONDS = 10.0
"""Work that is expected to take longer than this [s] is announced, so the user knows that it is running."""
LARGEST_TRIED = 10**30
"""A larger number is replaced by this one before its cost is evaluated: this one already exceeds every budget, and its powers do
not overflow."""


@dataclass(frozen=True)
class Estimate:
    """The cost of a piece of work, by order of magnitude: memory [bytes] and seconds of one core."""

    memory: float = 0.0
    seconds: float = 0.0

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(self.memory + other.memory, self.seconds + other.seconds)

    def times(self, count: float) -> Estimate:
        """The cost of ``count`` such pieces of work in sequence, with all results kept."""
        return Estimate(self.memory * count, self.seconds * count)


@dataclass(frozen=True)
class Budget:
    """The largest memory [bytes] and time [s of one core] that the estimate of a piece of work may reach. It is in force inside a
    ``with`` statement.

    memory   4 GiB by default
    seconds  an hour by default
    told     called with a sentence for the user before work that is expected to take more than a few seconds
    """

    memory: float = DEFAULT_MEMORY
    seconds: float = DEFAULT_SECONDS
    told: Callable[[str], None] | None = None
    announced: list[float] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        positive("budget.memory", self.memory)
        positive("budget.seconds", self.seconds)

    @classmethod
    def parse(cls, text: str, told: Callable[[str], None] | None = None) -> Self:
        """A budget from text, "16GiB", "5h", or both separated by a comma; an omitted part has its default."""
        given: dict[str, float] = {}
        for part in text.split(","):
            found = QUANTITY.fullmatch(part.strip())
            what, unit = UNITS.get(found[2].lower(), ("", 0.0)) if found else ("", 0.0)
            if found is None or not what or what in given:
                raise InputError(f"--budget must be a memory, a time or both, such as 16GiB,5h, got {show(text)}")
            given[what] = positive(f"--budget {part.strip()}", float(found[1]) * unit)
        return cls(**given, told=told)

    def __enter__(self) -> Self:
        _IN_FORCE.set((*_IN_FORCE.get(), self))
        return self

    def __exit__(self, *_: object) -> None:
        _IN_FORCE.set(_IN_FORCE.get()[:-1])

    def allows(self, cost: Estimate) -> bool:
        """Whether the cost is within both limits."""
        return cost.memory <= self.memory and cost.seconds <= self.seconds

    def tell(self, what: str, cost: Estimate) -> None:
        """Announce work of more than a few seconds, unless it is part of work that was already announced."""
        if self.told is None or cost.seconds <= max([TOLD_SECONDS, *self.announced]):
            return
        self.announced.append(cost.seconds)
        memory = f" and {in_bytes(cost.memory)} of memory" if cost.memory >= GIB / 4 else ""
        self.told(f"{what}: estimated at about {in_time(cost.seconds)} of computing{memory}")


QUANTITY = re.compile(r"(\d+(?:\.\d*)?(?:e\d{1,2})?)\s*([a-z]+)", re.IGNORECASE)
UNITS = {
    "kib": ("memory", KIB),
    "mib": ("memory", MIB),
    "gib": ("memory", GIB),
    "tib": ("memory", 2.0**40),
    "kb": ("memory", 1e3),
    "mb": ("memory", 1e6),
    "gb": ("memory", 1e9),
    "tb": ("memory", 1e12),
    "s": ("seconds", 1.0),
    "min": ("seconds", MINUTE),
    "h": ("seconds", HOUR),
    "d": ("seconds", DAY),
}
"""The units that ``--budget`` accepts, in lower case."""

_IN_FORCE: ContextVar[tuple[Budget, ...]] = ContextVar("budgets in force", default=())
_DEFAULT = Budget()


def in_force() -> Budget:
    """The innermost budget around the caller, or the default budget."""
    return (_IN_FORCE.get() or (_DEFAULT,))[-1]


def carried(work: Callable[[Given], Found]) -> Callable[[Given], Found]:
    """Return the function in a form that other threads can call under the budget that is in force here."""
    budgets = _IN_FORCE.get()

    def inside(given: Given) -> Found:
        token = _IN_FORCE.set(budgets)
        try:
            return work(given)
        finally:
            _IN_FORCE.reset(token)

    return inside


def require(
    name: str,
    value: int,
    cost: Callable[[float], Estimate],
    *,
    least: int = 1,
    given: str | None = None,
    fits: Callable[[int], str] | None = None,
    what: str | None = None,
) -> None:
    """Raise InputError if a number makes work exceed the budget; the message gives the largest number that fits.

    name   the field with which the message begins
    cost   the cost of the work as a function of the number; it must not decrease
    least  the smallest meaningful number
    given  how the value is shown, by default "= 12"; ``fits`` formats the largest number that fits, by default "at most 7"
    what   what to announce if the work takes more than a few seconds (see ``Budget.tell``); nothing by default
    """
    budget, at = in_force(), min(value, LARGEST_TRIED)
    expected = cost(at)
    if budget.allows(expected):
        if what is not None:
            budget.tell(what, expected)
        return
    shown = f"= {show(value)}" if given is None else given
    beyond = [f"{in_bytes(expected.memory)} of memory"] if expected.memory > budget.memory else []
    beyond += [f"{in_time(expected.seconds)} of computing"] if expected.seconds > budget.seconds else []
    most = largest(lambda n: budget.allows(cost(n)), least, at)
    would_do = "" if most is None else f"{f'at most {most}' if fits is None else fits(most)} would do; "
    raise InputError.of(
        name,
        f"{shown} would take about {' and '.join(beyond)}, more than the budget of {in_bytes(budget.memory)} and "
        f"{in_time(budget.seconds)}: {would_do}--budget (in Python Budget) raises it",
    )


def largest(fitting: Callable[[int], bool], least: int, beyond: int) -> int | None:
    """The largest number, at least ``least``, that fits, where ``beyond`` does not fit; None if ``least`` does not fit either."""
    if not fitting(least):
        return None
    within = least
    while beyond - within > 1:
        middle = (within + beyond) // 2
        within, beyond = (middle, beyond) if fitting(middle) else (within, middle)
    return within


def in_bytes(count: float) -> str:
    """A memory size as text: 512 MiB, 4 GiB, 7.3 TiB."""
    for size, unit in ((2.0**40, "TiB"), (GIB, "GiB"), (MIB, "MiB"), (KIB, "KiB")):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count:.0f} bytes"


def in_time(seconds: float) -> str:
    """A duration as text: 40 s, 3 min, 5 h, 2 days, 300 years."""
    for size, unit in ((2 * YEAR, "years"), (2 * DAY, "days"), (HOUR, "h"), (2 * MINUTE, "min")):
        if seconds >= size:
            return f"{seconds / {'years': YEAR, 'days': DAY, 'h': HOUR, 'min': MINUTE}[unit]:.3g} {unit}"
    return f"{seconds:.3g} s"


# Costs of work whose size is set in several packages, measured on one core of an AMD EPYC (Zen 5) with CPython 3.11.

STATE_OPERATIONS = 50
"""Operations of a Runge-Kutta step of order four, with metrics, for each state of a loop: 31 for a network's neurons, 48 with
least squares, 75 with monomials as regressor, 110 with Gaussian functions."""
DENSE_OPERATIONS = 24
"""Operations of such a step for each entry of a plant's matrix: four stages, a product and a sum, in plant, model and law."""
OPERATION_SECONDS, OPERATION_BYTES = 1e-4, 3500.0
"""The cost of tracing, optimising and compiling one operation; measured: 3.2 s and 280 MB for 40,000 operations, 35 s and 800 MB
for 220,000."""
MODES_SECONDS = 3e-8
"""Seconds per cube of the number of states for the eigenvalues of four Jacobians: 7 s for 600 states."""
LINEARISATION_SECONDS, LINEARISATION_BYTES = 4e-7, 1500.0
"""Seconds per cube, and bytes per square, of the number of states: 12 s and 0.3 GB for 300 states."""
CERTIFICATE_SECONDS = 0.3
"""Seconds for a small loop's certificate; the time grows with the square of the number of states."""
KERNEL_BYTES, KERNEL_SECONDS = 1e6, 0.05
"""The cost of the smallest loop's code."""
STEP_OPERATION_SECONDS = 6e-10
"""Seconds for one operation in a step of a single run: 0.2 us for the 323 operations of a small L1 loop, 24 us for 40,000
operations."""
MEMBER_OPERATION_SECONDS = 2e-11
"""Seconds for one operation in a step of an ensemble's member, which is one lane of a vector: 3 ns for the 323 operations of the
same small loop."""


def operations(states: float, dense: float = 0.0) -> float:
    """Return the operations of one step of a loop with ``states`` states, of which ``dense`` belong to a plant."""
    return STATE_OPERATIONS * states + DENSE_OPERATIONS * dense * dense


def of_kernel(states: float, dense: float = 0.0) -> Estimate:
    """The cost of a loop apart from its steps: tracing, optimising and compiling its equations, and computing its modes after the
    run."""
    count = operations(states, dense)
    seconds = KERNEL_SECONDS + OPERATION_SECONDS * count + MODES_SECONDS * states**3
    return Estimate(KERNEL_BYTES + OPERATION_BYTES * count, seconds)


def of_linearisation(states: float) -> Estimate:
    """The cost of the equilibrium, the modes and the margins of a linearised loop."""
    return Estimate(KERNEL_BYTES + LINEARISATION_BYTES * states**2, LINEARISATION_SECONDS * states**3)


def of_certificate(states: float) -> Estimate:
    """The cost of one controller's bounds, norms and margins for a plant with this number of states, measured up to twenty."""
    return Estimate(KERNEL_BYTES, CERTIFICATE_SECONDS * (1 + states**2 / 10))


Progress = Callable[[float], None]
"""A callback that is called with the fraction done, in [0, 1]."""


def part_of(progress: Progress | None, start: float, width: float) -> Progress | None:
    """A callback for a part of the work: it reports the part's progress to ``progress``, in the range from ``start`` to ``start +
    width``."""
    return None if progress is None else lambda fraction: progress(start + width * fraction)
