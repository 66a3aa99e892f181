"""A trade-off in words and numbers: tables, a sentence on the ranking and the JSON document."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.comparison.tradeoff.picture import TITLES, panels, tuning_text
from barbalat.comparison.tradeoff.tradeoff import Cloud, TradeOff
from barbalat.pictures.symbols import held, number_text
from barbalat.report.omissions import grouped_omissions
from barbalat.report.terminal.layout import Screen

ERRORS = (1e-3, 1e-2, 3e-2, 0.1, 0.3)
"""Tracking errors at which the schemes are compared, relative to the model's motion."""


def as_document(found: TradeOff) -> dict[str, Any]:
    """Return everything that was measured as plain numbers, with None for values that are not finite."""
    return {
        "case": found.problem.name,
        "simulation": found.simulation.as_json(),
        "thetas": found.thetas.tolist(),
        "runs": found.runs,
        "notes": list(found.notes),
        "seconds": found.seconds,
        "criteria": {"onset": {"cycle": found.by.judge.cycle}, "loss": {"share": found.by.lost.share}},
        "finer_step": {one.scheme: one.as_json() for one in found.checks},
        "schemes": {
            cloud.scheme: {
                "tunings": list(cloud.tunings),
                "error": [[value if np.isfinite(value) else None for value in row] for row in cloud.error.tolist()],
                "onset": cloud.onset.tolist(),
                "loss": cloud.loss.tolist(),
                "front": {which: {name: cloud.front(which, name).tolist() for name in ("onset", "loss")} for which in TITLES},
            }
            for cloud in found.clouds
        },
    }


def rows(found: TradeOff, which: str, criterion: str) -> list[tuple[str, ...]]:
    """Return table rows with the ends and the middle of each front."""
    lines: list[tuple[str, ...]] = []
    for cloud in found.clouds:
        error, margin = cloud.at(which, criterion)
        front = cloud.front(which, criterion)
        for i in dict.fromkeys([*front[:1], *front[len(front) // 2 : len(front) // 2 + 1], *front[-1:]]):
            lines.append(
                (
                    cloud.scheme,
                    tuning_text(cloud.tunings[i]) or "not tuned",
                    number_text(float(error[i])),
                    number_text(float(margin[i])),
                )
            )
    return lines


def at_equal_error(found: TradeOff, which: str) -> list[tuple[str, ...]]:
    """Return table rows with the largest delay that each scheme tolerates at each error of ``ERRORS``, by both criteria."""
    return [
        (f"{error:g}", *(_tolerated(found, cloud, which, name, error) for name in ("onset", "loss") for cloud in found.clouds))
        for error in ERRORS
    ]


def _tolerated(found: TradeOff, cloud: Cloud, which: str, criterion: str, error: float) -> str:
    delay = cloud.tolerates(which, criterion, error)
    if np.isnan(delay):
        return "no tuning"
    return f"{delay:.3g}" if delay > 0 else f"< {found.shortest:.3g}"


def ranking(found: TradeOff, which: str) -> str:
    """Return a sentence that lists the errors at which the order of the schemes depends on the criterion."""
    head, parts = orders(found, which)
    return f"{head}: {'; '.join(parts)}." if parts else f"{head}."


def orders(found: TradeOff, which: str) -> tuple[str, list[str]]:
    """Return the sentence for all errors, and the sentences for each error."""
    orders = {error: [_order(found, which, name, error) for name in ("onset", "loss")] for error in ERRORS}
    known = {error: pair for error, pair in orders.items() if len(pair[0]) > 1}
    parts = [
        f"at an error of at most {error:g} {_text(a)} by " + ("both criteria" if a == b else f"the onset, {_text(b)} by the loss")
        for error, (a, b) in known.items()
    ]
    if not parts:
        return "No two schemes reach a common error", []
    differ = sum(a != b for a, b in known.values())
    head = "The order does not depend on the criterion" if differ == 0 else "The order of the schemes depends on the criterion"
    return f"{head} (tolerated delay, largest first)", parts


def _order(found: TradeOff, which: str, criterion: str, error: float) -> list[list[str]]:
    """Return the schemes sorted by the tolerated delay, the largest first. Schemes within the resolution of the bisection form
    one group."""
    delays = {cloud.scheme: cloud.tolerates(which, criterion, error) for cloud in found.clouds}
    groups: list[list[str]] = []
    last = np.nan
    for scheme, delay in sorted(((s, d) for s, d in delays.items() if not np.isnan(d)), key=lambda pair: -pair[1]):
        if groups and delay >= last / EQUAL_DELAYS_RATIO:
            groups[-1].append(scheme)
        else:
            groups.append([scheme])
            last = delay
    return [sorted(group) for group in groups]


EQUAL_DELAYS_RATIO = 1.05
"""Ratio within which two delays count as equal. It corresponds to two brackets of 2 %."""


def _text(order: list[list[str]]) -> str:
    return ", ".join(" = ".join(group) for group in order)


def show(screen: Screen, found: TradeOff) -> None:
    """Print a table, the order of the schemes, and the omissions."""
    schemes = [cloud.scheme for cloud in found.clouds]
    screen.line(f"{found.problem.name}: the delay [s] that the plant's input tolerates", "bold")
    screen.line(
        f"Each entry is the largest delay that is tolerated by any tuning with a relative error, RMS |e| / RMS |x_m|, of at most "
        f"the value in the first column. Onset: the loop begins to oscillate. Loss: its error grows by {found.by.lost.share:g} "
        f"max |x_m| or the run is lost. Either may come first."
    )
    headings = ("error", *(f"{criterion}:\n{scheme}" for criterion in ("onset", "loss") for scheme in schemes))
    for which in reversed(panels(found)):
        screen.title(TITLES[which].capitalize(), "")
        screen.table(headings, at_equal_error(found, which))
        head, parts = orders(found, which)
        screen.line(f"{head}:" if parts else f"{head}.")
        for part in parts:
            for scheme in schemes:
                part = part.replace(scheme, held(scheme))  # noqa: PLW2901
            screen.line(part, indent="    ", start="  ")
    if len(found.thetas) == 1:
        screen.line("All numbers are for the plant of the case; with --plants they are the worst of several plants.")
    for sentence in grouped_omissions(found.notes):
        screen.line(f"Note: {sentence}.", "yellow", "  ")
