"""The logged internal signals of a controller: a struct of numbers under the column names of the simulation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from barbalat.export.layout import StatePart, distinct
from barbalat.export.texts import Printed, command_units, comment, comments, indented
from barbalat.roles import column_names, entry_names
from barbalat.run.results.result import SERIES
from barbalat.validate import Array

PREDICTED = {"controller.x_hat": "x_tilde", "controller.y_hat": "y_tilde"}
"""Predictors of the measurement, and the names for their errors."""
ERRORS = {"e": "error against the controller's reference model", "x_tilde": "prediction error", "y_tilde": "prediction error"}
"""The measurement minus its reference."""


@dataclass(frozen=True)
class Logged:
    """One number of the log: an entry of the state, or an entry minus a weighted sum of others.

    name     name of the member in C
    row      row of the flat state
    minus    factors and rows of the subtracted entries
    text     C text of the number, if it is not simply an entry of the state
    label    its display name, with its unit
    meaning  one phrase
    """

    name: str
    row: int
    label: str
    meaning: str
    minus: tuple[tuple[float, int], ...] = ()
    text: str = ""

    def value(self, state: Array) -> Array:
        """The value from a flat state, (S, ...), computed in that state's number type."""
        if not self.minus:
            return np.asarray(state[self.row])
        terms = [state[row] if factor == 1 else state.dtype.type(factor) * state[row] for factor, row in self.minus]
        total = terms[0]
        for one in terms[1:]:
            total = total + one
        return np.asarray(state[self.row] - total)


def logged(printed: Printed) -> tuple[Logged, ...]:
    """All logged numbers, in the order of the struct members."""
    found = [*_signals(printed), *_states(printed)]
    names = distinct(one.name for one in found)
    return tuple(Logged(name, *_rest(one)) for name, one in zip(names, found, strict=True))


def _rest(one: Logged) -> tuple[int, str, str, tuple[tuple[float, int], ...], str]:
    return one.row, one.label, one.meaning, one.minus, one.text


def _signals(printed: Printed) -> Iterator[Logged]:
    """The measurement, the command, the control, the errors."""
    contents, layout = printed.contents, printed.contents.layout
    y, q, m, _ = contents.sizes
    labels = contents.problem.labels
    names, units = _named(printed), () if labels is None else labels.input_units
    commanded = command_units(contents.problem)
    measured = [layout.measured.start + i for i in range(y)]
    own = contents.problem.measured  # without controls that external code supplies
    for i, (name, row) in enumerate(zip(_numbered("measured", y), measured, strict=True)):
        yield Logged(name, row, names[i], "last good measurement")
    for i, name in enumerate(_numbered("r", q)):
        unit = commanded[i] if i < len(commanded) else ""
        yield Logged(name, layout.r.start + i, f"{name} [{unit}]" if unit else name, "command")
    for which, meaning in (("u", "demanded control"), ("u_limited", "control within the limits")):
        for i, name in enumerate(_numbered(which, m)):
            label = f"{name} [{units[i]}]" if units and units[i] else name
            yield Logged(name, layout.u.start + i, label, meaning, text=f"out.{which}[{i}]")
    model = layout.part("held.x_m")
    if model is not None and not _is_observed(printed):
        followed = _followed(printed, model)
        yield from _errors("e", measured[:own], followed, names[:own])
    for path, name in PREDICTED.items():
        part = layout.part(path)
        if part is not None and part.size == own and not _is_observed(printed):
            yield from _errors(name, measured[:own], [((1.0, row),) for row in part.rows], names[:own])


def _is_observed(printed: Printed) -> bool:
    """Whether the law uses the state of an observer, which has no measured counterpart for comparison."""
    return printed.contents.problem.feedback == "state" and printed.measured != "x"


def _errors(name: str, measured: list[int], of: list[tuple[tuple[float, int], ...]], names: list[str]) -> Iterator[Logged]:
    for one, row, minus, label in zip(_numbered(name, len(measured)), measured, of, names, strict=True):
        yield Logged(one, row, f"{name} of {label}", ERRORS[name], minus)


def _followed(printed: Printed, model: StatePart) -> list[tuple[tuple[float, int], ...]]:
    """For each measured channel, factors and rows of the corresponding model output."""
    contents = printed.contents
    y = contents.problem.measured
    if contents.measures_state:
        return [((1.0, row),) for row in list(model.rows)[:y]]
    row = [float(contents.loop.model.output(unit)) for unit in np.eye(model.size)]
    return [tuple((factor, model.start + i) for i, factor in enumerate(row) if factor)]


