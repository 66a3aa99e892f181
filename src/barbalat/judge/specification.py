"""What a design must meet."""

from __future__ import annotations

from dataclasses import dataclass, fields

from barbalat import validate
from barbalat.settings import Settings, one_line
from barbalat.validate import InputError


@dataclass(frozen=True, kw_only=True)
class Specification(Settings):
    """What a design must meet; at least one of these is given.

    settling   of a step of the command's size, into the judge's band around where the model comes to rest [s]
    overshoot  beyond where the model comes to rest, as a share of the step
    u_max      largest |u| that is demanded, before the limits
    delay      added to the plant's, which the loop tolerates without oscillating [s]
    gain       the input's effectiveness is multiplied by factors from 1/gain to gain, which the loop tolerates
    noise      largest RMS of what measurement noise does to u, as a share of the largest |u| without noise
    """

    settling: float | None = None
    overshoot: float | None = None
    u_max: float | None = None
    delay: float | None = None
    gain: float | None = None
    noise: float | None = None

    __repr__ = one_line

    def __post_init__(self) -> None:
        given = [one.name for one in fields(self) if getattr(self, one.name) is not None]
        if not given:
            raise InputError.of("specification", f"must ask for one of {', '.join(one.name for one in fields(self))}")
        for name in given:
            value = validate.number(f"specification.{name}", getattr(self, name))
            if value < 0 or (value == 0 and name != "overshoot"):
                raise InputError.of(f"specification.{name}", f"must be positive, got {value:g}")
            object.__setattr__(self, name, value)
        if self.gain is not None and self.gain <= 1:
            raise InputError.of("specification.gain", f"must be a factor above 1, such as 1.5, got {self.gain:g}")
