"""What an adaptive law for the linear parametric model z = theta'phi is. One law per file; the registry is ``laws``."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from barbalat.problem.known_set import KnownSet
from barbalat.protocols import Value


class Estimation(NamedTuple):
    """The linear parametric model z = theta'phi, (13), at one instant; all of it is measured."""

    phi: Value  # (n,) regressor
    m_s_squared: Value  # normalising signal
    epsilon: Value  # estimation error (z - theta_hat'phi)/m_s^2


class Rates(NamedTuple):
    """Time derivatives of what a law integrates."""

    theta_hat: Value  # (n,)
    memory: Any  # as ``AdaptiveLaw.initial`` has it


class AdaptiveLaw(Protocol):
    """A law gives the rates of the estimate and of its own memory: a NamedTuple of arrays, or () for a law without one."""

    def initial(self, n: int) -> Any:
        """The memory at t = 0 for n parameters; InputError where the settings don't fit n."""
        ...

    def rates(self, theta_hat: Value, memory: Any, estimation: Estimation, known_set: KnownSet | None) -> Rates: ...

    def limit(self, memory: Any) -> Any:
        """The memory as it is used at every stage of every solver: resets and bounds stand here."""
        ...
