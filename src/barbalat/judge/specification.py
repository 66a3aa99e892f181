"""The specification of a design."""

from __future__ import annotations

from dataclasses import dataclass, fields

from barbalat import validate
from barbalat.settings import Settings, one_line
from barbalat.validate import InputError


@dataclass(frozen=True, kw_only=True)
class Specification(Settings):
    """The requirements on a design; at least one must be given.

    settling   settling time into the judge's band around the model's steady state [s], for the worse of two steps: the first step
               of the command, from rest, and its largest step
    overshoot  overshoot beyond the model's steady state, as a fraction of the step, for the worse of these two steps
    u_max      largest demanded |u|, before the limits
    error      largest |e| of the judged state under the command of the case, in the unit of this state
    delay      additional delay at the plant's input that the loop tolerates without oscillation [s]
    gain       the loop tolerates factors from 1/gain to gain on the input's effectiveness
    noise      largest RMS, over these two steps, of the effect of measurement noise on u, as a fraction of the largest |u|
               without noise
    """

    settling: float | None = None
    overshoot: float | None = None
    u_max: float | None = None
    error: float | None = None
    delay: float | None = None
    gain: float | None = None
    noise: float | None = None

    __repr__ = one_line

    def __post_init__(self) -> None:
        given = [one.name for one in fields(self) if getattr(self, one.name) is not None]
        if not given:
            raise InputError.of("specification", f"must contain at least one of {', '.join(one.name for one in fields(self))}")
        for name in given:
            value = validate.number(f"specification.{name}", getattr(self, name))
            if value < 0 or (value == 0 and name != "overshoot"):
                raise InputError.of(f"specification.{name}", f"must be positive, got {value:g}")
            object.__setattr__(self, name, value)
        if self.gain is not None and self.gain <= 1:
            raise InputError.of("specification.gain", f"must be a factor above 1, such as 1.5, got {self.gain:g}")
