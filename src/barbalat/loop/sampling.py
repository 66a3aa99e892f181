"""A sampled controller with all that it carries from sample to sample: what a flight computer runs, and nothing else.

It is handed the measurement and the command, and nothing of the plant. The reference model is a part of it, from sample to
sample under the command that it sampled; ``ClosedLoop`` integrates (2) itself beside it, and e is reported against that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.loop.around import Around
from barbalat.loop.packing import Held, as_array, flatten, unflatten
from barbalat.problem.baseline import FixedController
from barbalat.protocols import Dynamics, Freezable, Sample, SampledEquations, Value
from barbalat.roles import main_estimates, resting, roles_of, state_parts, taken_from
from barbalat.validate import Array


class Acting(NamedTuple):
    """The whole state of a sampled controller."""

    controller: Any  # the scheme's own NamedTuple
    held: Held


def held_model(model: Any, T: float, commands: int | None) -> HeldSystem:
    """The reference model over samples of length T [s]; it has ``matrices``, A and B of x_m' = A x_m + B r."""
    A, B, _ = model.matrices
    return HeldSystem.of(A, B[:, 0] if commands is None else B, T)


@dataclass(frozen=True, eq=False)
class SampledController:
    """A scheme's equations, the reference model under a held command, and what is kept from one sample to the next.

    model     as the problem has it: its initial state, and what of its state is to be followed
    discrete  the same from sample to sample
    inputs    entries of u
    commands  ``None`` for one command, a scalar
    around    the shell and the faults; None where every sample is taken as it comes
    baseline  whose own states stand behind what is measured in what the equations are handed; None without any
    """

    equations: SampledEquations
    model: Dynamics
    discrete: HeldSystem
    inputs: int
    commands: int | None
    around: Around | None = None
    baseline: FixedController | None = None

    def initial(self, y: Array, controller: Any = None) -> Acting:
        """At t = 0, before the first sample; ``y`` has the shape of what is measured.

        controller  the equations' state there, by default what their ``initial`` gives
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
            around=() if self.around is None else self.around.initial(y, self.inputs),
        )
        return Acting(controller, held)

    def act(self, state: Acting, y: Value, r: Value, freeze: Value = None) -> Acting:
        """One sample: advance from the last one to this one, unless this is the first, and set u.

        ``freeze``: where it is above 0, the estimates and the law's memory keep their values. ``None``: it never is.
        """
        controller, held = state
        started = held.started > 0
        x_m = np.where(started, self.discrete.following(held.x_m, held.r), held.x_m)
        xi = self._advanced(held, y)
        before = Sample(self._handed(held.measured, held.baseline), self._followed(held.x_m), held.r)
        now = Sample(self._handed(y, xi), self._followed(x_m), r)
        advanced = self._advance(controller, before, held.u, now, freeze)
        chosen = np.where(started, flatten(advanced), flatten(controller))
        following, _ = unflatten(controller, chosen, 0)
        u = as_array(self.equations.control(following, *now))
        return Acting(following, Held(u, y, x_m, r, 0 * held.started + 1, self._theta_hat(controller), xi, held.around))

    def _advanced(self, held: Held, y: Value) -> Value:
        """The baseline's own states at this sample."""
        if self.baseline is None:
            return held.baseline
        xi = self.baseline.advance(held.baseline, held.measured, y, held.r, self.equations.sample_time)
        return np.where(held.started > 0, xi, held.baseline)

    def _handed(self, y: Value, xi: Value) -> Value:
        return y if self.baseline is None else np.concatenate([y, xi])

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
        """The estimates whose motion is counted."""
        return taken_from(controller, main_estimates(state_parts(self.equations, controller)))
