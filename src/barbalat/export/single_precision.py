"""The effect of 32-bit numbers at a high gain: the gain above which the compiled export deviates from the simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.budget import Progress
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.certificates import Certificates
from barbalat.export.compiler import require_compiler
from barbalat.export.in_the_loop import simulate_export
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.open_numbers.numbers import in_object
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedObjects
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

VISIBLE_SHARE = 0.01
"""Fraction of the largest |x| that is visible in a plot; rounding to 24 bits changes each number by far less, 6e-8."""
DECADES = 8
"""Largest number of decades above the gain of the case, or below it if the two runs already differ there; more than 24 bits can
resolve."""
GAINS = ("gamma", "covariance0")
"""The names of the laws' initial gains."""
HALVINGS = 3
"""Number of bisections of the decade in which the deviation becomes visible: the gain is found within a factor of 10^(1/8) =
1.33."""


@dataclass(frozen=True, kw_only=True)
class PrecisionLimit:
    """The gain at which float32 and float64 differ visibly, for one controller.

    setting  name of the gain, and its value in the case
    apart    by tried gain, the largest difference of the plant's state divided by its largest value
    at       the lowest tried gain at which the runs differ visibly; None if there is none
    diverges  the lowest tried gain at which the simulation in 64 bits diverges; None if there is none
    """

    setting: str
    gain: float
    apart: dict[float, float]
    at: float | None
    diverges: float | None

    @property
    def sentence(self) -> str:
        """The difference between the two runs, as a sentence."""
        own = self.apart.get(self.gain)
        here = "" if own is None else f"at {self.setting} = {self.gain:g} they differ by {own:.2g} of the largest |x|"
        if self.at is not None:
            where = f"at {self.setting} = {self.at:.3g}"
            return f"{here}; {where} they differ by more than {VISIBLE_SHARE:g} of the largest |x|".lstrip("; ")
        ends = "" if self.diverges is None else f"; at {self.diverges:.3g} the 64-bit simulation itself diverges"
        where = f"up to {self.setting} = {max(self.apart, default=self.gain):.3g}"
        return f"{here}; {where} they differ by at most {VISIBLE_SHARE:g} of the largest |x|{ends}".lstrip("; ")


def precision_limit(
    problem: TrackingProblem, controller: Controller, simulation: Simulation, *, progress: Progress | None = None
) -> PrecisionLimit:
    """Simulate at increasing gains, with the 32-bit export in the loop and without it.

    Raises InputError for a controller without a gain, and as ``simulate_export`` does.
    """
    found = next((one for one in in_object(controller, ()) if one[0][-1] in GAINS), None)
    if found is None:
        raise InputError(f"{controller.name} has no scalar gain (gamma or covariance0)")
    keys, gain = found
    varied = VariedObjects.around(problem, controller, simulation, (FieldPath(("controller", 0, *keys)),))
    apart: dict[float, float] = {}
    diverges: list[float] = []

    def parts(value: float) -> bool:
        difference = _difference(problem, varied.at([value]).controllers[0], simulation)
        if difference is None:
            diverges.append(value)
            return False
        apart[value] = difference
        if progress is not None:
            progress(min(1.0, len(apart) / (DECADES + HALVINGS)))
        return difference > VISIBLE_SHARE

    steps = _upwards(gain) if not parts(gain) else _downwards(gain)
    last, at = gain, gain if apart.get(gain, 0.0) > VISIBLE_SHARE else None
    for value in steps:
        parted = parts(value)
        if value in diverges:
            break
        if parted != (at is not None):
            low, high = sorted((last, value))
            at = _between(low, high, parts)
            break
        last, at = value, value if parted else None
    return PrecisionLimit(
        setting=str(FieldPath(keys)),
        gain=gain,
        apart=dict(sorted(apart.items())),
        at=at,
        diverges=min(diverges, default=None),
    )


def _upwards(gain: float) -> Iterator[float]:
    return (gain * 10.0**k for k in range(1, DECADES + 1))


def _downwards(gain: float) -> Iterator[float]:
    return (gain * 10.0**-k for k in range(1, DECADES + 1))


def _between(low: float, high: float, parts: Callable[[float], bool]) -> float:
    """The upper end of a narrower range; at this end the two runs differ visibly."""
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if parts(middle) else (middle, high)
    return high


def _difference(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> float | None:
    """The largest difference of the plant's state, divided by its largest value; None if the run in 64 bits diverges."""
    (origin,) = simulate(problem, [controller], simulation).values()
    if origin.diverged_at is not None:
        return None
    made = simulate_export(problem, controller, simulation, float32=True).result
    if made.diverged_at is not None or len(made.states) != len(origin.states):
        return float("inf")
    loop = ClosedLoop.of(problem, controller)
    x = loop.unpack(np.arange(loop.size)).x.reshape(-1)
    return float(np.abs(made.states[:, x] - origin.states[:, x]).max() / np.abs(origin.states[:, x]).max())


def with_float32_gains(
    certificates: Certificates,
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    *,
    progress: Progress | None = None,
) -> Certificates:
    """The certificates of the sampled controllers with ``gamma_float32``; raises InputError if there is no C compiler or no such
    controller."""
    require_compiler("a float32 export must run on this machine")
    sampled = [one for one in controllers if ClosedLoop.of(problem, one).sampled]
    if not sampled:
        raise InputError("--float32 needs a sampled controller, and this case has none: give one a sample_time")
    result = {}
    for i, controller in enumerate(sampled):
        certificate = certificates[controller.name]
        part = None if progress is None else _share(progress, i, len(sampled))
        try:
            found = precision_limit(problem, controller, simulation, progress=part)
        except InputError as error:
            unmeasured = certificate.with_entries(certificate.entries, f"float32 was not compared with float64: {error}")
            result[controller.name] = unmeasured
            continue
        result[controller.name] = _with(certificate, found)
    return certificates.with_changed(result)


def _share(progress: Progress, i: int, count: int) -> Progress:
    def told(done: float) -> None:
        progress((i + done) / count)

    return told


def _with(certificate: Certificate, found: PrecisionLimit) -> Certificate:
    said = (
        f"measured when this case is simulated, by comparing the compiled 32-bit export with the 64-bit simulation: "
        f"{found.sentence}"
    )
    if found.at is None:
        return certificate.with_entries(certificate.entries, said)
    measured = Draft()
    measured.estimate({"gamma_float32": found.at}, f"gamma_float32 was {said}")
    return certificate.with_entries((*certificate.entries, *measured.entries.values()))
