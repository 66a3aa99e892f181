"""A contest as rows of tables, for the page and for the terminal."""

from __future__ import annotations

import numpy as np

from barbalat.comparison.contest.result import Contest, Paired
from barbalat.comparison.contest.tuned import Qualified
from barbalat.comparison.plants import drawn_from
from barbalat.report.omissions import grouped_omissions
from barbalat.report.terminal.layout import Screen
from barbalat.study.verdicts import Criterion
from barbalat.validate import counted

FAILURES = ("entrant", "failed", "up to", "diverged", "delay", "gain up", "gain down")
"""Columns of ``failures``."""
SUMMARY = ("entrant", "failed", "median error", "delay [s]", "gain")
"""Columns of ``summary``: failed runs, the median error of the others, the measured margins of the tuning."""
MARGINS = ("entrant", "meets", "error", "delay [s]", "gain up", "gain down", "slack")
ERRORS = ("entrant", "median", "nine in ten", "worst", "max |u|")
PAIRS = ("first", "second", "ratio", "from", "to", "better", "worse")
OWN = ("entrant", "tuning", "its own objective", "change by the second half of the trials")


def rule(found: Contest) -> str:
    """The rule in a sentence."""
    asked = found.rule
    until = "the loop begins to oscillate" if asked.until is Criterion.ONSET else "the motion is lost"
    return (
        f"the rule chooses for each scheme the tuning with the smallest RMS |e| among those that tolerate "
        f"{asked.delay_margin:g} s of added delay and an input gain multiplied or divided by {asked.gain_margin:g} before "
        f"{until}. A tuning must tolerate them both with and without noise. "
        f"Error and margins are those of the worst of {counted(len(found.thetas), 'plant')}. Each scheme tries at most "
        f"{counted(asked.trials, 'tuning')}, on the same plants, command and noise"
    )


def held_out(found: Contest) -> str:
    """A sentence on the validation runs of the tuned schemes."""
    return (
        f"{counted(len(found.draws), 'plant')} of {drawn_from(found.problem)} that no tuning used, with a command "
        f"{found.draws.words}, and new noise"
    )


def verdicts(found: Contest) -> list[tuple[str, str, bool]]:
    """Return for each entrant its name, one sentence on its tuning, and whether the tuning meets the rule."""
    rows = []
    for one in found.entrants:
        held = found.held_out.get(one.name)
        failed = "does not satisfy the rule" if held is None else f"{int(held.lost.sum())} of {len(held.lost)} runs failed"
        margins = f"tolerates {one.delay_margin_measured:.3g} s, gain {one.gain_margin_measured:.3g}"
        rows.append((one.name, f"{one.verdict}; {margins}; {failed}", held is not None))
    return rows


def summary(found: Contest) -> list[list[str]]:
    """Return a row for each entrant: failed validation runs, the median of the error, and the margins measured on the worst
    tuning plant."""
    rows = []
    for one in found.entrants:
        held = found.held_out.get(one.name)
        runs = ["-", "-"] if held is None else [str(int(held.lost.sum())), _number(held.quantiles["median"])]
        rows.append([one.name, *runs, f"{one.delay_margin_measured:.3g}", f"{one.gain_margin_measured:.3g}"])
    return rows


def failures(found: Contest) -> list[list[str]]:
    """Return a row for each entrant that meets the rule. It contains the failed runs, with the upper end of their fraction, the
    diverged runs, and the runs that do not tolerate the delay and gains of the rule."""
    rows = []
    for name, held in found.held_out.items():
        counted = held.failures
        high = counted["lost"].interval[1]
        others = [str(counted[key].count) for key in ("diverged", "delay", "gain_up", "gain_down")]
        rows.append([name, str(counted["lost"].count), f"{100 * high:.2g} %", *others])
    return _in_order(found, rows)


