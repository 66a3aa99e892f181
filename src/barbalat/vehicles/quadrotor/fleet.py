"""The quadrotor as a campaign flies it: its figure of eight, on vehicles that are drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass

from barbalat.run.sampled_step import SampledList
from barbalat.vehicles.drawing import Draw, Drawing, Fleet, Flying
from barbalat.vehicles.quadrotor.axes import Axes
from barbalat.vehicles.quadrotor.comparison import chosen_failures, nominal_axes, scheme_on
from barbalat.vehicles.quadrotor.control import Control, Scheme
from barbalat.vehicles.quadrotor.dispersions import DRAWN, UNITS, Dispersion
from barbalat.vehicles.quadrotor.failures import Failure
from barbalat.vehicles.quadrotor.flying import fly_all
from barbalat.vehicles.quadrotor.schemes import TUNED, available, require_known
from barbalat.vehicles.timing import Timing

TIMING = Timing(duration=13.0, fails_at=8.0)
"""What fails does so as the figure of eight has come up to its speed; most of an eight follows."""


@dataclass(frozen=True, eq=False, kw_only=True)
class QuadrotorFleet(Fleet):
    """The schemes' operations on all axes of the nominal vehicle, which is all that they know of one."""

    failures: tuple[Failure, ...]
    axes: Axes
    schemes: tuple[Scheme, ...]

    @property
    def controllers(self) -> tuple[str, ...]:
        return tuple(one.name for one in self.schemes)

    @property
    def conditions(self) -> tuple[str, ...]:
        return ("near the ground",)

    def described(self) -> list[dict[str, object]]:
        return [asdict(one) for one in self.failures]

    def contents(self) -> Iterator[bytes]:
        for scheme in self.schemes:
            lists = [one for one in (*scheme.attitude, *scheme.position) if isinstance(one, SampledList)]
            yield repr((scheme.name, [(one.program, one.initial.tolist()) for one in lists])).encode()
        yield self.axes.hover.A.tobytes() + self.axes.hover.B.tobytes()
        yield repr([one.gain.tolist() for one in (*self.axes.attitude, *self.axes.position)]).encode()

    def flying(self) -> Callable[[Draw, int], Flying]:
        controls = [Control(self.axes, scheme) for scheme in self.schemes]

        def fly(draw: Draw, number: int) -> Flying:
            dispersion = Dispersion(**draw, number=number)
            for control in controls:
                for flight in fly_all(self.axes, control, self.failures, dispersion, TIMING):
                    figures = flight.figures
                    yield flight.controller, flight.failure.name, figures | {"travel": figures["rotor_travel"]}

        return fly


def _prepared(schemes: Sequence[str] | None, failures: Sequence[str] | None) -> QuadrotorFleet:
    wanted = available() if schemes is None else list(schemes)
    require_known(wanted)
    chosen, axes = chosen_failures(failures), nominal_axes()
    return QuadrotorFleet(failures=chosen, axes=axes, schemes=tuple(scheme_on(axes, name) for name in dict.fromkeys(wanted)))


DRAWING = Drawing(
    drawn=DRAWN,
    units=UNITS,
    timing=TIMING,
    simulator="mujoco",
    error_unit="m",
    moved=("rotors", "N/s"),
    beside=("Geometric, integral", "integral"),
    set_by="one rule for all (benchmarks/flight_tuning.py): on each linearised axis least RMS error with half of the delay "
    "margin that the feedback has alone and a gain margin of 1.5",
    numbers=TUNED,
    prepare=_prepared,
    chunk=56,
)
