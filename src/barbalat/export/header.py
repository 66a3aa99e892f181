"""controller.h: the types, the functions, the limits, and what each name means."""

from __future__ import annotations

import numpy as np

from barbalat.export.texts import Printed, filled, indented
from barbalat.validate import Array


def header(printed: Printed) -> str:
    """The text of controller.h."""
    contents, macro = printed.contents, printed.macro
    y, q, m, p = contents.sizes
    sizes = {"MEASURED": y, "COMMANDS": q, "INPUTS": m, "ESTIMATES": p}
    members = [
        f"{printed.real} {part.name}[{part.size}]; /* {shape(part.shape)}{part.meaning} */" for part in contents.layout.parts
    ]
    if contents.parameters:
        names = ", ".join(one.name for one in contents.parameters)
        members.append(
            f"{printed.real} parameter[{len(contents.parameters)}]; /* {names}: set between init and reset, or between steps */"
        )
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
        measured_meaning="measured state" if state else "measured output",
        sample_time=printed.number(contents.sample_time),
        range=printed.number(contents.range),
        sizes="".join(f"#define {macro}_{name} {size}\n" for name, size in sizes.items()),
        limits=_limits(printed),
        members=indented(members),
        estimates=indented(estimates),
        start_argument=f"const {printed.real} x[{macro}_MEASURED], " if state else "",
        start_comment="Start, or start again after a pause, in flight: model and filters start at the measured state x."
        if state
        else "Start, or start again after a pause, in flight: model and filters start at rest.",
    )


def shape(of: tuple[int, ...]) -> str:
    """The shape of a matrix; nothing for what C says itself."""
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
    """Component by component; where there is none, what no number may exceed."""
    return ", ".join(printed.number(b if np.isfinite(b) else np.copysign(printed.contents.range, b)) for b in values)
