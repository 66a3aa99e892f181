"""The page to read first: what a signal, a controller and a scheme's equations are.

A user writes a ``Controller``: its settings. ``bind`` joins them with what is known of the plant and gives the
``Equations``, which read like the paper and compute with plain NumPy functions. The same lines are evaluated on numbers
(tests, exploration) and on CasADi's arrays (from which machine code, C and Jacobians are made), so they must not branch on
values: ``np.where``, ``np.clip``, ``np.minimum`` do that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

if TYPE_CHECKING:
    from barbalat.validate import Array

Value = Any
"""A number, a NumPy array, or a CasADi array that behaves like one."""


@runtime_checkable
class Signal(Protocol):
    """A function of time [s] that drives the loop; ``t`` and the result are arrays of one shape."""

    def __call__(self, t: Array) -> Array:
        """The value at t; at a jump, the value after it."""
        ...

    def before(self, t: Array) -> Array:
        """The limit from the left; differs from the value only at a jump. The last stage of a step asks for this."""
        ...


@runtime_checkable
class BreakingSignal(Signal, Protocol):
    """A signal that jumps, or of which a derivative does; one that does not say so is taken as smooth."""

    def breaks(self, start: float, stop: float) -> Array:
        """The instants [s] in (start, stop) at which that happens, (K,); the same ones whatever the interval."""
        ...


@runtime_checkable
class BoundedSignal(Signal, Protocol):
    """A signal with a guaranteed bound, which certificates need; all signals of the package have one."""

    @property
    def bound(self) -> float:
        """A number that |value| never exceeds."""
        ...


@runtime_checkable
class SlopedSignal(Signal, Protocol):
    """A signal that tells how fast it may change, which bounds between a controller's samples need; all of the package do."""

    @property
    def slope(self) -> float:
        """A number that |change per second| never exceeds where the signal does not jump."""
        ...


@runtime_checkable
class SettlingSignal(Signal, Protocol):
    """A signal that tells whether it is constant from some time on; of one that does not say so, nothing is known."""

    @property
    def settles(self) -> bool:
        """Whether it keeps one value from some time on."""
        ...


@runtime_checkable
class InterpolatedSignal(Signal, Protocol):
    """A signal that is linear between points and constant outside them: pages keep the points instead of its equations."""

    @property
    def interpolation_points(self) -> tuple[Array, Array]:
        """The times [s], increasing, and the values there, both (K,)."""
        ...


class Dynamics(Protocol):
    """What a loop integrates of a plant or of a model."""

    @property
    def x0(self) -> Array:
        """The state at t = 0, (n,)."""
        ...

    def derivative(self, x: Value, v: Value) -> Value:
        """x' for the input v: what reaches a plant, a model's command."""
        ...

    def output(self, x: Value) -> Value:
        """What is measured, or what that is to follow: (n,), or a scalar."""
        ...


class Equations(Protocol):
    """A scheme bound to a plant's known part. The state is a NamedTuple of arrays that has a field ``theta_hat``, (p,).

    Its p estimates need not be the problem's parameters: they may be a network's weights, or (0,) where nothing is estimated.
    """

    def initial(self) -> NamedTuple:
        """The state at t = 0, in numbers."""
        ...

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        """The control u, a scalar, from the plant's and the model's state, both (n,), and the command.

        Where only the output is fed back, y and y_m, scalars, stand in the place of the states.
        """
        ...

    def derivative(self, state: Any, x: Value, x_m: Value, r: Value, u: Value) -> NamedTuple:
        """d/dt of the state; ``u`` is what ``control`` commands now: before the plant's limits, gain, dynamics and delay.

        What reaches the plant is not known to a controller. One that knows its actuator's limits, ``known.saturation``, computes
        what they leave of u itself.
        """
        ...

    def limit(self, state: Any) -> NamedTuple:
        """The state with the estimates limited to the known set; applied at every stage of every solver."""
        ...


@runtime_checkable
class Bending(Protocol):
    """A part of a law or a plant whose rate has a corner where the motion takes it: a step across it keeps second order only."""

    @property
    def bend(self) -> str | None:
        """Where the corner is, in a few words; ``None`` where it has none."""
        ...


@runtime_checkable
class Jumping(Protocol):
    """A part of a law whose rate, or whose state, jumps where the motion takes it: a step across it keeps first order only."""

    @property
    def jump(self) -> str:
        """Where it jumps, in a few words."""
        ...


class Sample(NamedTuple):
    """What a sampled controller measures at one instant."""

    x: Value  # (n,), or the output y
    x_m: Value  # its own reference model's, from sample to sample under a held command
    r: Value


@runtime_checkable
class SampledEquations(Protocol):
    """A controller that acts every ``sample_time`` and holds its control in between. The state as of ``Equations``."""

    @property
    def sample_time(self) -> float:
        """The time between two samples [s]."""
        ...

    def initial(self) -> NamedTuple:
        """The state at t = 0, in numbers."""
        ...

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        """The control from now to the next sample."""
        ...

    def advance(self, state: Any, before: Sample, u: Value, now: Sample) -> NamedTuple:
        """The state at this sample, from that at the one before; since then u, the command before the limits, was held."""
        ...


@runtime_checkable
class Freezable(Protocol):
    """Sampled equations that know what goes on while their estimates rest; of others only theta_hat and memory are kept."""

    def freezing(self, frozen: Value) -> SampledEquations:
        """These equations, whose estimates and what was learnt for them keep their values where ``frozen`` holds."""
        ...


def kept(frozen: Value, old: Any, new: Any) -> Any:
    """``old`` where ``frozen`` holds, else ``new``, through nested NamedTuples; ``new`` where it is None."""
    if frozen is None:
        return new
    if isinstance(new, tuple):
        parts = [kept(frozen, one, other) for one, other in zip(old, new, strict=True)]
        return tuple(parts) if type(new) is tuple else type(new)(*parts)
    return np.where(frozen, old, new)


@runtime_checkable
class Discretizable(Protocol):
    """Continuous equations that know their midpoint form."""

    def sampled(self, T: float) -> SampledEquations:
        """For samples of length T [s]; InputError where there is none for these settings."""
        ...


@runtime_checkable
class DiscretizedEquations(SampledEquations, Protocol):
    """Sampled equations that stand for continuous ones."""

    @property
    def continuous(self) -> Equations: ...

    @property
    def explicit(self) -> bool:
        """Whether they take explicit steps, which a high gain or a long sample makes unstable."""
        ...


@runtime_checkable
class Controller(Protocol):
    """A controller's settings: a frozen dataclass, validated in its constructor."""

    @property
    def name(self) -> str:
        """The name in results, tables and figures."""
        ...

    def bind(self, known: Any) -> Equations | SampledEquations:
        """Join the settings with the plant's known part; raises InputError where they don't fit."""
        ...


@runtime_checkable
class FeedingBack(Protocol):
    """A controller that says what it feeds back; one that does not feeds back the state."""

    @property
    def feedback(self) -> str:
        """What: "state" or "output"."""
        ...


def feedback_of(controller: Controller) -> str:
    """What is fed back: "state" or "output"."""
    return controller.feedback if isinstance(controller, FeedingBack) else "state"


@runtime_checkable
class Stepping(Protocol):
    """A controller whose law may take numerical steps of its own, which are then part of a run's numerics."""

    @property
    def law_step(self) -> float | None:
        """Their length [s]; None for a law that needs none to be resolved."""
        ...

    def refined(self, factor: int) -> Controller:
        """Return this with steps shorter by ``factor``, if it takes any."""
        ...
