"""The paper's statements on its figures as checks of runs."""

from __future__ import annotations

import numpy as np

from barbalat.papers.paper_figure import Check
from barbalat.papers.wording import numbers
from barbalat.run.results.result import Result
from barbalat.validate import Array

DRAWN_SHARE = 0.1
"""Of an amplitude, within which it is proportional to a setting where a figure is described: a caption says what is seen of a
curve, no more. The row ``bias-kappa`` takes the same word for a law."""
PARAMETER_BOUND = 5.0
"""Of each component of theta_hat, on either side."""


def of_run(result: Result, name: str) -> Array:
    """A figure as an array; entries without a finite value are NaN, which no comparison lets pass."""
    return np.array(result.figures[name], dtype=float)


def error_converges(early: Array, tail: Array) -> Check:
    """To zero in 60 s: two decades below the first quarter's error in every component."""
    return Check(
        "the tracking error converges to zero",
        bool((tail < early / 100).all()),
        f"max |e| {numbers(early)} in the first quarter, {numbers(tail)} in the last",
    )


def error_stays(result: Result) -> Check:
    """The tail is no smaller than the whole run."""
    peak, tail = of_run(result, "max_abs_e"), of_run(result, "tail_max_abs_e")
    return Check(
        "the tracking error does not converge to zero",
        bool((tail > peak / 2).all()),  # in the last quarter it is still of the size of its largest value
        f"max |e| {numbers(peak)}, in the last quarter still {numbers(tail)}",
    )


def sweeps_the_bounds(result: Result) -> Check:
    """The estimates run from bound to bound without end."""
    least, most = of_run(result, "theta_hat_tail_min"), of_run(result, "theta_hat_tail_max")
    rate = of_run(result, "theta_hat_variation_rate")
    sweeps = rate / (2 * 2 * PARAMETER_BOUND)  # there and back across the box, per second
    permanent = bool((least == -PARAMETER_BOUND).all() and (most == PARAMETER_BOUND).all() and (sweeps > 100).all())
    return Check(
        "the estimates oscillate permanently between the projection bounds, with no learning",
        permanent,  # both bounds reached, hundreds of sweeps a second where the command makes one in 12 s
        f"tail from {numbers(least)} to {numbers(most)}, total variation worth {numbers(sweeps)} full sweeps per s",
    )


def diverges(result: Result) -> Check:
    """A run without projection leaves all bounds."""
    at = result.diverged_at
    return Check(
        "without projection all signals go unbounded",
        at is not None,
        "bounded" if at is None else f"diverged at t = {at:.4f} s",
    )


def bounded(result: Result, statement: str) -> Check:
    """A run to its end."""
    at = result.diverged_at
    return Check(
        statement, at is None, f"max |e| {numbers(of_run(result, 'max_abs_e'))}" if at is None else f"diverged at t = {at:.4f} s"
    )
