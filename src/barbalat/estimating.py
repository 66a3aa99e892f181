"""What a scheme's equations may say of their estimates: what excites them, how they are called, what would be ideal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from barbalat.protocols import Value

if TYPE_CHECKING:
    from barbalat.validate import Array


@runtime_checkable
class Estimating(Protocol):
    """Equations, sampled or not, of a scheme that estimates, and whose excitation can therefore be measured along a run."""

    def regressor_at(self, state: Any, x: Value, u: Value) -> Value:
        """What multiplies the parameters in the law, (p,) or (p, m); normalised where the law normalises it."""
        ...


@runtime_checkable
class GainEstimating(Protocol):
    """Equations whose theta_hat are the controller's own gains: they are compared with the ideal ones, not with theta."""

    def ideal_gains(self, theta: Array, omega: Array) -> Array | None:
        """(p,), with which plant and controller are the model; omega (m,) is the effectiveness of the plant's inputs.

        None where none are known to be that.
        """
        ...


@runtime_checkable
class NamingEstimates(Protocol):
    """Equations whose theta_hat are no parameters theta_1, theta_2, ...: tables and pictures call them by these names."""

    @property
    def estimate_names(self) -> tuple[str, ...]:
        """(p,), without a hat: "k_x,1"; an index stands behind an underscore."""
        ...


@runtime_checkable
class Reporting(Protocol):
    """Equations, sampled or not, with estimates that are no parameters: results have them under names of their own."""

    def reported(self, state: Any) -> dict[str, Value]:
        """By name, parts of the state or what follows from it alone."""
        ...


@runtime_checkable
class IdealReporting(Reporting, Protocol):
    """Equations of which is known what is ideal of what they report."""

    def ideal_reported(self, theta: Array, omega: Array) -> dict[str, Array]:
        """By the names of ``reported``, with which plant and controller are the model; as of ``ideal_gains``."""
        ...
