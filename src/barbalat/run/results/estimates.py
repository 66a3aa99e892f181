"""The estimates of a run with readable names: theta_hat (or gains in its place) and additionally reported estimates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from barbalat.loop.true_values import estimate_names, truth_of
from barbalat.validate import Array

if TYPE_CHECKING:
    from barbalat.run.results.result import Result

MOST_REPORTED = 6
"""Largest number of entries under one name that are shown separately, which is the number of colours; files contain all
entries."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """One estimate over the recorded instants.

    name       without a hat: "theta_1", "k_r"
    true       its true value; None if it is unknown
    number     its index in theta_hat; None for an additionally reported estimate
    low, high  (K - 1,) extrema between the instants, if they are known
    """

    name: str
    value: Array  # (K,)
    true: float | None
    number: int | None = None
    low: Array | None = None
    high: Array | None = None

    @property
    def label(self) -> str:
        """The name with its hat, as TeX."""
        return label_of(self.name)

    @property
    def symbol(self) -> str:
        """The symbol without its hat."""
        symbol, _, index = self.name.partition("_")
        return f"{GREEK_NAMES.get(symbol, symbol)}_{{{index}}}" if index else GREEK_NAMES.get(symbol, symbol)


def label_of(name: str) -> str:
    """The name of an estimate with its hat, as TeX."""
    symbol, _, index = name.partition("_")
    letter = GREEK_NAMES.get(symbol, symbol)
    return rf"$\hat{{{letter}}}_{{{index}}}$" if index else rf"$\hat{{{letter}}}$"


GREEK_NAMES = {name: rf"\{name}" for name in ("theta", "sigma", "omega")}


def estimates_of(result: Result) -> list[Estimate]:
    """The estimates in theta_hat first, then the additional ones with at most ``MOST_REPORTED`` entries."""
    true, envelope = result.true_values, result.envelope
    found = [
        Estimate(
            name=name, value=result.theta_hat[:, i], true=None if true is None else float(true[i]), number=i,
            low=envelope.theta_hat_min[:, i], high=envelope.theta_hat_max[:, i],
        )
        for i, name in enumerate(estimate_names(result.problem, result.loop))
    ]  # fmt: skip
    for part in result.loop.other_estimates:
        if part.size > MOST_REPORTED:
            continue
        entries, becomes = result.states[:, part.rows], truth_of(result.problem, part)
        found += [
            Estimate(name=one, value=entries[:, i], true=None if becomes is None else float(becomes[i]))
            for i, one in enumerate(part.names)
        ]
    return found