def margins(found: Contest) -> list[list[str]]:
    """Return a row for each entrant: the error on the worst tuning plant relative to the motion of the model, the margins, and
    the smallest slack."""
    rows = []
    for one in found.entrants:
        kept = one.margins[found.rule.until]
        slack = min(kept.slack(found.rule).values())
        error = _number(one.error / found.motion)
        yes = "yes" if one.meets else "no"
        rows.append([one.name, yes, error, f"{kept.delay:.3g}", f"{kept.gain_up:.3g}", f"{kept.gain_down:.3g}", f"{slack:.3g}"])
    return rows


def errors(found: Contest) -> list[list[str]]:
    """Return a row for each entrant that meets the rule: quantiles of the error and the median of max |u| over all validation
    runs."""
    rows = []
    for name, held in found.held_out.items():
        of = held.quantiles
        rows.append([name, *(_number(of[key]) for key in ("median", "upper_tenth", "worst")), _number(held.largest_control)])
    return _in_order(found, rows)


def pairs(found: Contest, *, neighbours: bool) -> list[list[str]]:
    """Return a row for each pair of entrants, or, with ``neighbours``, only for each entrant and the next one."""
    names = [one.name for one in found.entrants]
    chosen = [one for one in found.pairs if not neighbours or names.index(one.second) == names.index(one.first) + 1]
    return [[one.first, one.second, *_ratio(one), str(one.better.count), str(one.worse.count)] for one in chosen]


def own(found: Contest) -> list[list[str]]:
    """Return a row for each entrant: the tuning, the quantities that designers examine, and by how much the second half of the
    trials improved the error."""
    return [[one.name, tuning(one), _own(one), _settled(one)] for one in found.entrants]


def tuning(one: Qualified) -> str:
    """The parameters chosen for an entrant, keyed by name."""
    return ", ".join(f"{name} {value:.4g}" for name, value in one.tuning.items()) or "not tuned"


def _ratio(one: Paired) -> list[str]:
    return [_number(one.ratio), _number(one.interval[0]), _number(one.interval[1])]


def _own(one: Qualified) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in one.own.items()) or "no single objective"


def _settled(one: Qualified) -> str:
    if one.settled is None:
        return "rule met only then" if one.meets else "-"
    return f"{100 * one.settled:.2g} %"


def _number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "failed"


def _in_order(found: Contest, rows: list[list[str]]) -> list[list[str]]:
    order = [one.name for one in found.entrants]
    return sorted(rows, key=lambda row: order.index(row[0]))


def show(screen: Screen, found: Contest) -> None:
    """Print the verdicts, the summary, the rule, and the further tables."""
    screen.line(f"{found.problem.name}: {counted(len(found.entrants), 'scheme')} tuned by one rule", "bold")
    for name, sentence, meets in verdicts(found):
        screen.line(f"{screen.name(name)}: {sentence}", "green" if meets else "red", indent="    ", start="  ")
    screen.table(SUMMARY, [[screen.name(name), *cells] for name, *cells in summary(found)])
    screen.line("")
    screen.line(f"Rule: {rule(found)}.")
    screen.line(f"Validation: {held_out(found)}.")
    for heading, columns, rows in (
        ("Validation runs that failed or do not tolerate the delay and gains of the rule", FAILURES, failures(found)),
        ("Under the rule", MARGINS, margins(found)),
        ("RMS |e| over RMS |x_m| of the validation runs", ERRORS, errors(found)),
        ("Ratio of the errors on the same runs, 95 % interval", PAIRS, pairs(found, neighbours=True)),
    ):
        if rows:
            screen.title(heading)
            screen.table(columns, [[screen.name(name), *cells] for name, *cells in rows])
    screen.title("Tunings")
    for name, numbers, objective, _ in own(found):
        screen.line(f"{name}: {numbers}; {objective}", indent="    ")
    screen.line("")
    for note in grouped_omissions((*found.notes, *found.left_out)):
        screen.line(f"Note: {note}.", "yellow")
    screen.line(f"{found.seconds:.0f} s. Measured on these plants and commands; not a guarantee.")
