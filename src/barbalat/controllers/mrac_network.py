"""MRAC with a network of one hidden layer, which is nonlinear in its weights; a modification keeps them bounded."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import budget, validate
from barbalat.adaptation.modifications import EpsilonModification, FixedSigma, Leakage
from barbalat.controllers.settings import Scheme, require_taken
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, InputError, Vector

DEFAULT_NEURONS = 10
LEAKAGES = np.geomspace(1e-4, 1.0, 12)
"""The trial values of sigma, from one at which the weights hardly decay to one at which they stay as small as e'P b."""
DOUBLE_BITS = 53
"""How many of the 64 random bits a number in [0, 1) uses."""


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # ((1 + N) m,) W_hat, the outer weights row by row, with the weights of the constant 1 first
    V_hat: Value  # (1 + n, N) the inner weights, with the weights of the constant 1 in the first row


def initial_inner_weights(seed: int, spread: float, shape: tuple[int, int]) -> Array:
    """Uniformly distributed in [-spread, spread); a seed gives bit-identical numbers with every version of NumPy.

    NumPy guarantees this only for a generator's raw bits, not for its distributions.
    """
    raw = np.random.PCG64(seed).random_raw(shape[0] * shape[1])
    even = (np.asarray(raw, dtype=np.uint64) >> np.uint64(64 - DOUBLE_BITS)) * 2.0**-DOUBLE_BITS
    weights: Array = (spread * (2 * even - 1)).reshape(shape)
    weights.flags.writeable = False
    return weights


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """The gradient law for both layers. The outer layer subtracts the linear part of the inner layer, which makes the pair
    passive."""

    B: Array  # (n, m)
    P: Array
    k_0: Array | float
    gamma: float
    gamma_v: float
    leakage: Leakage
    scale: Array  # (n,)
    V_0: Array  # (1 + n, N)

    @property
    def inputs(self) -> int:
        return int(self.B.shape[1])

    @property
    def neurons(self) -> int:
        return int(self.V_0.shape[1])

    @property
    def roles(self) -> dict[str, Role]:
        columns = [f",{j + 1}" for j in range(self.inputs)] if self.inputs > 1 else [""]
        names = tuple(f"W_{i}{column}" for i in range(1 + self.neurons) for column in columns)
        return {
            "theta_hat": Role.estimates("W", names=names, meaning="W_hat, the network's outer weights"),
            "V_hat": Role.estimates("V", meaning="the network's inner weights"),
        }

    def initial(self) -> State:
        return State(np.zeros((1 + self.neurons) * self.inputs), self.V_0)

    def layer_input(self, x: Value) -> Value:
        """x_bar = (1, x/scale)."""
        return np.concatenate([np.ones(1), x / self.scale])

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        return -self.regressor_at(state, x, r).T @ state.theta_hat + np.dot(self.k_0, r)

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        """The factor of the outer weights: h, or with m inputs the matrix ((1 + N) m, m) formed from it."""
        h = np.concatenate([np.ones(1), np.tanh(state.V_hat.T @ self.layer_input(x))])
        if self.inputs == 1:
            return h
        return np.outer(h, np.eye(self.inputs).reshape(-1)).reshape(h.shape[0] * self.inputs, self.inputs)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        W, V, x_bar, mu = (
            state.theta_hat.reshape(-1, self.inputs),
            state.V_hat,
            self.layer_input(x),
            (x - x_m) @ (self.P @ self.B),
        )
        z = V.T @ x_bar
        h, w = np.tanh(z), self.leakage.coefficient(W, np.sum(np.abs(mu)))
        slope = 1 - h * h
        W_dot = self.gamma * (np.outer(np.concatenate([np.ones(1), h - slope * z]), mu) - w * W)
        V_dot = self.gamma_v * (np.outer(x_bar, slope * (W[1:] @ mu)) - w * V)
        return State(W_dot.reshape(-1), V_dot)

    def limit(self, state: State) -> State:
        return state


