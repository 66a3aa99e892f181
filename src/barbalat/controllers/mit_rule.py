"""The MIT rule, for teaching: a gradient descent of the squared error that treats the gains as constant; it guarantees
nothing."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.controllers.control_gains import ControlGains, GainEquations, check_gains
from barbalat.controllers.settings import Scheme, require_taken
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, Vector


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (p,) the feedback gains, estimate of k_x = theta/omega
    k_r_hat: Value  # (1,) the feedforward gain, estimate of k_r = k_0/omega
    Psi: Value  # (n, p) the model's response to phi(x)' as an input through b
    psi_r: Value  # (n,) the model's response to r


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations(GainEquations):
    """de/dk_x = -omega (sI - A_m)^-1 b [phi'] and de/dk_r = omega (sI - A_m)^-1 b [r], when plant and model agree."""

    A_m: Array
    b: Array
    c: Array
    normalization: float | None
    feedforward_only: bool
    gains: ControlGains

    @property
    def roles(self) -> dict[str, Role]:
        response = "the model's response to the gains' inputs"
        return super().roles | {"Psi": Role.filter(f"{response}, phi(x)"), "psi_r": Role.filter(f"{response}, r")}

    def initial(self) -> State:
        n, p = len(self.b), len(self.gains.theta_hat0)
        return State(self.gains.theta_hat0, self.gains.k_r0, np.zeros((n, p)), np.zeros(n))

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        if self.feedforward_only:  # k_r_hat r
            return (u + self.gains.matched.phi(x).T @ state.theta_hat).reshape(1)
        return self.gains.with_input(x, u)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        of_x, of_r, error = self.c @ state.Psi, self.c @ state.psi_r, self.c @ (x - x_m)
        if self.normalization is not None:
            error = error / (self.normalization + of_x @ of_x + of_r * of_r)
        k_x_dot, k_r_dot = self.gains.rates(error, of_x, of_r, state.theta_hat, state.k_r_hat)
        phi = np.zeros(len(self.gains.theta_hat0)) if self.feedforward_only else self.gains.matched.phi(x)
        Psi_dot = self.A_m @ state.Psi + np.outer(self.b, phi)
        return State(k_x_dot, k_r_dot, Psi_dot, self.A_m @ state.psi_r + self.b * r)

    def limit(self, state: State) -> State:
        k_x_hat, k_r_hat = self.gains.limited(state.theta_hat, state.k_r_hat)
        return state._replace(theta_hat=k_x_hat, k_r_hat=k_r_hat)


@dataclass(frozen=True, eq=False)
class MitRule(Scheme):
    """u = -k_x_hat'phi(x) + k_r_hat r, with gains that descend the gradient of (c'e)^2/2: dk/dt = -gamma (c'e) d(c'e)/dk.

    With G(s) = c'(sI - A_m)^-1 b, k_x_hat' = proj(Gamma (c'e) G[phi(x)]), k_r_hat' = proj(-gamma_r (c'e) G[r]); the input gain
    omega > 0 is absorbed into Gamma, as in the textbook. Known limitation: the gradient assumes constant gains, so above some
    adaptive gain or command amplitude the gains diverge from their ideal values. No Gamma suits every command.

    gamma       adaptive gain Gamma > 0 of the feedback: a number, a diagonal (p,) or an s.p.d. matrix (p, p)
    gamma_r     adaptive gain of the feedforward, > 0; by default gamma, if that is a number
    output      c, (n,): c'e is the error whose square is minimised; the first state by default
    normalization  alpha > 0 of the normalised rule, which divides by alpha + |G[phi]|^2 + G[r]^2; not normalised by default
    feedforward_only  hold k_x_hat at theta_hat0; off by default. For a plant k_p G(s), omega = k_p, and the model k_0 G(s), the
                      rule is then the textbook's theta' = -gamma e y_m, with gamma_r = gamma k_0
    theta_hat0  k_x_hat(0), (p,), zero by default; inside the known set
    k_r0        k_r_hat(0), by default k_0, or the nearest value that the interval of the input gain allows
    projection  onto the known set divided by the input gain; on by default if there is a known set

    Source: Astrom and Wittenmark, Adaptive Control, second edition, sections 5.2 and 5.3; the feedforward alone is example 5.1.
    """

    gamma: float | Array
    _: KW_ONLY
    gamma_r: float | None = None
    output: Vector | None = None
    normalization: float | None = None
    feedforward_only: bool = False
    theta_hat0: Vector | None = None
    k_r0: float | None = None
    projection: bool | None = None
    name: str = "MIT rule"

    beyond: ClassVar[tuple[str, ...]] = ("several inputs", "a baseline")

    def __post_init__(self) -> None:
        check_gains(self)
        if self.output is not None:
            validate.freeze(self, output=validate.vector("output", self.output))
        validate.instance("feedforward_only", self.feedforward_only, bool)
        if self.normalization is not None:
            validate.freeze(self, normalization=validate.positive("normalization", self.normalization))

    def bind(self, known: Known) -> Equations:
        require_taken(MitRule, known)
        return Equations(
            A_m=known.A_m,
            b=known.b,
            c=np.eye(known.n)[0] if self.output is None else validate.vector("output", self.output, known.n),
            normalization=self.normalization,
            feedforward_only=self.feedforward_only,
            gains=ControlGains.of(self, known),
        )
