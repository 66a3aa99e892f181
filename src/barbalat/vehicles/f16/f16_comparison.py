"""Controllers on JSBSim's F-16, side by side: what is said and shown of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.validate import Array
from barbalat.vehicles.compared import Compared, Failing
from barbalat.vehicles.f16.airframe import INTEGRATOR, STEP
from barbalat.vehicles.f16.axis import SAMPLE_TIME, Axis
from barbalat.vehicles.f16.failures import FAILS_AT, NONE, Failure
from barbalat.vehicles.f16.flight import TIMING, Flight, columns_of, figures_of
from barbalat.vehicles.f16.flying import DELAY_STEP, MOST_DELAY_STEPS
from barbalat.vehicles.scene import Mover, Scene, attitudes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIRE = tuple(
    np.array(line, dtype=float)
    for line in (
        [(1.5, 0, 0), (-1.2, 0, 0)],
        [(0.3, 0, 0), (-0.7, 1, 0), (-0.9, 0, 0), (-0.7, -1, 0), (0.3, 0, 0)],
        [(-0.8, 0, 0), (-1.3, 0, 0.6), (-1.2, 0, 0)],
    )
)
"""A fuselage, a wing, a fin: forward, left, up."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FlightComparison(Compared):
    """All flights of some controllers through some failures.

    jsbsim    its version
    flights   for each controller those through all failures, in their order
    delays    the largest added delay that each kept control with [s], by name; None where nobody asked
    exported  whether the exported C flew
    """

    name: str
    axis: Axis
    failures: tuple[Failure, ...]
    jsbsim: str
    flights: tuple[tuple[Flight, ...], ...]
    delays: dict[str, float] | None = None
    exported: bool = False

    @property
    def headline(self) -> str:
        return f"{self.name} at {self.axis.trim.condition}: RMS error of the followed rate [deg/s] after each failure"

    @property
    def columns(self) -> dict[str, str]:
        return columns_of(self.axis.followed)

    @property
    def units(self) -> dict[str, str]:
        return figures_of(self.axis.followed)

    @property
    def headings(self) -> tuple[str, ...]:
        return ("RMS e\n[deg/s]", "max |e|\n[deg/s]", "n_z\n[g]", "alpha\n[deg]", "surface\n[deg/s]")

    def cells(self, figures: dict[str, float | None]) -> list[str]:
        surface = f"{self.axis.followed.surface}_travel"
        error, largest, low, high, alpha, travel = (
            "-" if figures[name] is None else f"{figures[name]:.2f}"
            for name in ("rms_e", "max_abs_e", "n_z_min", "n_z_max", "alpha_max", surface)
        )
        return [error, largest, f"{low} to {high}", alpha, travel]

    @property
    def notes(self) -> tuple[str, ...]:
        return (
            f"After the failure, which comes at {FAILS_AT:g} s and stays; e is the followed rate less that "
            "of the model to follow, alpha its largest value, surface how far that moves in a second",
            "each of the project's schemes has the setting that one rule gives on the linearised aircraft, and none is tuned on "
            "flights: these are ranked",
        )

    def facts(self) -> list[tuple[str, str]]:
        trim = self.axis.trim
        alpha, elevator = np.rad2deg([trim.alpha, trim.elevator])
        modes = "; ".join(f"{name} {_mode(values)}" for name, values in trim.modes().items() if values)
        return [
            ("trim", f"{trim.condition}: alpha {alpha:.2f} deg, elevator {elevator:.2f} deg, throttle {trim.throttle:.2f}"),
            ("modes", f"{modes} [1/s]"),
            (
                "computed",
                f"JSBSim {self.jsbsim}, {INTEGRATOR}, {1 / STEP:g} Hz; control at {1 / SAMPLE_TIME:g} Hz, {TIMING.duration:g} s",
            ),
        ]

    def details(self) -> dict[str, Any]:
        trim, axis = self.axis.trim, self.axis
        A, b = axis.model
        return {
            "condition": {"altitude_ft": trim.condition.altitude, "mach": trim.condition.mach},
            "trim": {
                "speed_ft_s": trim.speed,
                "alpha_deg": float(np.rad2deg(trim.alpha)),
                "elevator_deg": float(np.rad2deg(trim.elevator)),
                "throttle": trim.throttle,
            },
            "modes": {name: [[value.real, value.imag] for value in values] for name, values in trim.modes().items()},
            "design": {"A": A.tolist(), "b": b.tolist(), "gain": axis.gain.tolist(), "A_m": axis.A_m.tolist(), "k_0": axis.k_0},
            "equipment": asdict(axis.equipment),
            "simulation": {
                "simulator": f"JSBSim {self.jsbsim}", "integrator": INTEGRATOR, "dt": STEP, "sample_time": SAMPLE_TIME,
                "t_end": TIMING.duration, "fails_at": FAILS_AT,
            },
        }  # fmt: skip

    @property
    def longest_delay(self) -> float:
        return MOST_DELAY_STEPS * DELAY_STEP

    @property
    def shown(self) -> str:
        return "Followed rate, angles, load factor and surface of every controller"

    def figure(self, failure: Failing, *, narrow: bool = False, shown: bool = False) -> Figure:
        from barbalat.vehicles.f16.picture import figure_of

        found = [flight for several in self.flights for flight in several if flight.failure == failure]
        return figure_of(found, narrow=narrow, shown=shown)

    def scene(self, failure: Failing, controllers: Sequence[str]) -> Scene | None:
        chosen = [
            (i, flight)
            for i, several in enumerate(self.flights)
            for flight in several
            if flight.failure == failure and flight.controller in controllers and len(flight.record) > 1
        ]
        if not chosen:
            return None
        movers = [
            Mover(label=one.controller, colour=i, path=_path(one), attitude=_attitude(one), lost=bool(one.lost))
            for i, one in chosen
        ]
        t = max((one.column("t") for _, one in chosen), key=len)
        return Scene(
            title=failure.meaning, unit="ft", t=t, target=None, movers=tuple(movers), wire=WIRE, fails=FAILS_AT,
            failing=failure != NONE, equal=False,
        )  # fmt: skip


def _path(flight: Flight) -> Array:
    """(K, 3): north, west, altitude [ft]. Who pitches stays in one plane, but for what the earth's rotation turns him aside."""
    aside = -flight.column("east") if flight.followed.attitude == "phi" else np.zeros(len(flight.record))
    return np.column_stack([flight.column("north"), aside, flight.column("altitude")])


def _attitude(flight: Flight) -> Array:
    """The nose goes up about the axis to the right and right about the axis down, the negative ones of those here."""
    pitch = flight.column("pitch")
    if flight.followed.attitude == "theta":
        return attitudes(np.zeros(len(pitch)), -pitch, np.zeros(len(pitch)))
    return attitudes(flight.column("bank"), -pitch, -flight.column("heading"))


def _mode(values: list[complex]) -> str:
    first = values[0]
    return f"{first.real:.3g} +- {abs(first.imag):.3g}j" if first.imag else ", ".join(f"{one.real:.3g}" for one in values)
