"""The Lyapunov laws of MRAC (4) and L1-AC (7), with their modifications."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from barbalat import validate
from barbalat.adaptation.learning import CompositeLearning
from barbalat.adaptation.modifications import Borne, DeadZone, Leakage, accept_dead_zone, accept_leakage
from barbalat.problem.known_set import EstimateSet, Gain, project
from barbalat.protocols import Value
from barbalat.roles import Role
from barbalat.validate import Array, InputError


class ModifiedSettings(Protocol):
    """Settings of a scheme whose law may be modified."""

    @property
    def leakage(self) -> Leakage | None: ...

    @property
    def dead_zone(self) -> DeadZone | None: ...

    @property
    def learning(self) -> CompositeLearning | None: ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Modifications:
    """theta_hat' = proj(Gamma (a Phi(x) b'P e + gamma_c (Q - R theta_hat) - w theta_hat)); each part is off unless given.

    leakage    w, with error = a e'P b
    dead_zone  a, on sqrt(e'P e)
    learning   the memory Q, R of composite learning
    """

    leakage: Leakage | None = None
    dead_zone: DeadZone | None = None
    learning: CompositeLearning | None = None

    def __post_init__(self) -> None:
        accept_dead_zone(self.dead_zone)
        if self.learning is None:
            accept_leakage(self.leakage, "the Lyapunov law")
            return
        validate.instance("learning", self.learning, CompositeLearning)
        accept_leakage(self.leakage, "composite learning", Borne.BOUNDED, "its V' is not proportional to the present error")
        if self.dead_zone is not None:
            raise InputError(
                "a dead zone can't go with composite learning: the memory keeps adapting inside the zone, on data that hold "
                "what the zone is to keep out"
            )

    @classmethod
    def of(cls, settings: ModifiedSettings) -> Modifications:
        """InputError for what can't go together."""
        return cls(leakage=settings.leakage, dead_zone=settings.dead_zone, learning=settings.learning)

    @property
    def roles(self) -> Mapping[str, Role]:
        """Of the memory of composite learning."""
        return {} if self.learning is None else self.learning.roles

    def initial(self, b: Array, x0: Array, parameters: int) -> Any:
        """The memory at t = 0: () without learning."""
        return () if self.learning is None else self.learning.initial(b, x0, parameters)

    def memory_rates(self, memory: Any, A_m: Array, b: Array, x: Value, phi: Value, u: Value) -> Any:
        """``u`` is what enters besides theta'phi."""
        return memory if self.learning is None else self.learning.rates(memory, A_m, b, x, phi, u)

    def require_fit(self, inputs: int) -> None:
        """InputError for a modification that is known for one input only."""
        leakage = self.leakage if self.leakage is not None and self.leakage.one_input_only else None
        for part in (self.learning, leakage):
            if inputs > 1 and part is not None:
                raise InputError(f"{type(part).__name__} takes plants with one input, got {inputs}")

    def rate(
        self, gamma: Gain, e: Value, P: Array, b: Array, phi: Value, theta_hat: Value, memory: Any, known_set: EstimateSet | None
    ) -> Value:
        """theta_hat' for the error ``e``: of tracking for MRAC, of prediction for L1-AC."""
        error = e @ (P @ b)
        if self.dead_zone is not None:
            error = error * self.dead_zone.weight(e @ (P @ e))
        rate = gamma.scaled(error, phi) if len(phi.shape) == 1 else gamma.times(phi @ error)
        if self.learning is not None:
            rate = rate + gamma.times(self.learning.pull(memory, theta_hat))
        if self.leakage is not None:
            rate = rate - gamma.times(self.leakage.coefficient(theta_hat, error) * theta_hat)
        return project(rate, theta_hat, known_set, gamma)
