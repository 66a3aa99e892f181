"""The page to read first: the protocols of a signal, a controller and a scheme's equations.

A user writes a ``Controller``: its settings. ``bind`` joins them with the known part of the plant and returns the ``Equations``,
which read like the paper and compute with plain NumPy functions. The same lines are evaluated on numbers (tests, exploration) and
on CasADi's arrays (the source of machine code, C and Jacobians), so they must not branch on values: use ``np.where``,
``np.clip``, ``np.minimum``.
"""

from __future__ import annotations

from dataclasses import dataclass
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
        """The limit from the left, which differs from the value only at a jump. The last stage of a step uses it."""
        ...


@runtime_checkable
class BreakingSignal(Signal, Protocol):
    """A signal with a jump, or with a jump in a derivative; a signal that does not declare breaks is assumed to be smooth."""

    def breaks(self, start: float, stop: float) -> Array:
        """The instants [s] of these jumps in (start, stop), (K,); an instant does not depend on the interval."""
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
    """A signal with a bound on its slope, needed to bound the motion between samples; all signals of the package have one."""

    @property
    def slope(self) -> float:
        """A bound on |derivative| on every interval without a jump [1/s]."""
        ...


@runtime_checkable
class SettlingSignal(Signal, Protocol):
    """A signal that knows whether it becomes constant; nothing is assumed about a signal without this method."""

    @property
    def settles(self) -> bool:
        """Whether the signal is constant from some time on."""
        ...


@runtime_checkable
class InterpolatedSignal(Signal, Protocol):
    """A signal that is linear between points and constant outside them: pages store the points instead of its equations."""

    @property
    def interpolation_points(self) -> tuple[Array, Array]:
        """The times [s], increasing, and the values there, both (K,)."""
        ...


class Dynamics(Protocol):
    """The part of a plant or of a model that a loop integrates."""

    @property
    def x0(self) -> Array:
        """The state at t = 0, (n,)."""
        ...

    def derivative(self, x: Value, v: Value) -> Value:
        """x' for the input v, which is the plant's actual input or the model's command."""
        ...

    def output(self, x: Value) -> Value:
        """The measured output of a plant, or the output of a model that the plant is to follow: (n,), or a scalar."""
        ...


class Equations(Protocol):
    """A scheme bound to the known part of a plant. The state is a NamedTuple of arrays that has a field ``theta_hat``, (p,).

    Its p estimates need not be the problem's parameters: they may be the weights of a network, or an empty vector, (0,), if
    nothing is estimated.
    """

    def initial(self) -> NamedTuple:
        """The state at t = 0, in numbers."""
        ...

    def control(self, state: Any, x: Value, x_m: Value, r: Value) -> Value:
        """The control u, a scalar, from the states of plant and model, both (n,), and the command.

        With output feedback, ``x`` and ``x_m`` are the scalars y and y_m.
        """
        ...

    def derivative(self, state: Any, x: Value, x_m: Value, r: Value, u: Value) -> NamedTuple:
        """The derivative of the state; ``u`` is the present result of ``control``, before the plant's limits, gain, dynamics and
        delay.

        A controller does not know what reaches the plant. A scheme that knows its actuator's limits, ``known.saturation``,
        applies them to u itself.
        """
        ...

    def limit(self, state: Any) -> NamedTuple:
        """The state with the estimates limited to the known set; applied at every stage of every solver."""
        ...


@runtime_checkable
class Assuming(Protocol):
    """Equations that assume numbers which the case does not give; runs and certificates state these numbers."""

    @property
    def assumed(self) -> str | None:
        """A sentence that states the assumed numbers; None if the case gives them."""
        ...


@dataclass(frozen=True, eq=False)
class Lyapunov:
    """A Lyapunov function of the loop, for ``certify`` to check: V' <= -W along (1), (2) and the law's own equations.

    V            a quadratic form in e, the state and theta
    W            a lower bound on the decrease of V, nowhere negative; 0 by default
    zero         quantities that are zero at t = 0 and stay zero, such as z - theta'phi_f of a filtered model: a number or an
                 array
    nonnegative  symmetric matrices in the state that stay positive semidefinite, such as the integral of phi phi': one or a tuple
                 of them
    """

    V: Value
    W: Value = 0.0
    zero: Value = ()
    nonnegative: Value = ()


