"""What the schemes on a parametric model do alike from sample to sample: the law's step, n_d, the auxiliary input's filters."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

from barbalat.adaptation.law import SampleData, SampledLaw
from barbalat.adaptation.normalization import Normalization
from barbalat.controllers.steps import Filter, LinearStep, SampledForm
from barbalat.problem.known_set import EstimateSet
from barbalat.protocols import Equations, Sample, Value, kept


class ParametricEquations(Equations, Protocol):
    """The continuous equations that are advanced."""

    @property
    def normalization(self) -> Normalization: ...

    @property
    def estimate_set(self) -> EstimateSet | None: ...

    def auxiliary_input_argument(self, state: Any, x: Value) -> Value: ...


class Learnt(NamedTuple):
    """What is new of a state at the sample's end once the law has learnt."""

    theta_hat: Value
    memory: Any
    n_d: Value


@dataclass(frozen=True, eq=False)
class Estimator(SampledForm):
    """Filters by the midpoint rule, the law as in ``adaptation.implicit``; docs/sampled.md has what holds.

    A scheme's own ``advance`` takes the filters' middles, then ``learnt``, ``swapped`` and ``filtered``, in this order.

    model   of the filters xi and Xi
    filter  Q(s) of the auxiliary input; None without one
    """

    continuous: ParametricEquations
    sample_time: float
    law: SampledLaw
    model: LinearStep
    filter: Filter | None
    frozen: Value = field(default=None, kw_only=True)  # where it holds, estimates and memory rest; None: it never does

    explicit: ClassVar[bool] = False

    def learnt(self, state: Any, z: Value, phi: Value, driven: Value) -> Learnt:
        """``driven`` is what n_d' adds, held over the sample."""
        c, T = self.continuous, self.sample_time
        decay = np.exp(-c.normalization.delta_0 * T)
        n_d = decay * state.n_d + (1 - decay) / c.normalization.delta_0 * driven  # (16), exact for what was held
        data = SampleData(T, z, phi, c.normalization.m_s_squared(phi, (state.n_d + n_d) / 2))
        moved = self.law.sampled_step(state.theta_hat, state.memory, data, c.estimate_set)
        return Learnt(kept(self.frozen, state.theta_hat, moved.theta_hat), kept(self.frozen, state.memory, moved.memory), n_d)

    def freezing(self, frozen: Value) -> Self:
        return replace(self, frozen=frozen)

    def swapped(self, state: Any, following: Any, Xi_mid: Value) -> Value:
        """The swapping term's state at the sample's end, which exists with an auxiliary input alone."""
        if self.filter is None:
            return state.swapping
        return self.model.end(state.swapping, Xi_mid @ (following.theta_hat - state.theta_hat) / self.sample_time)

    def filtered(self, state: Any, following: Any, before: Sample, now: Sample) -> Value:
        """The state of Q(s) at the sample's end; ``following`` has all else of it."""
        if self.filter is None:
            return state.filter
        argument = self.continuous.auxiliary_input_argument
        return self.filter.end(state.filter, argument(state, before.x), argument(following, now.x))
