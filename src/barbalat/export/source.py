"""controller.c: the operations of the simulated list, and the code around them that a flight computer needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barbalat.controllers.l1_piecewise import L1PiecewiseConstant
from barbalat.controllers.output.l1_piecewise import L1OutputPiecewiseConstant
from barbalat.export.contents import Contents
from barbalat.export.layout import StatePart
from barbalat.export.log import log_body, log_header
from barbalat.export.settable import settable
from barbalat.export.shell import REFUSALS, in_own_range, in_ranges, limits_vary, shell
from barbalat.export.shell import usable as shell_usable
from barbalat.export.texts import Printed, command_units, comment, comments, filled, indented, readable
from barbalat.loop.around import LOST, MOST_COUNTED
from barbalat.lowering import c99
from barbalat.lowering.operations import sources
from barbalat.run.kernel.sampled_controller import COMMAND, FREEZE, MEASURED, PARAMETER, STATE
from barbalat.validate import Array

ESTIMATE_TOLERANCE = 1e-6
"""Relative distance by which an estimate may be outside the known set: more than the rounding error of a 32-bit number."""

BITS_HEADERS = ("stdint", "string")
"""The library function used by this project's sin, exp, ...: memcpy, for the bits of a number."""


def source(printed: Printed) -> str:
    """The text of controller.c."""
    contents, layout = printed.contents, printed.contents.layout
    state, functions = contents.measures_state, c99.definitions((contents.step,), contents.real)
    needs_math = c99.calls_functions(contents.step, contents.real)
    return filled(
        "controller.c",
        origin=printed.origin,
        include="".join(
            f"#include <{name}.h>\n" for name in (*(["math"] if needs_math else []), *(BITS_HEADERS if functions else []))
        ),
        functions=f"{functions}\n" if functions else "",
        guard=printed.guard,
        name=printed.name,
        macro=printed.macro,
        real=printed.real,
        zero=f"0.0{contents.real.suffix}",
        **shell(printed),
        **settable(printed),
        lost_freeze=f"{contents.lost:g}",
        predicts="" if contents.loop.observer is None else ",\n * which the observer predicts through",
        measured=printed.measured,
        u=layout.u.name,
        started=layout.started.name,
        most=MOST_COUNTED,
        last_measured=layout.measured.name,
        last_r=layout.r.name,
        usable=_usable(printed),
        usable_result=_usable_result(printed),
        advance=_operations(printed),
        copied=indented(_copied(printed)),
        give=indented(_given(printed)),
        defaults=indented(
            f"c->{member}[{k}] = {printed.number(one.value)};{f' /* {one.name} */' * (member == 'parameter')}"
            for k, one in enumerate(contents.parameters)
            for member in ("parameter", "previous")
        ),
        reset=indented(f"{text} = {_initial(printed, row, contents.initial[row])};" for row, text in layout.entries().items()),
        start=_start(printed),
        begin_argument=f"const {printed.real} *{printed.measured}, " if state else "",
        begin_given=f"{printed.measured}, " if state else "",
        log=log_body(printed),
        measured_given=f"in->{printed.measured}, " if state else "",
        start_refused=" || ".join(
            [
                *([f"!in_range({printed.measured}, {printed.macro}_MEASURED)"] if state else []),
                *([f"!({test})" for test in in_ranges(printed, printed.measured)] if state else []),
                f"!in_range(u_now, {printed.macro}_INPUTS)",
            ]
        ),
        start_argument=f"const {printed.real} {printed.measured}[{printed.macro}_MEASURED], " if state else "",
    )


def _initial(printed: Printed, row: int, value: float) -> str:
    """C text of the initial value of an entry: a parameter, or the given value."""
    starts = printed.contents.starts
    return printed.parameter(starts[row]) if row in starts else printed.number(value)


def _operations(printed: Printed) -> str:
    """One constant for each operation, then the assignments."""
    contents, program = printed.contents, printed.contents.step
    printer = c99.Printer(program, contents.real)
    lines = c99.statements(program, inputs(printed), contents.real)
    results = iter(program.outputs[0])
    for part in contents.layout.parts:
        lines.append(f"/* {part.meaning} */")
        lines += [f"{part.entry(row)} = {printer.number(next(results))};" for row in part.rows]
    return indented(lines)


