"""What the leakage terms -Gamma w theta_hat have in common, and the refusal where a law does not bear one."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum
from typing import Protocol, runtime_checkable

from barbalat.adaptation.modifications.epsilon_modification import EpsilonModification
from barbalat.adaptation.modifications.fixed_sigma import FixedSigma
from barbalat.adaptation.modifications.switching_sigma import SwitchingSigma
from barbalat.protocols import Value
from barbalat.validate import InputError, show

LEAKAGES = (FixedSigma, SwitchingSigma, EpsilonModification)
"""What case files choose from."""


@runtime_checkable
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
    def per_error(self) -> float | None:
        """nu of a leakage w = nu |error|, which bounds the estimates whatever drives them; None for any other."""
        ...

    @property
    def harmless_within(self) -> float | None:
        """The bound of |theta|_2 up to which V decreases as without it; None where it takes convergence to zero."""
        ...

    @property
    def one_input_only(self) -> bool:
        """Whether the error must be a scalar."""
        ...

    def over_sample(self, theta_hat: Value, error: Value, solve: Callable[[Value], Value]) -> Value:
        """w for one sample, held; ``error`` is that before the estimates move, ``solve(w)`` the estimate at the end."""
        ...


class Borne(Enum):
    """Which leakages a law bears, with the package's own that are of the kind."""

    ALL = "FixedSigma, SwitchingSigma or EpsilonModification"
    BOUNDED = "FixedSigma or SwitchingSigma"
    HARMLESS = "SwitchingSigma"

    def includes(self, leakage: Leakage) -> bool:
        bounded, harmless = math.isfinite(leakage.largest), leakage.harmless_within is not None
        return {Borne.ALL: True, Borne.BOUNDED: bounded, Borne.HARMLESS: bounded and harmless}[self]


def accept(leakage: Leakage | None, law: str, borne: Borne = Borne.ALL, reason: str = "") -> None:
    """InputError for what is no leakage, and, with the reason, for one that the law does not bear."""
    if leakage is None:
        return
    if not isinstance(leakage, Leakage) or isinstance(leakage, type):  # type: ignore[redundant-expr]
        raise InputError(f"leakage must be a {Borne.ALL.value}, got {show(leakage)}")
    if not borne.includes(leakage):
        raise InputError(f"{type(leakage).__name__} can't go with {law}: {reason}; {borne.value} can")
