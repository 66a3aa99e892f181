"""A budget before work: what a size would take of memory and time, estimated before anything of that size is built.

Every number that sets a size has a cost function here or beside the code that it sizes: from the number to an ``Estimate``, with
fixed costs per unit, each measured once. They are right within a factor of a few, and the same on every machine: how fast a
machine is, or how much memory it has, changes nothing of what is refused. Seconds are those of one core.

    with Budget.parse("16GiB,5h"):
        simulate(problem, controllers, simulation)
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Self

from barbalat.validate import InputError, positive, show

KIB, MIB, GIB = 2.0**10, 2.0**20, 2.0**30
MINUTE, HOUR, DAY, YEAR = 60.0, 3600.0, 86400.0, 365.25 * 86400.0
DEFAULT_MEMORY, DEFAULT_SECONDS = 4 * GIB, HOUR
TOLD_SECONDS = 10.0
"""From here on a person would wonder whether anything happens, and is told what is expected."""
LARGEST_TRIED = 10**30
"""Where the cost of a larger number is taken: it is beyond every budget, and its powers are still floats."""


@dataclass(frozen=True)
class Estimate:
    """What a piece of work takes, by order of magnitude: memory [bytes] and seconds of one core."""

    memory: float = 0.0
    seconds: float = 0.0

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(self.memory + other.memory, self.seconds + other.seconds)

    def times(self, count: float) -> Estimate:
        """So many of them, one after the other, all kept."""
        return Estimate(self.memory * count, self.seconds * count)


@dataclass(frozen=True)
class Budget:
    """The memory [bytes] and the seconds of one core that work may take by its estimate; in force inside a ``with`` statement.

    memory   4 GiB by default
    seconds  an hour by default
    told     takes a sentence for the person who waits, before work that is expected to take more than a few seconds
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
        """A budget as a person writes it: "16GiB", "5h", or both with a comma between; what is left out is as by default."""
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
        """Whether neither limit is exceeded."""
        return cost.memory <= self.memory and cost.seconds <= self.seconds

    def tell(self, what: str, cost: Estimate) -> None:
        """Announce work of more than a few seconds, unless it is a part of what was announced before."""
        if self.told is None or cost.seconds <= max([TOLD_SECONDS, *self.announced]):
            return
        self.announced.append(cost.seconds)
        memory = f" and {in_bytes(cost.memory)} of memory" if cost.memory >= GIB / 4 else ""
        self.told(f"{what}: about {in_time(cost.seconds)} of computing{memory} by estimate")


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
"""What ``--budget`` takes, by the text in small letters."""

_IN_FORCE: ContextVar[tuple[Budget, ...]] = ContextVar("budgets in force", default=())
_DEFAULT = Budget()


def in_force() -> Budget:
    """The innermost budget around the caller; the default one where there is none."""
    return (_IN_FORCE.get() or (_DEFAULT,))[-1]


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
    """InputError where a number makes work beyond the budget, with the largest number that would do.

    name   of the field, with which the sentence begins
    cost   of the work for a number; it must not fall where the number grows
    least  the smallest number that would mean anything
    given  how the value is shown, by default "= 12"; and ``fits``, how the number that would do is, by default "at most 7"
    what   is announced where it takes more than a few seconds, see ``Budget.tell``; nothing by default
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
    """The largest number from ``least`` on that fits, where ``beyond`` does not; None where ``least`` does not either."""
    if not fitting(least):
        return None
    within = least
    while beyond - within > 1:
        middle = (within + beyond) // 2
        within, beyond = (middle, beyond) if fitting(middle) else (within, middle)
    return within


def in_bytes(count: float) -> str:
    """A memory as it is read: 512 MiB, 4 GiB, 7.3 TiB."""
    for size, unit in ((2.0**40, "TiB"), (GIB, "GiB"), (MIB, "MiB"), (KIB, "KiB")):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count:.0f} bytes"


def in_time(seconds: float) -> str:
    """A time as it is read: 40 s, 3 min, 5 h, 2 days, 300 years."""
    for size, unit in ((2 * YEAR, "years"), (2 * DAY, "days"), (HOUR, "h"), (2 * MINUTE, "min")):
        if seconds >= size:
            return f"{seconds / {'years': YEAR, 'days': DAY, 'h': HOUR, 'min': MINUTE}[unit]:.3g} {unit}"
    return f"{seconds:.3g} s"


# What pieces of work cost that several rooms size; measured on one core of an AMD EPYC (Zen 5) with CPython 3.11.

STATE_OPERATIONS = 50
"""Of a Runge-Kutta step of order four, figures included, for each state of a loop: 31 of a network's neurons, 48 with
least squares, 75 with monomials as a regressor, 110 with Gaussian functions."""
DENSE_OPERATIONS = 24
"""Of such a step for each entry of a plant's matrix: four stages, a product and a sum, in the plant, its model and its law."""
OPERATION_SECONDS, OPERATION_BYTES = 1e-4, 3500.0
"""Of tracing, optimising and compiling one operation: 3.2 s and 280 MB for 40,000, 35 s and 800 MB for 220,000."""
MODES_SECONDS = 3e-8
"""For each cubed state: the eigenvalues of four Jacobians, 7 s for 600 states."""
LINEARISATION_SECONDS, LINEARISATION_BYTES = 4e-7, 1500.0
"""For each cubed and each squared state: 12 s and 0.3 GB for 300 states."""
CERTIFICATE_SECONDS = 0.3
"""Of a small loop's certificate; it grows with the square of the states."""
KERNEL_BYTES, KERNEL_SECONDS = 1e6, 0.05
"""Of the smallest loop's code."""
STEP_OPERATION_SECONDS = 6e-10
"""Of one operation in a step of a run by itself: 0.2 us for the 323 of a small L1 loop, 24 us for 40,000."""
MEMBER_OPERATION_SECONDS = 2e-11
"""The same of a member in an ensemble, which is one lane of a vector: 3 ns for the 323 of that loop."""


def operations(states: float, dense: float = 0.0) -> float:
    """Return the operations of one step of a loop with so many states, of which ``dense`` are a plant's."""
    return STATE_OPERATIONS * states + DENSE_OPERATIONS * dense * dense


def of_kernel(states: float, dense: float = 0.0) -> Estimate:
    """What a loop costs beside its steps: its equations are traced, optimised and compiled; after the run come its modes."""
    count = operations(states, dense)
    seconds = KERNEL_SECONDS + OPERATION_SECONDS * count + MODES_SECONDS * states**3
    return Estimate(KERNEL_BYTES + OPERATION_BYTES * count, seconds)


def of_linearisation(states: float) -> Estimate:
    """What the place of rest, the modes and the margins of a linearised loop cost."""
    return Estimate(KERNEL_BYTES + LINEARISATION_BYTES * states**2, LINEARISATION_SECONDS * states**3)


def of_certificate(states: float) -> Estimate:
    """What the bounds, norms and margins of one controller cost for a plant of so many states, measured up to twenty."""
    return Estimate(KERNEL_BYTES, CERTIFICATE_SECONDS * (1 + states**2 / 10))


Progress = Callable[[float], None]
"""Called with the fraction done, in [0, 1]."""


def part_of(progress: Progress | None, start: float, width: float) -> Progress | None:
    """What tells ``progress`` of a part of the work, from ``start`` to ``start + width``."""
    return None if progress is None else lambda fraction: progress(start + width * fraction)
