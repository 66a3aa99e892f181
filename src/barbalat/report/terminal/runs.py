"""The screen of ``barbalat run``: the tracking, the estimates and the numerics of each controller."""

from __future__ import annotations

from collections.abc import Sequence

from barbalat.judge.settings import component_names
from barbalat.judge.verdict import Class
from barbalat.pictures.symbols import number_text
from barbalat.problem.labels import UNLABELLED, bracketed
from barbalat.report.terminal.layout import Screen, capitalized, grouped
from barbalat.run.results.adapting import Adapting
from barbalat.run.results.estimates import estimates_of
from barbalat.run.results.findings import together
from barbalat.run.results.outcome import about_u
from barbalat.run.results.result import Result
from barbalat.validate import counted

LABEL_COLUMNS = 24
"""Width in columns of a label beside a paragraph."""


MOST_LINES = 30
"""Lines of the short screen at 80 columns for up to three controllers. Findings that do not fit are counted."""
LINES_BEHIND = 3
"""Number of lines that say where the files are."""
FEWEST_FINDING_LINES = 4
"""Smallest number of lines for the findings, whatever the number of controllers."""


def show(screen: Screen, case: str, results: Sequence[Result], room: int = MOST_LINES - LINES_BEHIND) -> None:
    """Print a sentence for each controller, one table, and the findings, without duplicates, as far as they fit into ``room``
    lines of 80 columns."""
    _head(screen, case, results)
    _worst(screen, results)
    _told_together(screen, results, room)


def show_full(screen: Screen, case: str, results: Sequence[Result]) -> None:
    """Print the whole screen, except for the location of the files."""
    _head(screen, case, results)
    _bands(screen, results)
    _tracking(screen, results)
    _responses(screen, results)
    adapting = [(result, result.adapting) for result in results if result.adapting is not None]
    if adapting:
        _estimates(screen, adapting)
        _excitation(screen, adapting)
    _findings(screen, results)


def _head(screen: Screen, case: str, results: Sequence[Result]) -> None:
    """Print the head of the screen: what was simulated, and one sentence for each controller."""
    simulation = results[0].simulation
    count = counted(len(results), "controller")
    screen.line(f"{case}: {count}, {simulation.t_end:g} s, {simulation.how}", "bold")
    for result in results:
        if (verdict := result.verdict) is not None:
            screen.line(f"{screen.name(result.name)}: {verdict}", VERDICT_STYLES[verdict.kind], "  ")
    for result in results:
        if result.accuracy is not None:
            screen.line(f"{screen.name(result.name)}: {result.accuracy.in_brief}", "dim", "  ")
        if result.measured_error is not None:
            screen.line(f"{screen.name(result.name)}: {result.measured_error.sentence}", "dim", "  ")


def _worst(screen: Screen, results: Sequence[Result]) -> None:
    """Print a line for each controller with the component that its verdict names, and the control."""
    labels, names = results[0].problem.labels or UNLABELLED, component_names(results[0].problem)
    measured = any(_values(result, "max_abs_y") for result in results)
    unit = labels.unit(0) if len(names) == 1 else ""
    headings = [
        "controller",
        *([] if len(names) == 1 else ["error in"]),
        f"max |e|\n{unit}".rstrip(),
        "RMS e",
        "max |e|\nin the tail",
    ]
    headings += ["band", f"max |u|\n{labels.every_input_unit}".rstrip(), *(["max |y|"] if measured else [])]
    rows = []
    for result in results:
        verdict = result.verdict
        i = 0 if verdict is None else names.index(verdict.component)
        errors = [_at(_values(result, key), i) for key in ("max_abs_e", "rms_e", "tail_max_abs_e")]
        whose = [] if len(names) == 1 else [f"{names[i]} {labels.unit(i)}".rstrip()]
        y = [_at(_values(result, "max_abs_y"), 0)] if measured else []
        band = "-" if verdict is None else f"{verdict.band:.3g}"
        controls = number_text(result.figures["max_abs_u"])
        rows.append([screen.name(result.name), *whose, *errors, band, controls, *y])
    screen.line("")
    screen.table(headings, rows, leads=1 if len(names) == 1 else 2)
    screen.line("tail: the last quarter; band: the largest error in the tail of a run that follows", "dim")
    if (said := about_u(results[0].problem)) is not None:
        screen.line(said, "dim")


