"""What the leakage terms -Gamma w theta_hat have in common, and the refusal where a law does not bear one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from barbalat.adaptation.modifications.epsilon_modification import EpsilonModification
from barbalat.adaptation.modifications.fixed_sigma import FixedSigma
from barbalat.adaptation.modifications.switching_sigma import SwitchingSigma
from barbalat.protocols import Value
from barbalat.validate import InputError, show

LEAKAGES = (FixedSigma, SwitchingSigma, EpsilonModification)
SIGMA_LEAKAGES = (FixedSigma, SwitchingSigma)
SWITCHING_LEAKAGES = (SwitchingSigma,)


class Leakage(Protocol):
    """A leakage w >= 0; the law becomes theta_hat' = proj(Gamma (epsilon phi - w theta_hat))."""

    def coefficient(self, theta_hat: Value, error: Value) -> Value:
        """w; ``error`` is the scalar that drives the law: epsilon m_s, or e'P b."""
        ...

    @property
    def largest(self) -> float:
        """The largest w there can be [1/s per unit of gain]; infinite where nothing bounds it."""
        ...

    @property
    def harmless_within(self) -> float | None:
        """The bound of |theta|_2 up to which V decreases as without it; None where it takes convergence to zero."""
        ...

    def over_sample(self, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
        """w for one sample, held; ``error`` is that before the estimates move, ``solve(w)`` the estimate at the end."""
        ...


def accept(leakage: Leakage | None, law: str, kinds: tuple[type, ...] = LEAKAGES, reason: str = "") -> None:
    """InputError for what is no leakage, and, with the reason, for one that the law does not bear."""
    if leakage is None or isinstance(leakage, kinds):
        return
    if isinstance(leakage, LEAKAGES):
        borne = " or ".join(kind.__name__ for kind in kinds)
        raise InputError(f"{type(leakage).__name__} can't go with {law}: {reason}; {borne} can")
    raise InputError(f"leakage must be a FixedSigma, SwitchingSigma or EpsilonModification, got {show(leakage)}")