def _states(printed: Printed) -> Iterator[Logged]:
    """The rest of the state, under the column names of the simulation."""
    contents, layout, loop = printed.contents, printed.contents.layout, printed.contents.loop
    others = {part.path: part.name for part in loop.other_estimates}
    own = [part for part in loop.parts if part.role.kind != "estimates" and part.size]
    columns = {part.path: name for part, name in column_names(own, {"t", *SERIES, *others.values()}).items()} | others
    columns |= {} if loop.estimates is None else {loop.estimates.path: "theta_hat"}
    shown = {f"controller.{path}": name for path, name in columns.items()} | {"held.x_m": "x_m"}
    for part in layout.parts:
        if part.path in (layout.u.path, layout.measured.path, layout.r.path, layout.started.path):
            continue
        name = shown.get(part.path, part.name)
        numbered = part.path.removeprefix("controller.") in others or name in ("theta_hat", "x_m")
        entries = [f"{name}_{i + 1}" for i in range(part.size)] if numbered else entry_names(name, part.shape)
        of_channels = part.path != layout.measured.path and of_the_channels(printed, part)
        for i, (entry, row) in enumerate(zip(entries, part.rows, strict=True)):
            label = f"{name} of {_named(printed)[i]}" if of_channels and (contents.measures_state or name != "x_m") else entry
            yield Logged(entry, row, label, part.meaning)


def of_the_channels(printed: Printed, part: StatePart) -> bool:
    """Whether the entries are the measured channels, which have labels."""
    problem = printed.contents.problem
    known = {*PREDICTED, "held.x_m", printed.contents.layout.measured.path}
    return problem.labels is not None and part.path in known and part.size == problem.measured and not _is_observed(printed)


def _named(printed: Printed) -> list[str]:
    """The measured channels by their display names, with units."""
    problem = printed.contents.problem
    names, labels = problem.measured_names, problem.measured_labels
    inputs = () if problem.labels is None else problem.labels.input_units
    found = [f"{name} {'' if labels is None else labels.unit(i)}".strip() for i, name in enumerate(names)]
    return found + [f"{name} [{inputs[i]}]" if inputs else name for i, name in enumerate(problem.handed_controls)]


def _numbered(name: str, count: int) -> list[str]:
    """The names of a vector's entries; a single entry has the name of the vector, unless the columns of the simulation are
    numbered even then."""
    alone = count == 1 and name in ("r", "u", "u_limited", "y_tilde")
    return [name] if alone else [f"{name}_{i + 1}" for i in range(count)]


def log_header(printed: Printed) -> dict[str, str]:
    """The parts of the header: macros, and members of the struct."""
    found, macro = logged(printed), printed.macro
    labels = comments([one.label for one in found], lambda label: comment(label).translate(_QUOTED))
    lists = {"NAMES": [one.name for one in found], "LABELS": labels}
    macros = f"#define {macro}_LOG_SIZE {len(found)} /* numbers of a {printed.name}_log, one after another */\n"
    for name, texts in lists.items():
        quoted = (f'"{one}"' for one in texts)
        macros += f"#define {macro}_LOG_{name} {{ \\\n{_in_lines(quoted)} }}\n"
    members = [
        f"{printed.real} {one.name}; /* {'' if one.label == one.name else f'{label}: '}{comment(one.meaning)} */"
        for one, label in zip(found, labels, strict=True)
    ]
    return {"log_macros": macros, "log_members": indented(members)}


def _in_lines(texts: Iterable[str]) -> str:
    """Pieces of C, separated by commas, in the lines of a macro."""
    lines = [""]
    for text in texts:
        lines += [""] if lines[-1] and len(lines[-1]) + len(text) > WIDTH else []
        lines[-1] += f"{', ' if lines[-1] else ''}{text}"
    return ", \\\n".join(f"    {line}" for line in lines)


WIDTH = 116
"""Line width of the lists."""
_QUOTED = str.maketrans({'"': "'", "\\": "/"})
"""Characters that a C string cannot contain directly."""


def log_body(printed: Printed) -> str:
    """The assignments of ``..._read_log``."""
    entries = printed.contents.layout.entries()
    lines = []
    for one in logged(printed):
        terms = [entries[row] if factor == 1 else f"{printed.number(factor)} * {entries[row]}" for factor, row in one.minus]
        total = " + ".join(terms)
        less = f" - ({total})" if len(terms) > 1 else f" - {total}" if terms else ""
        lines.append(f"log->{one.name} = {one.text or entries[one.row] + less};")
    return indented(lines)


def log_of_u(printed: Printed) -> str:
    """C text that tests whether ``log`` contains the control of ``out``."""
    return " && ".join(f"same(&log.{one.name}, &{one.text}, 1)" for one in logged(printed) if one.text)


def log_values(printed: Printed, state: Array) -> Array:
    """(..., N) the log after a good sample that results in this flat state, (S, ...), without a fade."""
    contents = printed.contents
    numbers = state.astype(contents.real.numbers)
    found = []
    for one in logged(printed):
        value = one.value(numbers)
        if one.text.startswith("out.u_limited") and contents.saturation is not None:
            low, high = contents.saturation[:, one.row - contents.layout.u.start].astype(contents.real.numbers)
            value = np.clip(value, low, high)
        found.append(value)
    return np.stack(found, axis=-1)