def _told_together(screen: Screen, results: Sequence[Result], room: int) -> None:
    """Print each finding once, as many as fit completely."""
    told = together({screen.name(result.name): result.findings for result in results})
    if not told:
        return
    screen.title("Findings")
    left = max(room - screen.printed, FEWEST_FINDING_LINES)
    for k, one in enumerate(told):
        owners = f"{', '.join(one.owners)}: " if one.owners and len(results) > 1 else ""
        text = f"{owners}{one.text}." if owners else _sentence(one.text)
        lines, rest = len(screen.folded(text, "    ", "  ")), len(told) - k - 1
        if lines + (rest > 0) > left and k:
            screen.line(f"{counted(rest + 1, 'more finding')}: --full shows all of them.", "yellow", "    ", "  ")
            return
        screen.line(text, "yellow", "    ", "  ")
        left -= lines


VERDICT_STYLES = {Class.LOST: "red", Class.CYCLE: "red", Class.OFF: "yellow", Class.FOLLOWS: "green"}


def _bands(screen: Screen, results: Sequence[Result]) -> None:
    """Print the bands of the verdicts."""
    for bands in dict.fromkeys(result.verdict.bands for result in results if result.verdict is not None):
        screen.line(f"in the tail {bands}", "dim", "  ")


def _tracking(screen: Screen, results: Sequence[Result]) -> None:
    screen.title("Tracking error e and control u, over every step")
    measured = any(_values(result, "max_abs_y") for result in results)
    labels = results[0].problem.labels or UNLABELLED
    several = results[0].loop.inputs > 1
    u = "max |u|" if several else f"max |u|\n{labels.input_unit}".rstrip()
    headings = ["controller", "", "max |e|", "RMS e", "max |e|\nin the tail", u, *(["max |y|"] if measured else [])]
    rows = []
    for result in results:
        name, controls = screen.name(result.name), _values(result, "max_abs_u")
        errors = [_values(result, key) for key in ("max_abs_e", "rms_e", "tail_max_abs_e")]
        once = [[] if several else controls, *([_values(result, "max_abs_y")] if measured else [])]
        for i in range(len(errors[0])):
            of = "e" if len(errors[0]) == 1 else f"e_{i + 1}"
            rows.append([name, f"{of} {labels.unit(i)}".rstrip(), *(_at(values, i) for values in (*errors, *once))])
        if several:  # each input has a separate line; on a line of e it would seem to belong to that component
            units = [bracketed(labels.input_units[i : i + 1]) for i in range(len(controls))]
            rows += [[name, f"u_{i + 1} {unit}".rstrip(), "", "", "", _at(controls, i)] for i, unit in enumerate(units)]
    screen.table(headings, grouped(rows), leads=2)
    screen.line("tail: the last quarter of the run", "dim")
    if (said := about_u(results[0].problem)) is not None:
        screen.line(said, "dim")
    for result in results:
        if result.diverged_at is not None:
            screen.line(f"{screen.name(result.name)}: diverged at t = {result.diverged_at:.6g} s", "red", "  ")


def _responses(screen: Screen, results: Sequence[Result]) -> None:
    """Print the responses to the command's steps, and the activity of the control."""
    found = [(result, result.verdict.figures) for result in results if result.verdict is not None and result.verdict.figures]
    if not found:
        return
    screen.title("Integrals of the error, path of the control, and responses to the steps of the command")
    names, rows = component_names(results[0].problem), []
    for result, figures in found:
        for i, component in enumerate(names):
            one = figures.responses.get(component)
            response = (
                ["", "", ""] if one is None else [f"{one.Overshoot:.3g} %", _seconds(one.RiseTime), _seconds(one.SettlingTime)]
            )
            control = [number_text(figures.activity[i]), str(figures.reversals[i])] if i < len(figures.activity) else ["", ""]
            rows.append(
                [screen.name(result.name), component, *map(number_text, (figures.IAE[i], figures.ITAE[i])), *control, *response]
            )
    moving = any(figures.responses for _, figures in found)
    headings = ["controller", "", "IAE", "ITAE", "int |u'|", "rever-\nsals", "over-\nshoot", "rise", "settling"]
    screen.table(headings if moving else headings[:6], grouped([row if moving else row[:6] for row in rows]), leads=2)
    if moving:
        screen.line(
            "worst case over all steps of the command. The settling time refers to the judge's band; - means that e does not "
            "settle before the next step",
            "dim",
        )


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g} s"


