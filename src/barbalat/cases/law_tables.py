"""The case file's keys for adaptive laws and their modifications, and the laws that they describe."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Literal

from barbalat.adaptation.laws import LAWS, AdaptiveLaw
from barbalat.adaptation.learning import CompositeLearning
from barbalat.adaptation.modifications.dead_zone import DeadZone
from barbalat.adaptation.modifications.epsilon_modification import EpsilonModification
from barbalat.adaptation.modifications.fixed_sigma import FixedSigma
from barbalat.adaptation.modifications.leakage import Leakage
from barbalat.adaptation.modifications.switching_sigma import SwitchingSigma
from barbalat.adaptation.normalization import Normalization
from barbalat.cases.tables import Gain, Table
from barbalat.validate import InputError

SETTINGS = ("gamma", "covariance0", "forgetting", "covariance_bound", "rho_0", "rho_1")
"""What the laws of the registry are set by, each by some of them."""


class ModificationTable(Table):
    """modification = { ... }; in a law's table the same keys stand beside ``kind``."""

    sigma: float | None = None
    M_0: float | None = None
    nu: float | None = None
    g_0: float | None = None

    def leakage(self) -> Leakage | None:
        """sigma: fixed; sigma and M_0: switching; nu: epsilon-modification."""
        if self.nu is not None:
            if self.sigma is not None or self.M_0 is not None:
                raise InputError("give either sigma (with M_0 for the switching one) or nu, for the epsilon-modification")
            return EpsilonModification(nu=self.nu)
        if self.sigma is None:
            if self.M_0 is not None:
                raise InputError("M_0 goes with sigma, which is missing")
            return None
        return FixedSigma(sigma=self.sigma) if self.M_0 is None else SwitchingSigma(sigma=self.sigma, M_0=self.M_0)

    def dead_zone(self) -> DeadZone | None:
        return None if self.g_0 is None else DeadZone(g_0=self.g_0)


class LearningTable(Table):
    """learning = { ... }."""

    gamma_c: float
    time_constant: float
    forgetting: float = 0.0
    capacity: float | None = None

    def build(self) -> CompositeLearning:
        return CompositeLearning(**dict(self))


class LawTable(ModificationTable):
    """law = { kind = ... }."""

    kind: Literal[
        "gradient",
        "integral-cost",
        "least-squares",
        "least-squares-forgetting",
        "least-squares-resetting",
        "least-squares-bounded",
        "least-squares-bounded-gain",
    ]
    gamma: Gain | None = None
    covariance0: Gain | None = None
    forgetting: float | None = None
    covariance_bound: float | None = None
    rho_0: float | None = None
    rho_1: float | None = None

    def build(self) -> AdaptiveLaw:
        """The law; InputError for a key that it needs and lacks, or that means nothing to it."""
        law = LAWS[self.kind]
        takes = {field.name for field in fields(law)}
        given = {key: getattr(self, key) for key in SETTINGS if getattr(self, key) is not None}
        for key in SETTINGS:
            if key in takes and key not in given:
                raise InputError(f"law.{key} is missing; the {self.kind} law needs it")
        for key in given:
            if key not in takes:
                raise InputError(f"law.{key} has no meaning for the {self.kind} law")
        if self.g_0 is not None and "dead_zone" not in takes:
            raise InputError(
                "law.g_0: the integral-cost law follows an integral of past errors, so a dead zone has no error to act on"
            )
        modifications: dict[str, Any] = {"leakage": self.leakage()}
        if "dead_zone" in takes:
            modifications["dead_zone"] = self.dead_zone()
        built: AdaptiveLaw = law(**given, **modifications)
        return built


class NormalizationTable(Table):
    """normalization = { alpha_0 = ..., delta_0 = ... }."""

    alpha_0: float = 0.0
    delta_0: float = 0.1

    def build(self) -> Normalization:
        return Normalization(alpha_0=self.alpha_0, delta_0=self.delta_0)
