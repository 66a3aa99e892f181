"""The predictor of L1-AC, and of the MRAC as a predictor, from sample to sample by the midpoint rule."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from barbalat.adaptation import implicit
from barbalat.controllers.steps import Filter, Unmoved, half_step
from barbalat.controllers.windup import ModifiedError
from barbalat.problem.known_set import KnownSet
from barbalat.protocols import Sample, Value, kept
from barbalat.roles import resting
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from barbalat.controllers import l1


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predictor (8) and law (7) in one implicit step; with C = 1 the MRAC.

    V = x_tilde'P x_tilde + theta_tilde'Gamma^-1 theta_tilde falls by at least T |x_tilde|^2 a sample, for every Gamma, T.
    The predictor is fed with the estimate as the known set leaves it: with C = 1 it then stays with the reference model.
    """

    continuous: l1.Equations
    sample_time: float
    known_set: KnownSet | None  # what the step keeps to; with a leakage it holds the origin as well
    end: Array  # (I - T A_m)^-1
    filter: Filter
    coupling: Array | float  # T b'P (I - T A_m)^-1 b > 0; (m, m) with m inputs
    windup: ModifiedError | None = None
    frozen: Value = None  # where it holds, the estimates rest and nothing is remembered; None: it never does

    explicit: ClassVar[bool] = False

    @classmethod
    def of(cls, equations: l1.Equations, T: float, windup: ModifiedError | None = None) -> Predictor:
        modifications, box = equations.modifications, equations.box
        if modifications.dead_zone is not None:
            raise InputError(
                "discretization = 'midpoint' takes no dead zone on sqrt(e'P e): its implicit step has no closed form; take "
                "'euler', or a dead zone in a law on the parametric model"
            )
        implicit.require_projectable(equations.gamma, box)
        end = half_step(equations.A_m, 2 * T)
        coupling = T * (equations.b.T @ equations.P @ end @ equations.b)
        return cls(
            equations,
            T,
            None if box is None else box.kept_by_steps(len(equations.theta_hat0), leaking=modifications.leakage is not None),
            end,
            Filter.of(equations.C, T),
            float(coupling) if np.ndim(coupling) == 0 else coupling,
            windup,
        )

    def initial(self) -> l1.State:
        return self.continuous.initial()

    def control(self, state: l1.State, x: Value, x_m: Value, r: Value) -> Value:
        u = self.continuous.control(state, x, x_m, r)
        return u if self.windup is None else self.windup.control(u, self.continuous.limits)

    def advance(self, state: l1.State, before: Sample, u: Value, now: Sample) -> l1.State:
        c, T, u = self.continuous, self.sample_time, self.continuous.applied(u)
        unmoved = self._unmoved(state, before, u, now)
        memory = self._memory(state, before, u, now)
        moved = implicit.with_leakage(
            c.modifications.leakage, state.theta_hat, unmoved.error, lambda w: self._moved(state, memory, unmoved, w)
        )
        theta_hat, memory = kept(self.frozen, state.theta_hat, moved), self._remembered(state.memory, memory)
        x_hat = unmoved.x_hat + T * (self.end @ np.dot(c.b, unmoved.phi.T @ theta_hat))
        inside = kept(self.frozen, theta_hat, implicit.into(theta_hat, c.box, c.gamma))
        following = state._replace(theta_hat=inside, x_hat=x_hat, memory=memory)
        wanted = c.filter_input(state, before.x, before.r), c.filter_input(following, now.x, now.r)
        return following._replace(filter=self.filter.end(state.filter, *wanted))

    def freezing(self, frozen: Value) -> Predictor:
        return replace(self, frozen=frozen)

    def _remembered(self, before: Any, memory: Any) -> Any:
        """What was learnt; the filters of what is measured go on while it rests."""
        learning = self.continuous.modifications.learning
        return memory if self.frozen is None or learning is None else resting(self.frozen, learning.roles, before, memory)

    def _unmoved(self, state: l1.State, before: Sample, u: Value, now: Sample) -> Unmoved:
        c, T = self.continuous, self.sample_time
        phi = (c.uncertainty.with_input(before.x, u) + c.uncertainty.with_input(now.x, u)) / 2
        # A_m acts on x_mid - x_tilde: what is measured enters as in the midpoint rule, what is estimated at the sample's end
        measured = np.dot(c.b, c.uncertainty.known_input(u)) - c.A_m @ ((now.x - before.x) / 2)
        x_hat = self.end @ (state.x_hat + T * measured)
        error = (now.x - x_hat) @ (c.P @ c.b) - np.dot(self.coupling, phi.T @ state.theta_hat)
        return Unmoved(x_hat, error, phi)

    def _moved(self, state: l1.State, memory: Any, unmoved: Unmoved, w: Value) -> Value:
        """The estimate at the sample's end, with the leakage w."""
        c, T, learning = self.continuous, self.sample_time, self.continuous.modifications.learning
        pull = () if learning is None else (learning.gamma_c * memory.R, learning.gamma_c * memory.Q)
        gain, rest = implicit.at_rest(c.gamma, state.theta_hat, T, w, *pull)
        error = unmoved.error - np.dot(self.coupling, unmoved.phi.T @ (rest - state.theta_hat))
        return implicit.step_within(rest, gain.over(T), unmoved.phi, self.coupling, error, self.known_set)

    def _memory(self, state: l1.State, before: Sample, u: Value, now: Sample) -> Any:
        c, learning = self.continuous, self.continuous.modifications.learning
        if learning is None:
            return state.memory
        phi = (c.uncertainty.with_input(before.x, u) + c.uncertainty.with_input(now.x, u)) / 2
        known = c.uncertainty.known_input(u)
        return learning.advance(state.memory, self.sample_time, c.A_m, c.b, (before.x + now.x) / 2, phi, known)