def _estimates(screen: Screen, found: Sequence[tuple[Result, Adapting]]) -> None:
    screen.title("Estimates: is it adapting?")
    rows = []
    for result, adapting in found:
        ends, rates = _values(result, "theta_hat_final"), _values(result, "theta_hat_variation_rate")
        if result.diverged_at is not None:
            ends = result.theta_hat[-1].tolist()
        projected = adapting.on_bounds is not None or adapting.on_sphere is not None
        bounds = adapting.on_bounds_text.split("\n") if projected else []
        for one in estimates_of(result):
            i, true = one.number, "-" if one.true is None else number_text(one.true)
            moved = ["-", "-", "-"] if i is None else [
                number_text(float(adapting.path[i])), _at(rates, i), bounds[i] if i < len(bounds) else "-",
            ]  # fmt: skip
            end = number_text(float(one.value[-1])) if i is None else _at(ends, i)
            rows.append([screen.name(result.name), one.name, end, true, *moved])
    headings = ("controller", "", "end", "true", "path", "1/s in\nthe tail", "time on\na bound")
    screen.table(headings, grouped(rows), leads=2)
    screen.line("path: the total variation; 1/s: the same for each second of the tail", "dim")


def _excitation(screen: Screen, found: Sequence[tuple[Result, Adapting]]) -> None:
    excited = [(result, adapting.excitation) for result, adapting in found if adapting.excitation is not None]
    if not excited:
        return
    screen.title("Excitation of the regressor")
    rows = [
        [screen.name(result.name), f"{level:.3g}", f"{tail:.3g}", f"{conditioning:.2g}", f"{window:.3g} s"]
        for result, (level, tail, conditioning, _, window, _) in excited
    ]
    screen.table(("controller", "smallest", "in the tail", "scaled", "window"), rows)
    screen.line(
        "the smallest eigenvalue of the mean square of the regressor over a window; scaled: 1 if all directions are excited "
        "equally",
        "dim",
    )


def _findings(screen: Screen, results: Sequence[Result]) -> None:
    simulation, solver = results[0].simulation, results[0].simulation.solver
    screen.title("Numerics")
    if simulation.tolerance is None:
        screen.line(
            f"h |lambda|, the step times the loop's fastest eigenvalue; {solver.name} is stable up to "
            f"{solver.imaginary_limit:.3g} on the imaginary axis, {solver.real_limit:.3g} on the real one",
            "dim",
        )
    else:
        screen.line("the error at the recorded instants, as a fraction of the largest magnitude of each component", "dim")
    labels = [screen.name(result.name) for result in results]
    room = min(max(map(len, labels)), LABEL_COLUMNS)
    for label, result in zip(labels, results, strict=True):
        screen.fact(label, numerics(result), room, "red" if result.label else "")
    _warnings(screen, results, labels, room)


def _warnings(screen: Screen, results: Sequence[Result], labels: Sequence[str], room: int) -> None:
    """Print the findings that all runs share, once and under the problem's name, and then the findings of each run."""
    found = [result.warnings for result in results]
    if any(found):
        screen.title("Warnings")
    common = [warning for warning in found[0] if all(warning in others for others in found)]
    for warning in common:
        screen.line(_sentence(warning), "yellow", "    ", "  ")
    for label, warnings in zip(labels, found, strict=True):
        for warning in warnings:
            if warning not in common:
                screen.fact(label, _sentence(warning), room, "yellow")


def _sentence(text: str) -> str:
    return f"{capitalized(text)}."


def numerics(result: Result) -> str:
    """Return the numerics of a run, without what all runs have in common."""
    if result.simulation.tolerance is not None:
        return result.numerics
    found = result.stiffness
    parts = [f"{found.h_lambda_max:.3g} at most, at {counted(found.looks, 'instant')}"]
    if found.radius_max is not None:
        parts.append(f"the discrete-time map of the sampled law has a spectral radius of up to {found.radius_max:.4g}")
    parts += [result.label] if result.label else []
    return "; ".join([*parts, *(said.sentence for said in (result.damping, result.lost, result.check) if said is not None)])


def _values(result: Result, key: str) -> list[float | None]:
    value = result.figures.get(key)
    if key not in result.figures:
        return []
    return [*value] if isinstance(value, list) else [value]


def _at(values: Sequence[float | None], i: int) -> str:
    return number_text(values[i]) if i < len(values) else ""
