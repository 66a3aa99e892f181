"""The arguments of an identification other than its recording: all are checked against the names and the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.identify.recording import Recording
from barbalat.validate import Array, InputError


def bounds_by_name(field: str, given: Mapping[str, float] | None, names: Sequence[str]) -> dict[str, float] | None:
    """A positive number for each output."""
    if given is None:
        return None
    if unknown := [name for name in given if name not in names]:
        raise InputError.of(field, f"names {validate.show(unknown[0])}, which is not an output{validate.hint(unknown[0], names)}")
    found = {}
    for name in names:
        if name not in given:
            raise InputError.of(field, f"must have a bound for every output, but has none for {validate.show(name)}")
        found[name] = validate.number(f"{field} of {name}", given[name])
        if found[name] < 0 or (field == "slope" and found[name] == 0):
            raise InputError.of(f"{field} of {name}", f"must be positive, got {found[name]:g}")
    return found


def require_slopes(recording: Recording, noise: Mapping[str, float], slope: Mapping[str, float]) -> None:
    """Raise InputError if two samples differ by more than noise and slope allow."""
    for i, name in enumerate(recording.output_names):
        moved, h = np.abs(np.diff(recording.outputs[:, i])), np.diff(recording.times)
        allowed = (slope[name] * h + 2 * noise[name]) * (1 + 1e-9) + 1e-12 * np.abs(recording.outputs[:-1, i])
        if (moved > allowed).any():
            k = int(np.argmax(moved - allowed))
            least, at = (moved[k] - 2 * noise[name]) / h[k], f"at t = {recording.times[k]:g} s"
            raise InputError.of(
                f"slope of {name}",
                f"is {slope[name]:g}, but even allowing for their noise the data change by at least {least:.4g} per second {at}",
            )


@dataclass(frozen=True, eq=False)
class Structure:
    """Prior knowledge of the rows.

    given   (n,) which rows are given exactly
    start   (n, p) the known coefficients, with 0 elsewhere
    free    (n, p) which coefficients are searched
    limits  (n, p, 2) bounds of the coefficients, infinite if there are none
    """

    given: Array
    start: Array
    free: Array
    limits: Array

    @classmethod
    def of(
        cls,
        recording: Recording,
        derivatives: Mapping[str, str],
        within: Mapping[tuple[str, str], tuple[float, float]],
    ) -> Structure:
        """The structure of these rows; raises InputError for names and bounds that are wrong."""
        names = (*recording.output_names, *recording.input_names)
        n, p = len(recording.output_names), len(names)
        given, start = np.zeros(n, dtype=bool), np.zeros((n, p))
        for state, rate in derivatives.items():
            for name in (state, rate):
                if name not in recording.output_names:
                    near = validate.hint(name, recording.output_names)
                    raise InputError.of("derivatives", f"names {validate.show(name)}, which is not an output{near}")
            i = recording.output_names.index(state)
            given[i], start[i, names.index(rate)] = True, 1.0
        limits = np.broadcast_to([-np.inf, np.inf], (n, p, 2)).copy()
        for (state, name), ends in within.items():
            if state not in recording.output_names or name not in names:
                raise InputError.of("within", f"names {validate.show(f'{state}.{name}')}, which is not a coefficient")
            low, high = validate.vector(f"within of {state}.{name}", ends, 2)
            if low > high:
                raise InputError.of(f"within of {state}.{name}", f"must begin with its lower end, got {low:g} and {high:g}")
            limits[recording.output_names.index(state), names.index(name)] = low, high
        known = (limits[:, :, 0] == limits[:, :, 1]) & ~given[:, None]
        start[known] = limits[known][:, 0]
        return cls(given, start, ~known & ~given[:, None], limits)

    def about(self, reference: Array) -> Structure:
        """The structure for deviations from a reference (p,), with a constant term in each unknown row."""
        constant = np.where(self.given, self.start @ reference, 0.0)
        unbounded = np.broadcast_to([-np.inf, np.inf], (len(self.given), 1, 2))
        return Structure(
            self.given,
            np.column_stack([self.start, constant]),
            np.column_stack([self.free, ~self.given]),
            np.concatenate([self.limits, unbounded], axis=1),
        )
