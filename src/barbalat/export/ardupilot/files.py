"""A backend of AC_CustomControl: the exported C in 32 bits, and a class that reads attitude and gyro, calls it and logs it."""

from __future__ import annotations

from barbalat.export.c99.files import sources
from barbalat.export.layout import prefix_of
from barbalat.export.target import Request
from barbalat.export.texts import Printed, filled, indented
from barbalat.validate import InputError

MOST_MEASURED = 2
"""An angle and its rate."""
TIMED = (
    "const uint64_t now = AP_HAL::micros64();",
    "in.sample_time = _last == 0 ? _period : float(now - _last) * 1e-6f;",
    "_last = now;",
)
"""The time between two updates, where the case's shell looks at it; the first one after a start comes in time."""


def files(asked: Request) -> dict[str, str]:
    """The files by their names; InputError for a controller that is not one axis's, and as of ``export_controller``."""
    if asked.closed_loop:
        raise InputError("the target ardupilot has the controller alone: take the target c99 for the closed loop")
    name = asked.name or prefix_of(asked.controller.name)
    printed, texts = sources(asked.problem, asked.controller, asked.simulation, float32=True, name=name)
    _require_axis(printed)
    measured, state = printed.contents.sizes[0], printed.contents.measures_state
    timed = printed.contents.around is not None and printed.contents.around.band is not None
    given = {
        "origin": printed.origin,
        "name": name,
        "macro": printed.macro,
        "kind": "".join(part.capitalize() for part in name.split("_")),
        "measured": printed.measured,
        "read": "_measure(x, r);",
        "start_given": "x, " if state else "",
        "timer": indented(TIMED if timed else ["in.sample_time = _period;"]),
        "timed": "The time between two updates is measured, as the shell asks."
        if timed
        else "The time between two updates is not measured: without `jitter` in the case's `[shell]` nothing depends on it.",
        "both": int(measured == MOST_MEASURED),
        "sample_time": f"{printed.contents.sample_time!r}",
        "rate": f"{1 / printed.contents.sample_time:.6g}",
    }
    return texts | {
        f"AC_CustomControl_{given['kind']}.h": filled("ardupilot.h", **given),
        f"AC_CustomControl_{given['kind']}.cpp": filled("ardupilot.cpp", **given),
        "ARDUPILOT.md": filled("ardupilot.md", **given),
    }


def _require_axis(printed: Printed) -> None:
    y, q, m, _ = printed.contents.sizes
    if m != 1 or q != 1 or y > MOST_MEASURED:
        raise InputError(
            "the target ardupilot takes a controller of one axis: one input, one command, and an angle or a rate or both in this "
            f"order as what is measured; got {m} inputs, {q} commands and {y} measured"
        )