@dataclass(frozen=True, eq=False)
class NetworkMrac(Scheme):
    """u = -W_hat'h + k_0 r, h = (1, tanh(z)), z = V_hat'x_bar, x_bar = (1, x/scale): a network with one hidden layer learns
    theta'phi(x).

    With mu = b'P e, h' = (0, 1 - tanh^2(z)) and the leakage w, each neuron has W_i' = gamma (mu (h_i - h_i' z_i) - w W_i) and
    V_i' = gamma_v (mu'W_i h_i' x_bar - w V_i), where W_i has a weight for each input. All inputs share the hidden layer. The
    e-modification is w = nu |mu|_1. phi(x) is not used: the network uses x itself. W_hat starts at zero.

    gamma       adaptive gain > 0 of the outer weights
    leakage     FixedSigma (sigma-modification) or EpsilonModification (e-modification): keeps the weights bounded and lets them
                decay at the rate gamma w; once the inner weights have decayed, only the constant can be learnt
    gamma_v     adaptive gain of the inner weights, > 0; by default gamma
    neurons     N, the neurons of the hidden layer; 10 by default
    scale       (n,), typical magnitudes of the states, by which x is divided; 1 by default. For much larger states tanh saturates
    seed        determines the initial inner weights V_hat(0), uniform in [-spread, spread]; 0 by default
    spread      > 0; 1 by default
    V_hat0      (1 + n, N), initial inner weights to use instead of random ones; the weights of the constant come first

    Source: Lewis, Yesildirek and Liu, IEEE Trans. Neural Networks 7(2), 1996, and the textbooks on the modifications.
    """

    gamma: float
    _: KW_ONLY
    leakage: Leakage | None = None
    gamma_v: float | None = None
    neurons: int | None = None
    scale: Vector | None = None
    seed: int = 0
    spread: float = 1.0
    V_hat0: Array | None = None
    name: str = "MRAC, network"

    beyond: ClassVar[tuple[str, ...]] = ("an unknown input gain", "a baseline")

    def __post_init__(self) -> None:
        validate.label("name", self.name)
        validate.freeze(self, gamma=validate.positive("gamma", self.gamma), spread=validate.positive("spread", self.spread))
        validate.freeze(self, seed=validate.whole("seed", self.seed, least=0))
        if self.gamma_v is not None:
            validate.freeze(self, gamma_v=validate.positive("gamma_v", self.gamma_v))
        if self.leakage is None:
            raise InputError(
                "leakage is missing: give FixedSigma or EpsilonModification; in a case file, modification = { sigma } or { nu }"
            )
        validate.instance("leakage", self.leakage, (FixedSigma, EpsilonModification))
        if self.neurons is not None:
            validate.freeze(self, neurons=validate.whole("neurons", self.neurons, least=1))
        if self.scale is not None:
            validate.freeze(self, scale=validate.vector("scale", self.scale))
            if not (self.scale > 0).all():
                raise InputError.of("scale", f"must have positive entries, got {validate.show(self.scale)}")
        if self.V_hat0 is not None:
            validate.freeze(self, V_hat0=validate.array("V_hat0", self.V_hat0, (None, None)))
            if self.neurons not in (None, self.V_hat0.shape[1]):
                raise InputError.of(
                    "V_hat0",
                    f"must have {validate.counted(self.neurons, 'column')}, one for each neuron, got {self.V_hat0.shape[1]}",
                )

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        highest = reach.highest_square / (1 + DEFAULT_NEURONS)  # each entry of the outer weights' factor is at most 1
        return TuningGrid(
            scheme="MRAC, network",
            values={"gamma": highest * np.geomspace(1e-8, 1.0, 8 * reach.density), "sigma": LEAKAGES},
            make=lambda gamma, sigma: cls(gamma=gamma, leakage=FixedSigma(sigma)),
            traded=False,
            aims=("error_bound",),
        )

    def bind(self, known: Known) -> Equations:
        require_taken(NetworkMrac, known)
        assert self.leakage is not None  # the constructor has checked it
        n = known.n
        return Equations(
            B=known.b.reshape(n, -1),
            P=known.P,
            k_0=known.k_0,
            gamma=self.gamma,
            gamma_v=self.gamma if self.gamma_v is None else self.gamma_v,
            leakage=self.leakage,
            scale=np.ones(n) if self.scale is None else validate.vector("scale", self.scale, n),
            V_0=self._inner_weights(n, known.b.size // n),
        )

    def _inner_weights(self, n: int, m: int) -> Array:
        if self.V_hat0 is not None:
            return validate.array("V_hat0", self.V_hat0, (1 + n, None))
        neurons = DEFAULT_NEURONS if self.neurons is None else self.neurons
        budget.require("neurons", neurons, lambda count: budget.of_kernel(count * (1 + n + m)))  # states per neuron
        return initial_inner_weights(self.seed, self.spread, (1 + n, neurons))
