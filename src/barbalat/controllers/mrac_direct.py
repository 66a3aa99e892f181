"""Direct MRAC, which also adapts its feedforward gain. Only the sign of the input gain needs to be known, and no signal is
divided by an estimate of it."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

from barbalat.controllers.control_gains import ControlGains, GainEquations, check_gains
from barbalat.controllers.settings import Scheme
from barbalat.controllers.tuning_grid import TuningGrid, TuningScale
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.validate import Array, Vector


class State(NamedTuple):
    """The controller's states."""

    theta_hat: Value  # (p,) the feedback gains, estimate of k_x = theta/omega
    k_r_hat: Value  # (1,) the feedforward gain, estimate of k_r = k_0/omega


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations(GainEquations):
    """The Lyapunov law of both gains, driven by the tracking error; the gain omega > 0 in b omega u does not occur in the law."""

    b: Array
    P: Array
    gains: ControlGains

    def initial(self) -> State:
        return State(self.gains.theta_hat0, self.gains.k_r0)

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        e_P_b = (x - x_m) @ (self.P @ self.b)
        return State(*self.gains.rates(e_P_b, self.gains.matched.phi(x), r, *state))

    def limit(self, state: State) -> State:
        return State(*self.gains.limited(*state))


@dataclass(frozen=True, eq=False)
class DirectMrac(Scheme):
    """u = -k_x_hat'phi(x) + k_r_hat r, k_x_hat' = proj(Gamma (e'P b) phi(x)), k_r_hat' = proj(-gamma_r (e'P b) r).

    The plant's input may have any effectiveness omega > 0: its sign is that of b, and nothing else about it needs to be known.
    The estimates are of k_x = theta/omega, reported as theta_hat, and k_r = k_0/omega, reported as k_r_hat. With several inputs
    each has its own omega, so the plant's input matrix is b diag(omega): factors may be unknown, but the coupling of inputs must
    be known.

    gamma       adaptive gain Gamma > 0 of the feedback: a number, a diagonal (p,) or an s.p.d. matrix (p, p); with m inputs a
                number or a diagonal (p m,)
    gamma_r     adaptive gain of the feedforward, > 0; by default gamma, if that is a number
    theta_hat0  k_x_hat(0), (p,), zero by default; inside the known set
    k_r0        k_r_hat(0), with m inputs (m, q); by default k_0, or the nearest value that the interval of the input gain allows
    projection  onto the known set divided by the input gain; on by default if there is a known set

    Source: Ioannou and Sun, Robust Adaptive Control, section 6.2; Lavretsky and Wise, Robust and Adaptive Control, section 9.2;
    for first order Astrom and Wittenmark, Adaptive Control, example 5.7.
    """

    gamma: float | Array
    _: KW_ONLY
    gamma_r: float | None = None
    theta_hat0: Vector | None = None
    k_r0: float | Array | None = None
    projection: bool | None = None
    name: str = "Direct MRAC"

    def __post_init__(self) -> None:
        check_gains(self)

    @classmethod
    def knobs(cls, reach: TuningScale) -> TuningGrid:
        return TuningGrid(
            scheme="Direct MRAC",
            values={"gamma": reach.gains(1e-8, 8 * reach.density)},
            make=lambda gamma: cls(gamma=gamma, theta_hat0=reach.theta_hat0),
            traded=False,
            aims=("error_bound",),
        )

    def bind(self, known: Known) -> Equations:
        return Equations(b=known.b, P=known.P, gains=ControlGains.of(self, known))