def inputs(printed: Printed) -> dict[tuple[int, int], str]:
    """C text of the list's inputs, by (argument, component)."""
    contents, program = printed.contents, printed.contents.step
    y, q, _, _ = contents.sizes
    found = {(STATE, row): text for row, text in contents.layout.entries().items()}
    found |= {(MEASURED, i): f"in->{printed.measured}[{i}]" for i in range(y)} | {(COMMAND, i): f"in->r[{i}]" for i in range(q)}
    two, one, zero = (c99.constant(value, contents.real) for value in (LOST, 1.0, 0.0))
    read = sorted(at for kind, at in sources(program) if kind == PARAMETER)
    found |= {(PARAMETER, at): printed.parameter(contents.fed(at)) for at in read}
    lost = "" if contents.loop.observer is None else f"in->freeze == {LOST:g} ? {two} : "
    found[FREEZE, 0] = f"{lost}in->freeze != 0 ? {one} : {zero}"
    return found


def _copied(printed: Printed) -> list[str]:
    """Every member of the state."""
    contents = printed.contents
    m = contents.sizes[2]
    sizes = {part.name: part.size for part in contents.layout.parts} | {
        "last_u": m,
        "bump": m,
    }
    more = ["change"] if contents.parameters else []
    numbers = [f"{name}[{i}]" for name, size in sizes.items() for i in range(size)]
    return [f"to->{text} = from->{text};" for text in (*numbers, *more, "fade", "fade_left", "matching")]


def _usable_result(printed: Printed) -> str:
    """The condition that every number that a sample computes is in range, and the estimates in their set up to rounding; a set
    with bounds on all estimates implies the range."""
    contents, theta_hat, bounds = printed.contents, printed.contents.layout.theta_hat, list[str]()
    ends = estimate_ends(contents)
    for i, (low, high) in enumerate(ends.tolist()):
        text = theta_hat.entry(theta_hat.start + i)
        bounds += [f"{text} >= {c99.constant(low, contents.real)}"] if np.isfinite(low) else []
        bounds += [f"{text} <= {c99.constant(high, contents.real)}"] if np.isfinite(high) else []
    bounded = ends.size > 0 and (np.abs(ends) <= contents.range).all()  # an infinite bound does not imply the range
    known = {part.name for part in (*stored(contents), *([theta_hat] if bounded else []))}
    tests = [f"in_range(c->{part.name}, {part.size})" for part in contents.layout.parts if part.name not in known]
    return _all([*tests, *bounds])


def stored(contents: Contents) -> list[StatePart]:
    """The arrays that need no test as results, because a sample writes to them only inputs that were already checked, or a count
    up to a limit."""
    layout = contents.layout
    counted = [part for part in layout.parts if part.path == "controller.span" and is_piecewise(contents)]
    return [layout.measured, layout.r, layout.started, *counted]


def estimate_ends(contents: Contents) -> Array:
    """(p, 2) the bounds within which estimates are accepted; empty without a checked set."""
    if contents.checked_limits is None:
        return np.zeros((0, 2))
    low, high = contents.checked_limits
    return np.array([low - ESTIMATE_TOLERANCE * (1 + np.abs(low)), high + ESTIMATE_TOLERANCE * (1 + np.abs(high))]).T


def _usable(printed: Printed) -> str:
    """C text that checks the held control, the stored inputs, the fade and the counters."""
    held = {part.name: part.size for part in stored(printed.contents) if part.name not in in_own_range(printed.contents)}
    tests = [f"in_range(c->{name}, {printed.macro}_INPUTS)" for name in ("last_u", "bump")]
    tests += [*(f"in_range(c->{name}, {size})" for name, size in held.items())]
    tests += ["c->fade_left >= 0L && c->fade_left <= c->fade"]
    if printed.contents.parameters:
        tests += ["parameters_are_usable(c->parameter)"]
        tests += ["(c->change == 0L || (c->change > 0L && parameters_are_usable(c->previous)))"]
    return _all([*tests, *shell_usable(printed)])


def _all(tests: Sequence[str]) -> str:
    return "\n        && ".join(tests)


