"""The F-16 as a campaign flies it: one axis at three conditions in turns, on aircraft that are drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial

from barbalat.run.sampled_step import SampledList
from barbalat.vehicles.drawing import Draw, Drawing, Fleet, Flying
from barbalat.vehicles.f16.airframe import CONDITIONS
from barbalat.vehicles.f16.axis import Axis
from barbalat.vehicles.f16.comparison import axis_of, chosen_failures, lists_of
from barbalat.vehicles.f16.dispersions import DRAWN, UNITS, Dispersion
from barbalat.vehicles.f16.failures import Failure
from barbalat.vehicles.f16.flying import fly_once
from barbalat.vehicles.f16.schemes import TUNED, available, require_known
from barbalat.vehicles.timing import Timing

TIMING = Timing(duration=15.0, fails_at=5.0)
"""What fails does so as the first command is reversed; another command follows."""


@dataclass(frozen=True, eq=False, kw_only=True)
class F16Fleet(Fleet):
    """An axis, and the schemes' operations on it, at each of ``CONDITIONS``."""

    failures: tuple[Failure, ...]
    axes: tuple[Axis, ...]
    lists: tuple[tuple[SampledList, ...], ...]

    @property
    def controllers(self) -> tuple[str, ...]:
        return tuple(one.name for one in self.lists[0])

    @property
    def conditions(self) -> tuple[str, ...]:
        return tuple(str(axis.trim.condition) for axis in self.axes)

    def described(self) -> list[dict[str, object]]:
        return [asdict(one) for one in self.failures]

    def contents(self) -> Iterator[bytes]:
        for axis, lists in zip(self.axes, self.lists, strict=True):
            yield repr([(one.name, one.program, one.initial.tolist()) for one in lists]).encode()
            yield axis.trim.A.tobytes() + axis.trim.B.tobytes()

    def flying(self) -> Callable[[Draw, int], Flying]:
        steps = [[one.step() for one in lists] for lists in self.lists]

        def fly(draw: Draw, number: int) -> Flying:
            dispersion, which = Dispersion(**draw, number=number), number % len(self.axes)
            axis = self.axes[which]
            for step in steps[which]:
                for failure in self.failures:
                    flight = fly_once(axis, step, failure, dispersion, TIMING)
                    figures = flight.figures
                    yield flight.controller, failure.name, figures | {"travel": figures[f"{axis.followed.surface}_travel"]}

        return fly


def _prepared(name: str, schemes: Sequence[str] | None, failures: Sequence[str] | None) -> F16Fleet:
    wanted = available() if schemes is None else list(schemes)
    chosen = chosen_failures(name, failures)
    require_known(wanted)
    axes = tuple(axis_of(name, condition) for condition in CONDITIONS)
    return F16Fleet(failures=chosen, axes=axes, lists=tuple(tuple(lists_of(axis, wanted)) for axis in axes))


def drawing_of(name: str) -> Drawing:
    """Of one of the F-16's axes, by the flight's name."""
    return Drawing(
        drawn=DRAWN,
        units=UNITS,
        timing=TIMING,
        simulator="jsbsim",
        error_unit="deg/s",
        moved=("surface", "deg/s"),
        beside=("LQR with PI", "PI"),
        set_by="one rule for all (benchmarks/flight_tuning.py): least RMS error on the linearised aircraft with a delay margin "
        "of 0.1 s and a gain margin of 2",
        numbers=TUNED[name],
        prepare=partial(_prepared, name),
        chunk=256,
    )
