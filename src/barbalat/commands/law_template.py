"""MyLaw: MRAC with a regressor, projection and compensation of the actuator's limits, as a starting point for your own law.

barbalat run paper --controllers FILE      simulates it with the controllers of the case "paper"
python FILE                                checks it with the test at the end

Is it better than another law? Equal gains do not make laws comparable, and the gain here differs from those of the cases.
Compare the laws after equal tuning effort, over the values that ``knobs`` declares (CASE is a case with a known set):

barbalat contest CASE --controllers FILE --schemes mrac l1 --quick
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from barbalat import InputError
from barbalat.interfaces import EstimateSet, Known, Role, TuningGrid, TuningScale, Value


class State(NamedTuple):
    """The state that the controller integrates."""

    theta_hat: Value  # (p,) the estimates of theta
    e_d: Value  # (n,) the part of the tracking error due to the actuator limits


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of the law for one plant, in which everything but theta is known. They are evaluated on numbers and on
    symbols, so they must not branch on values; use np.where, np.clip and np.minimum instead.
    """

    gamma: float
    known: Known

    # The roles of the state's fields. theta_hat needs no entry, because by convention it contains the estimates of theta. A
    # freeze holds estimates and memory. Role also offers memory, predictor and filter.
    roles: ClassVar[Mapping[str, Role]] = {"e_d": Role.other("error caused by the input limits")}

    @property
    def estimate_set(self) -> EstimateSet | None:
        """The set onto which the estimates are projected; None if the problem has none."""
        return self.known.estimate_set

    def initial(self) -> State:
        """Return the state at t = 0."""
        start = np.zeros(self.known.parameters)
        return State(start if self.known.estimate_set is None else self.known.estimate_set.limit(start), np.zeros(self.known.n))

    def control(self, state: State, x: Value, x_m: Value, r: Value) -> Value:
        """Return u = k_0 r - theta_hat'phi(x)."""
        return np.dot(self.known.k_0, r) - self.known.matched.phi(x).T @ state.theta_hat

    def derivative(self, state: State, x: Value, x_m: Value, r: Value, u: Value) -> State:
        """Return the derivative of the state. u is the result of ``control``, before the actuator limits."""
        known, phi = self.known, self.known.matched.phi(x)
        reaches = u if known.saturation is None else np.clip(u, *known.saturation)
        e = x - x_m - state.e_d  # without the part due to the limits, which carries no information
        theta_hat_dot = self.gamma * np.dot(phi, e @ known.P @ known.b)
        if known.estimate_set is not None:
            theta_hat_dot = known.estimate_set.project(theta_hat_dot, state.theta_hat)
        return State(theta_hat_dot, known.A_m @ state.e_d + np.dot(known.b, reaches - u))

    def limit(self, state: State) -> State:
        """Return the state with its estimates inside the set, which a stage of the solver may leave."""
        return (
            state if self.known.estimate_set is None else state._replace(theta_hat=self.known.estimate_set.limit(state.theta_hat))
        )

    def regressor_at(self, state: State, x: Value, u: Value) -> Value:
        """Return the regressor, which multiplies theta. Its excitation is measured along runs."""
        return self.known.matched.phi(x)


@dataclass(frozen=True)
class MyLaw:
    """u = k_0 r - theta_hat'phi(x), theta_hat' = proj(gamma ((e - e_d)'P b) phi(x)), e_d' = A_m e_d + b (sat(u) - u).

    gamma  adaptive gain > 0
    """

    gamma: float = 10.0
    name: str = "MyLaw"

    def bind(self, known: Known) -> Equations:
        """Return the equations for what is known about a plant. Raises InputError for a plant that the law does not support."""
        if known.matched.gain_unknown:
            raise InputError(f"{self.name} supports only plants with a known input gain")
        # If your equations are for one input only, reject others:
        # if known.inputs > 1:
        #     raise InputError(f"{self.name} supports only plants with one input")
        return Equations(self.gamma, known)

    def knobs(self, reach: TuningScale) -> TuningGrid:
        """Return the settings that a trade-off or a contest varies, with their ranges: here, gains up to the largest one that the
        step resolves."""
        gains = reach.gains(1e-8, 8 * reach.density)
        return TuningGrid(scheme=self.name, values={"gamma": gains}, make=lambda gamma: replace(self, gamma=gamma))


CONTROLLERS = [MyLaw(gamma=10.0)]  # --controllers adds these to a case


def test_law() -> None:
    """Check symbols against numbers, runs against SciPy, ensembles, a freeze and the exported C, on problems of every kind."""
    from barbalat.testing import check

    print(check(MyLaw()))


if __name__ == "__main__":
    from barbalat.testing import CheckFailed

    try:
        test_law()
    except CheckFailed as failed:
        raise SystemExit(str(failed)) from None