@runtime_checkable
class LyapunovEquations(Protocol):
    """Equations whose author supplies a Lyapunov function."""

    def lyapunov(self, state: Any, x: Value, x_m: Value, theta: Value) -> Lyapunov:
        """V and the terms of its proof, from the law's state, the states of plant and model and the true parameters (p,)."""
        ...


@runtime_checkable
class Bending(Protocol):
    """A part of a law or a plant whose rate has a corner that trajectories reach; a step across it is only second-order
    accurate."""

    @property
    def bend(self) -> str | None:
        """The position of the corner, in a few words; ``None`` if there is none."""
        ...


@runtime_checkable
class Jumping(Protocol):
    """A part of a law whose rate or state jumps at a point that trajectories reach; a step across it is only first-order
    accurate."""

    @property
    def jump(self) -> str:
        """The position of the jump, in a few words."""
        ...


class Sample(NamedTuple):
    """The measurements of a sampled controller at one instant."""

    x: Value  # (n,), or the output y
    x_m: Value  # the state of its own reference model, which advances from sample to sample under a held command
    r: Value


@runtime_checkable
class SampledEquations(Protocol):
    """A controller that acts every ``sample_time`` and holds its control in between. Its state has the same form as the state of
    ``Equations``."""

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
        """The state at this sample, from the state at the previous sample. In between, the control u (before the limits) was
        held."""
        ...


@runtime_checkable
class Freezable(Protocol):
    """Sampled equations that know which states a freeze holds; for others, a freeze holds theta_hat and memory."""

    def freezing(self, frozen: Value) -> SampledEquations:
        """Return these equations with the estimates and the law's memory held wherever ``frozen`` is true."""
        ...


def kept(frozen: Value, old: Any, new: Any) -> Any:
    """``old`` where ``frozen`` is true and ``new`` elsewhere, through nested NamedTuples; ``new`` if ``frozen`` is None."""
    if frozen is None:
        return new
    if isinstance(new, tuple):
        parts = [kept(frozen, one, other) for one, other in zip(old, new, strict=True)]
        return tuple(parts) if type(new) is tuple else type(new)(*parts)
    return np.where(frozen, old, new)


@runtime_checkable
class Discretizable(Protocol):
    """Continuous equations with a sampled form by the midpoint rule."""

    def sampled(self, T: float) -> SampledEquations:
        """The sampled form for samples of length T [s]; raises InputError if there is none for these settings."""
        ...


@runtime_checkable
class DiscretizedEquations(SampledEquations, Protocol):
    """Sampled equations that discretise continuous ones."""

    @property
    def continuous(self) -> Equations: ...

    @property
    def explicit(self) -> bool:
        """Whether they take explicit steps, which become unstable with a high gain or a long sample."""
        ...


@runtime_checkable
class Controller(Protocol):
    """A controller's settings: a frozen dataclass, validated in its constructor."""

    @property
    def name(self) -> str:
        """The name in results, tables and metrics."""
        ...

    def bind(self, known: Any) -> Equations | SampledEquations:
        """Join the settings with the known part of the plant; raises InputError if they don't fit."""
        ...


@runtime_checkable
class FeedingBack(Protocol):
    """A controller that declares what it feeds back; a controller without this declaration feeds back the state."""

    @property
    def feedback(self) -> str:
        """The fed-back signal: "state" or "output"."""
        ...


def feedback_of(controller: Controller) -> str:
    """The signal that a controller feeds back: "state" or "output"."""
    return controller.feedback if isinstance(controller, FeedingBack) else "state"


@runtime_checkable
class Stepping(Protocol):
    """A controller whose law may take numerical steps of its own, which belong to the numerical method of a run."""

    @property
    def law_step(self) -> float | None:
        """The length of those steps [s]; None for a law that needs no step to be resolved."""
        ...

    def refined(self, factor: int) -> Controller:
        """Return this controller with its steps shortened by ``factor``, if it takes any."""
        ...