def _given(printed: Printed) -> list[str]:
    contents = printed.contents
    lines = ["int i;", f"for (i = 0; i < {printed.macro}_INPUTS; ++i) {{", "    out->u[i] = c->last_u[i];"]
    lines += ["    out->u_limited[i] = out->u[i];", "}"]
    clips: list[str] = []
    for i, side in printed.limits():
        text = printed.limit(i, side)
        clips += [f"if (out->u[{i}] {'<>'[side]} {text}) {{", f"    out->u_limited[{i}] = {text};", "}"]
    if limits_vary(printed):
        usable = f"(status & {printed.macro}_STATE_REFUSED) == 0u || parameters_are_usable(c->parameter)"
        clips = [f"if ({usable}) {{", *(f"    {line}" for line in clips), "}"]
    lines += clips
    if contents.sizes[3]:
        name = contents.layout.theta_hat.name
        lines += [f"for (i = 0; i < {printed.macro}_ESTIMATES; ++i) {{", f"    out->theta_hat[i] = c->{name}[i];", "}"]
    return lines


def _start(printed: Printed) -> str:
    """C text that sets everything to its value at t = 0, with the measured state instead of the initial state of the case; learnt
    values are reset only if they are not kept."""
    contents, y = printed.contents, printed.measured
    kept: list[str] = []
    others: list[str] = []
    rest, of_x = contents.at_start
    for row, text in contents.layout.entries().items():
        terms = [
            f"{y}[{i}]" if factor == 1 else f"{printed.number(factor)} * {y}[{i}]" for i, factor in enumerate(of_x[row]) if factor
        ]
        value = " + ".join(terms if terms and not rest[row] else [_initial(printed, row, rest[row]), *terms])
        (kept if row in contents.learnt else others).append(f"{text} = {value};")
    last = ["if (keep_estimates == 0) {", *(f"    {line}" for line in kept), "}"] if kept else ["(void)keep_estimates;"]
    unread = [f"(void){y};"] if contents.measures_state and not any(f"{y}[" in line for line in (*others, *kept)) else []
    return indented([*unread, *others, *last])


def header(printed: Printed) -> str:
    """The text of controller.h."""
    contents, macro = printed.contents, printed.macro
    y, q, m, p = contents.sizes
    sizes = {"MEASURED": y, "COMMANDS": q, "INPUTS": m, "ESTIMATES": p}
    members = [
        f"{printed.real} {part.name}[{part.size}]; /* {shape(part.shape)}{part.meaning} */" for part in contents.layout.parts
    ]
    if contents.parameters:
        members += [
            f"{printed.real} parameter[{macro}_PARAMETERS]; /* set by {printed.name}_set */",
            f"{printed.real} previous[{macro}_PARAMETERS]; /* before a change that is to fade out */",
            "long change; /* number of good samples over which the change fades out; 0: no change is fading */",
        ]
    estimates = [f"{printed.real} theta_hat[{macro}_ESTIMATES]; /* estimates */"] if p else []
    state = contents.measures_state
    return filled(
        "controller.h",
        origin=printed.origin,
        name=printed.name,
        macro=macro,
        real=printed.real,
        mark=printed.mark,
        measured=printed.measured,
        refusals=REFUSALS,
        measured_meaning=_labelled(printed, "measured state" if printed.measured == "x" else "measured output"),
        units=comment(input_units(printed)),
        command_units=comment(units_text(command_units(contents.problem))),
        **_wrong_time(contents),
        **_freezes(contents),
        start_range=", or outside its plausible range" if state and in_ranges(printed, printed.measured) else "",
        sample_time=printed.number(contents.sample_time),
        range=printed.number(contents.range),
        sizes="".join(f"#define {macro}_{name} {size}\n" for name, size in sizes.items()) + _place_of_baseline(printed),
        limits=_limits(printed),
        members=indented(members),
        estimates=indented(estimates),
        start_argument=f"const {printed.real} {printed.measured}[{macro}_MEASURED], " if state else "",
        **shell(printed),
        **log_header(printed),
        **settable(printed),
        start_comment=f"Start, or start again after a pause, in flight: {_starting(printed)}.",
    )


