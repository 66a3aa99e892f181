"""The baseline alone, without adaptation: the reference with which every adaptive controller is compared."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.settings import Scheme
from barbalat.controllers.steps import Still
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.problem.regressors import Linear, MatchedTerm
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.validate import Array, Vector


class State(NamedTuple):
    """An empty state: the baseline has neither states nor estimates."""

    theta_hat: Value  # (0,)


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """u = k_0 r - theta_0'phi(x)."""

    k_0: Array | float
    matched: MatchedTerm
    theta_0: Array
    assumed: str | None = None

    def initial(self) -> State:
        return State(np.zeros(0))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return np.dot(self.k_0, r) - self.matched.phi(x).T @ self.theta_0

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        return state

    def limit(self, state: State) -> State:
        return state

    def sampled(self, T: float) -> Still:
        return Still(self, T)


@dataclass(frozen=True, eq=False)
class BaselineAlone(Scheme):
    """u = k_0 r - theta_0'phi(x): the plant's baseline without adaptation; an unknown input gain is taken as 1.

    nominal  theta_0, (p,); the default is the first that exists of the baseline's theta_0, theta_0 at the declared [parameters],
             the middle of the known set, and zero
    """

    _: KW_ONLY
    nominal: Vector | None = None
    name: str = "Baseline"

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        if self.nominal is not None:
            validate.freeze(self, nominal=validate.vector("nominal", self.nominal))

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        beside = reach.known.theta_0 is not None or reach.known.matched.gain_unknown
        return TuningGrid(scheme="Baseline", values={}, make=cls, traded=beside)

    def bind(self, known: Known) -> Equations:
        p = known.matched.regressor.size(known.n) * known.inputs
        if self.nominal is not None:
            return Equations(k_0=known.k_0, matched=known.matched, theta_0=validate.vector("nominal", self.nominal, p))
        if known.theta_0 is not None:
            return Equations(k_0=known.k_0, matched=known.matched, theta_0=known.theta_0)
        if known.nominal is not None:
            theta_0, of = known.nominal, "the declared values of the parameters"
        elif known.theta_set is not None:
            theta_0, of = known.theta_set.middle, "the middle of the known set"
        else:
            theta_0, of = np.zeros(p), "theta = 0, since neither parameters nor a known set are given"
        return Equations(k_0=known.k_0, matched=known.matched, theta_0=theta_0, assumed=_assumed(of, known, theta_0))


def _assumed(of: str, known: Known, theta_0: Array) -> str:
    numbers = ", ".join(f"{one:.4g}" for one in theta_0)
    law = f"theta_0 = [{numbers}]"
    if known.inputs == 1 and isinstance(known.matched.regressor, Linear):
        law = f"u = {float(known.k_0):.4g} r - [{numbers}] x"
    gain = ", with an input gain of 1" if known.matched.gain_unknown else ""
    return f"without [baseline] its gains are those for {of}{gain}: {law}"
