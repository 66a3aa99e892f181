"""A sampled controller with everything that it keeps from sample to sample, as it runs on a flight computer.

It receives only the measurement and the command. It contains the reference model, advanced from sample to sample under the
sampled command. ``ClosedLoop`` integrates (2) separately, and e is reported with respect to the latter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.loop.around import LOST, Around
from barbalat.loop.packing import Held, as_array, flatten, unflatten
from barbalat.problem.baseline import FixedController
from barbalat.problem.observer import ObserverEquations
from barbalat.protocols import Dynamics, Freezable, Sample, SampledEquations, Value
from barbalat.roles import main_estimates, resting, roles_of, state_parts, taken_from
from barbalat.validate import Array


class Acting(NamedTuple):
    """The whole state of a sampled controller."""

    controller: Any  # the NamedTuple of the scheme
    held: Held


def held_model(model: Any, T: float, commands: int | None) -> HeldSystem:
    """The reference model over samples of length T [s]; it has ``matrices``, A and B of x_m' = A x_m + B r."""
    A, B, _ = model.matrices
    return HeldSystem.of(A, B[:, 0] if commands is None else B, T)


@dataclass(frozen=True, eq=False)
class SampledController:
    """A scheme's equations, the reference model under a held command, and the values kept from one sample to the next.

    model     the problem's model: its initial state, and the part of its state that the plant should follow
    discrete  the model in discrete time
    inputs    number of entries of u
    commands  ``None`` for one command, a scalar
    around    the shell and the faults; None if every sample is used unchanged
    baseline  its states follow the measurement in the input of the equations; None without a baseline
    observer  the equations and the baseline receive its estimate in place of the measurement; None without an observer
    external  the baseline whose control external code computes; that control follows the measurement in the input, and u is the
              sum of it and the adaptive part
    """

    equations: SampledEquations
    model: Dynamics
    discrete: HeldSystem
    inputs: int
    commands: int | None
    around: Around | None = None
    baseline: FixedController | None = None
    observer: ObserverEquations | None = None
    external: FixedController | None = None

    def initial(self, y: Array, controller: Any = None) -> Acting:
        """The state at t = 0, before the first sample; ``y`` has the shape of the measurement.

        controller  the initial state of the equations, by default the result of their ``initial``
        """
        controller = self.equations.initial() if controller is None else controller
        held = Held(
            u=np.zeros(() if self.inputs == 1 else self.inputs),
            measured=0 * y,
            x_m=self.model.x0,
            r=np.zeros(() if self.commands is None else self.commands),
            started=np.zeros(()),
            theta_hat=self._theta_hat(controller),
            baseline=np.zeros(0 if self.baseline is None else self.baseline.order),
            observer=np.zeros(0) if self.observer is None else self.observer.start,
            around=() if self.around is None else self.around.initial(y, self.inputs),
        )
        return Acting(controller, held)

    def act(self, state: Acting, y: Value, r: Value, freeze: Value = None) -> Acting:
        """Take one sample: advance from the last sample to this one, unless this is the first, and set u.

        If ``freeze`` is above 0, the estimates and the law's memory are held. If it is ``LOST``, an observer also predicts
        without ``y``. If it is None, nothing is held.
        """
        controller, held = state
        started = held.started > 0
        x_m = np.where(started, self.discrete.following(held.x_m, held.r), held.x_m)
        z = self._observed(held, self._measured(y), None if freeze is None else freeze >= LOST)
        seen_before, seen = self._seen(held.observer, self._measured(held.measured)), self._seen(z, self._measured(y))
        xi = self._advanced(held, seen_before, seen)
        before = Sample(self._handed(seen_before, held.baseline), self._followed(held.x_m), held.r)
        now = Sample(self._handed(seen, xi), self._followed(x_m), r)
        advanced = self._advance(controller, before, held.u, now, freeze)
        chosen = np.where(started, flatten(advanced), flatten(controller))
        following, _ = unflatten(controller, chosen, 0)
        u = as_array(self.equations.control(following, *now))
        if self.external is not None:
            own = self.external.control(self._handed(seen, xi), r)
            u = (y[-self.inputs :] + (u.reshape(-1) - own)).reshape(u.shape)
        return Acting(following, Held(u, y, x_m, r, 0 * held.started + 1, self._theta_hat(controller), xi, z, held.around))

    def external_control(self, held: Held, y: Value, r: Value) -> Value:
        """(m,) the control that the external baseline computes at the sample y, simulated from the same states."""
        assert self.external is not None
        z = self._observed(held, y)
        before, seen = self._seen(held.observer, self._measured(held.measured)), self._seen(z, y)
        return self.external.control(self._handed(seen, self._advanced(held, before, seen)), r)

    def _measured(self, handed: Value) -> Value:
        """The measurement, from the input at a sample."""
        return handed if self.external is None else handed[: -self.inputs]

    def _observed(self, held: Held, y: Value, lost: Value = None) -> Value:
        """The observer's state at this sample; ``lost`` tells whether the measurement is missing."""
        if self.observer is None:
            return held.observer
        z = self.observer.advance(held.observer, held.u, y, lost)
        return np.where(held.started > 0, z, held.observer)

    def _seen(self, z: Value, y: Value) -> Value:
        """The plant's state as the controller knows it: the measurement, or the observer's estimate."""
        return y if self.observer is None else self.observer.estimate(z, y)

    def _advanced(self, held: Held, before: Value, seen: Value) -> Value:
        """The baseline's states at this sample, from the plant's state at the previous sample and at this one."""
        if self.baseline is None:
            return held.baseline
        xi = self.baseline.advance(held.baseline, before, seen, held.r, held.u, self.equations.sample_time)
        return np.where(held.started > 0, xi, held.baseline)

    def _handed(self, seen: Value, xi: Value) -> Value:
        return seen if self.baseline is None else np.concatenate([seen, xi])

    def _followed(self, x_m: Value) -> Value:
        return self.model.output(x_m) if self.baseline is None else x_m

    def _advance(self, controller: Any, before: Sample, u: Value, now: Sample, freeze: Value) -> Any:
        if freeze is None:
            return self.equations.advance(controller, before, u, now)
        frozen = freeze > 0
        if isinstance(self.equations, Freezable):
            return self.equations.freezing(frozen).advance(controller, before, u, now)
        return resting(frozen, roles_of(self.equations), controller, self.equations.advance(controller, before, u, now))

    def _theta_hat(self, controller: Any) -> Value:
        """The estimates whose path is summed."""
        return taken_from(controller, main_estimates(state_parts(self.equations, controller)))