def _place_of_baseline(printed: Printed) -> str:
    """The position of the control of an external baseline; empty for other baselines."""
    problem = printed.contents.problem
    if not problem.handed_controls:
        return ""
    at = f"{printed.measured}[{printed.macro}_U_BASELINE]"
    return (
        f"#define {printed.macro}_U_BASELINE {problem.measured} /* {at}: u of the existing loop, without the adaptive part */\n"
    )


def _starting(printed: Printed) -> str:
    """The effect of a start's arguments."""
    if not printed.contents.measures_state:
        return "model and filters start at rest"
    if printed.contents.problem.fixed_observer is None:
        return "the model and filters start at the measured state x"
    return "the model, filters and observer start at the smallest state that gives the measured y"


def _wrong_time(contents: Contents) -> dict[str, str]:
    """The times that count as wrong, and the controller's reaction."""
    if contents.around is not None and contents.around.band is not None:
        return {
            "tolerated": "BAND and by no whole number of calls",
            "wrong_time": "a miss, after which the fallback acts at once",
        }
    return {"tolerated": "0.1 %", "wrong_time": "the step was made as if the time were right"}


def is_piecewise(contents: Contents) -> bool:
    """Whether the law is piecewise constant, so that its estimate is its only feedback."""
    return isinstance(contents.controller, (L1PiecewiseConstant, L1OutputPiecewiseConstant))


def _freezes(contents: Contents) -> dict[str, str]:
    """The effect of the freeze switch, and the input that is used while a measurement is lost."""
    opens = ". This opens the law's only feedback" if is_piecewise(contents) else ""
    if contents.loop.observer is None:
        return {"predicts_only": opens, "with_what": "the last good measurement and this u"}
    return {
        "predicts_only": f"{opens}. {LOST:g}: the observer predicts as well, without the measurement",
        "with_what": "what the observer predicts from this u",
    }


def _labelled(printed: Printed, text: str) -> str:
    """The measurements, with names and units from the case."""
    problem, beside = printed.contents.problem, ""
    if problem.handed_controls:
        beside = f"; then, from place {printed.macro}_U_BASELINE on, the control of the existing loop"
    labels = problem.measured_labels
    if labels is None:
        return text + beside
    each = channels(printed)
    return text + (f": {', '.join(comments(each))}" if all(each) else "") + beside


def channels(printed: Printed) -> list[str]:
    """The name and unit of each measurement in the case; an empty text if there are none."""
    problem = printed.contents.problem
    labels = problem.measured_labels
    return [readable("" if labels is None else f"{labels.name(i)} {labels.unit(i)}".strip()) for i in range(problem.measured)]


def input_units(printed: Printed) -> str:
    """The units of the inputs after their meaning, if the case has some."""
    labels = printed.contents.problem.labels
    return units_text(() if labels is None else labels.input_units)


def units_text(units: Sequence[str]) -> str:
    """Units in brackets; empty without any unit."""
    return readable(f" [{', '.join(one or '1' for one in units)}]") if any(units) else ""


def shape(of: tuple[int, ...]) -> str:
    """The shape of a matrix; empty if the C already shows it."""
    return f"{of[0]} x {of[1]}: " if len(of) == 2 else ""  # a matrix


def _limits(printed: Printed) -> str:
    """The known set and the actuator's limits as initialisers, for the caller's use."""
    contents, lines = printed.contents, []
    if contents.limits is not None and contents.sizes[3]:
        for side, values in zip(("LOWER", "UPPER"), contents.limits, strict=True):
            lines.append(f"#define {printed.macro}_THETA_HAT_{side} {{ {_bounds(printed, values)} }} /* the known set */\n")
    if contents.saturation is not None:
        for side, values in zip(("LOWER", "UPPER"), contents.saturation, strict=True):
            lines.append(f"#define {printed.macro}_U_{side} {{ {_bounds(printed, values)} }} /* the actuator's limits */\n")
    return "".join(lines)


def _bounds(printed: Printed, values: Array) -> str:
    """Component by component; without a bound, the largest admissible number."""
    return ", ".join(printed.number(b if np.isfinite(b) else np.copysign(printed.contents.range, b)) for b in values)
