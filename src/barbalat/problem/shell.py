"""The code around a sampled controller on a flight computer. It decides which samples are used and what acts without them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from barbalat import validate
from barbalat.settings import Settings, one_line
from barbalat.validate import InputError, freeze

Fallback = Literal["hold", "zero", "baseline", "fade"]
LEAST_BAND = 1e-3
"""Smallest jitter as a fraction of the sample time: the error of a microsecond clock at 1 ms."""
WIDEST_BAND = 0.5
"""Jitter must be below this fraction of the sample time. At the midpoint between two multiples the intended one is ambiguous."""
MOST_SAMPLES = 10**8
"""Longest outage or fade in samples. It is three years at a sample per second and far within the range of a long in C."""


CHECKS = ("range", "rate", "stuck")
"""The checks that are set for each measured channel."""
OF_COMMANDS = ("range", "rate")
"""The settings that may also be given for commands."""


@dataclass(frozen=True, kw_only=True)
class Shell(Settings):
    """Which measurements, commands and sample times a controller accepts, and what acts after an outage. Every key is optional.

    range    for each measured channel, the accepted [lowest, highest] value, in the channel's unit. A value outside is a miss.
             The command channel is called command, or command_1, command_2, ...; a command outside its range is replaced by the
             last good command
    rate     for each measured channel, the fastest accepted change since the last good sample, in the channel's unit per second;
             for a command, since the last good command
    stuck    for each measured channel, how long it may repeat exactly the same value [s]; after that it is a miss until it
             changes. Off by default, because a quantised sensor repeats its value at a standstill
    jitter   largest deviation of the time between two calls from the sample time, as a fraction of it. A call within this
             tolerance is punctual. If a call comes after a whole number of sample times, each missing call is a miss; after any
             other time the fallback acts. Requires longest_outage. Without jitter a wrong time is only reported in the status
    longest_outage  how long consecutive misses may last before the fallback acts [s]; no limit by default. In the exported C a
             sample whose result is out of range is a miss as well
    fallback  what acts then. "hold" holds the last control, "zero" sets it to zero, and "fade" fades it to zero. "baseline" is
              the case's fixed controller alone, with the last good measurement, the present command and held states
    fade     duration of that fade, of the transition to the baseline, and of the bumpless return of the control after a fallback
             [s]; by default the longest outage. The return fade pauses while samples are lost. If calls came at wrong times for
             at most the longest outage, the return takes no longer than these calls did

    On a miss the estimates are frozen, the last good measurement and the last control are held, and model, predictor and filters
    continue; an observer predicts the state without the measurement. Raises InputError.
    """

    range: Mapping[str, list[float]] = field(default_factory=dict)
    rate: Mapping[str, float] = field(default_factory=dict)
    stuck: Mapping[str, float] = field(default_factory=dict)
    jitter: float | None = None
    longest_outage: float | None = None
    fallback: Fallback = "hold"
    fade: float | None = None

    __repr__ = one_line

    def __post_init__(self) -> None:
        for name in CHECKS:
            if not isinstance(getattr(self, name), Mapping):
                raise InputError.of(
                    f"shell.{name}", f"must give a number for each named channel, got {validate.show(getattr(self, name))}"
                )
        ranges = {str(key): _pair(f"shell.range.{key}", value) for key, value in self.range.items()}
        rates = {str(key): validate.positive(f"shell.rate.{key}", value) for key, value in self.rate.items()}
        stuck = {str(key): validate.positive(f"shell.stuck.{key}", value) for key, value in self.stuck.items()}
        freeze(self, range=ranges, rate=rates, stuck=stuck)
        if self.fallback not in get_args(Fallback):
            raise InputError.of("shell.fallback", f"must be hold, zero, baseline or fade, got {validate.show(self.fallback)}")
        if self.longest_outage is not None:
            freeze(self, longest_outage=validate.not_negative("shell.longest_outage", self.longest_outage))
        if self.fade is not None:
            freeze(self, fade=validate.not_negative("shell.fade", self.fade))
        if self.jitter is not None:
            freeze(self, jitter=validate.positive("shell.jitter", self.jitter))
        self._require_together()

    @property
    def checks_samples(self) -> bool:
        """Whether it may reject a measurement or a command because of its value."""
        return any(getattr(self, name) for name in CHECKS)

    def _require_together(self) -> None:
        """Raise InputError for keys that require another key."""
        if self.jitter is not None and not LEAST_BAND <= self.jitter < WIDEST_BAND:
            limits = f"from {LEAST_BAND:g} to below {WIDEST_BAND:g}"
            raise InputError.of("shell.jitter", f"must be a fraction of the sample time {limits}, got {self.jitter:g}")
        if self.longest_outage is None:
            given = {"jitter": self.jitter is not None, "fallback": self.fallback != "hold", "fade": self.fade is not None}
            for name, there in given.items():
                if there:
                    raise InputError.of(f"shell.{name}", "needs shell.longest_outage, which is missing")

    def require(self, names: tuple[str, ...], commands: tuple[str, ...], *, without_baseline: str | None) -> None:
        """Raise InputError for a missing baseline, and for a channel that is not among the measured ``names`` or, where commands
        are allowed, the ``commands``."""
        if self.fallback == "baseline" and without_baseline is not None:
            raise InputError.of("shell.fallback", f"= 'baseline' {without_baseline}: use hold, zero or fade")
        for field_name in CHECKS:
            known = (*names, *commands) if field_name in OF_COMMANDS else names
            twice = [key for key in getattr(self, field_name) if known.count(key) > 1]
            if twice:
                raise InputError.of(
                    f"shell.{field_name}.{twice[0]}", "is the name of several channels; give each channel a unique label"
                )
            wrong = "names neither a measured channel nor a command" if known != names else "does not name a measured channel"
            for key in getattr(self, field_name):
                if key not in known:
                    raise InputError.of(f"shell.{field_name}.{key}", f"{wrong}; the names are {', '.join(known)}")

    def repeats(self, name: str, T: float) -> int | None:
        """Return the number of successive samples of length T [s] in which a channel may repeat its value; None for any number.

        Raises InputError for a time below T.
        """
        if name not in self.stuck:
            return None
        found = _samples(f"stuck.{name}", self.stuck[name], T)
        if not found:
            raise InputError.of(f"shell.stuck.{name}", f"must be at least the sample time of {T:g} s, got {self.stuck[name]:g} s")
        return found

    def samples(self, T: float) -> tuple[int, int]:
        """Return the longest outage and the fade in samples of length T [s]. Raises InputError if there are too many to count."""
        assert self.longest_outage is not None
        fade = self.longest_outage if self.fade is None else self.fade
        return _samples("longest_outage", self.longest_outage, T), _samples("fade", fade, T)


def _samples(name: str, time: float, T: float) -> int:
    if time / T > MOST_SAMPLES:
        raise InputError.of(f"shell.{name}", f"must be at most {MOST_SAMPLES:g} samples of {T:g} s, got {time:g} s")
    return int(time / T * (1 + 1e-9) + 1e-9)


def _pair(name: str, value: object) -> list[float]:
    low, high = validate.vector(name, value, 2).tolist()
    if not low < high:
        raise InputError.of(name, f"must be [lowest, highest], got {validate.show(value)}")
    return [low, high]
