"""A backend of AC_CustomControl: the exported C in 32 bits, and a class that reads attitude and gyro, calls the C and logs its
signals."""

from __future__ import annotations

import math
import re
from dataclasses import replace

from barbalat import validate
from barbalat.export.c99.files import sources
from barbalat.export.layout import distinct, prefix_of
from barbalat.export.log import logged
from barbalat.export.parameters import Parameter
from barbalat.export.shell import counters
from barbalat.export.target import Request
from barbalat.export.texts import Printed, filled, indented, readable
from barbalat.validate import InputError

DEGREES = math.degrees(1.0)
MOST_MEASURED = 2
"""Largest number of measurements for a controller of one axis: an angle and its rate."""
TIMED = (
    "const uint64_t now = AP_HAL::micros64();",
    "in.sample_time = _last == 0 ? _period : float(now - _last) * 1e-6f;",
    "_last = now;",
)
"""The time between two updates, if the case's shell checks it; the first update after a start counts as on time."""
OWN = 4
"""Number of parameters common to all backends."""
MOST_PARAMETERS = 63
"""Largest number of parameters of one group, whose indices have six bits."""
LONGEST_NAME = 16 - len("CC3_")
"""Longest name of a parameter, after the prefix of the frontend."""
LONGEST_LABELS, LONGEST_FORMAT = 64, 16
"""Largest lengths of the description of a log line: the names of its entries with commas, and their type letters."""
TOLD = """
Parameters that the controller rejects leave it unchanged and are reported once. They are tried again with each update, so two
bounds can be moved past each other. A change fades in over `CC3_FADE` samples. ArduPilot stores a parameter by its place in
the table, not by its name: after a new export, set all of them again before you fly.
"""
LINES = "123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def files(asked: Request) -> dict[str, str]:
    """The files by name; raises InputError as ``export_controller`` does, and for a controller of more than one axis."""
    if asked.closed_loop:
        raise InputError("the ardupilot target exports only the controller: use the c99 target for the closed loop")
    name = asked.name or prefix_of(asked.controller.name)
    printed, texts = sources(replace(asked, float32=True, name=name))
    _require_axis(printed)
    names = parameters(printed)
    measured = printed.contents.sizes[0]
    timed = printed.contents.around is not None and printed.contents.around.band is not None
    given = {
        "origin": printed.origin,
        "warning": f"\n**{readable(asked.warning())}**\n" if asked.warning() else "",
        "name": name,
        "macro": printed.macro,
        "kind": kind_of(name),
        "measured": printed.measured,
        "read": "_measure(x, r);",
        "axis": _axis(printed),
        **_handing_over(printed),
        "start_given": "x, " if printed.contents.measures_state else "",
        "timer": indented(TIMED if timed else ["in.sample_time = _period;"]),
        "timed": "The time between two updates is measured, as the shell requires."
        if timed
        else "The time between two updates is not measured: nothing depends on it unless the case's `[shell]` sets `jitter`.",
        "both": int(measured == MOST_MEASURED),
        **_units(printed),
        "sample_time": f"{printed.contents.sample_time!r}",
        "rate": f"{1 / printed.contents.sample_time:.6g}",
        "lines": indented(_lines(printed), 8),
        **_settable(printed, names),
    }
    return texts | {
        f"AC_CustomControl_{given['kind']}.h": filled("ardupilot.h", **given),
        f"AC_CustomControl_{given['kind']}.cpp": filled("ardupilot.cpp", **given),
        "ARDUPILOT.md": filled("ardupilot.md", **given),
    }


def _handing_over(printed: Printed) -> dict[str, str]:
    """The parts of the files for an outage, during which the main controller acts; the parts for plain operation if there is no
    longest outage."""
    name, macro, around = printed.name, printed.macro, printed.contents.around
    parts = {"first": "const bool first", "turned": "turned", "freeze": "0", "status": "const unsigned status", "again": ""}
    if around is None or around.longest is None:
        return parts | {"handed": "", "outage": ""}
    counts = len(around.repeats)
    kept = [f"const long repeats[{counts}] = {{{', '.join(f'_controller.{one}' for one in counters(around))}}};"]
    restored = [f"_controller.{one} = {one}; // a stuck channel remains one" for one in counters(around)]
    again = filled(
        "ardupilot_again.txt",
        name=name,
        macro=macro,
        start_given="x, " if printed.contents.measures_state else "",
        kept=indented(kept if counts else [], 8),
        restored=indented(restored, 12),
    )
    return {
        "first": "bool first",
        "turned": "(turned && !_waiting)",
        "freeze": "_waiting ? 1 : 0",
        "status": "unsigned status",
        "again": again,
        "handed": filled("ardupilot_handed.txt", name=name, macro=macro),
        "outage": OUTAGE,
    }


def parameters(printed: Printed) -> list[str]:
    """ArduPilot names for the numbers of the case, from the last key and its indices; raises InputError if there are too many."""
    found = printed.contents.parameters
    if len(found) + OWN > MOST_PARAMETERS:
        most = MOST_PARAMETERS - OWN
        raise InputError(
            f"ArduPilot has room for {most} backend parameters, but this case has {len(found)}: leave out --parameters"
        )
    names = []
    for one in found:
        last = max(i for i, key in enumerate(one.path.keys) if isinstance(key, str))
        index = "_".join(str(int(key) + 1) for key in one.path.keys[last + 1 :])
        key = re.sub(r"[^A-Z0-9]+", "_", str(one.path.keys[last]).upper())
        names.append(f"{key[: LONGEST_NAME - len(index) - 2]}{index}")  # leaves space for the part that distinguishes two names
    return distinct(["AXIS", "ANGLE", "FADE", "SCALE", *names])[OWN:]


def _settable(printed: Printed, names: list[str]) -> dict[str, str]:
    """The parts of the files for the parameters; empty without parameters."""
    if not names:
        return dict.fromkeys(("infos", "members", "built", "apply", "applied", "told", "rows"), "")
    given = {"name": printed.name, "macro": printed.macro, "count": len(names)}
    found = list(zip(names, printed.contents.parameters, strict=True))
    return {
        "infos": "".join(_info(i, name, one, printed) for i, (name, one) in enumerate(found)),
        "members": filled("ardupilot_members.txt", **given),
        "built": filled("ardupilot_built.txt", **given),
        "apply": filled("ardupilot_apply.txt", kind=kind_of(printed.name), **given),
        "applied": "    _apply();\n",
        "told": TOLD,
        "rows": "".join(f"| `CC3_{name}` | `{one.name}`, {one.meaning}; {one.value:g} in the case |\n" for name, one in found),
    }


def kind_of(name: str) -> str:
    """The name of the class after AC_CustomControl_."""
    return "".join(part.capitalize() for part in name.split("_"))


def _info(i: int, name: str, one: Parameter, printed: Printed) -> str:
    told = {"Param": name, "DisplayName": one.name, "Description": one.meaning, "User": "Advanced"}
    lines = [f"// @{key}: {value}" for key, value in told.items()]
    place = f"AC_CustomControl_{kind_of(printed.name)}, _parameter[{i}]"
    return "\n" + indented([*lines, f'AP_GROUPINFO("{name}", {OWN + 1 + i}, {place}, {printed.number(one.value)}),'])


def _lines(printed: Printed) -> list[str]:
    """C++ code that logs the internal signals, in as many lines as needed."""
    members, calls = [one.name for one in logged(printed)], list[str]()
    while members and len(calls) < len(LINES):
        count = 1
        while count < min(len(members), LONGEST_FORMAT - 1) and _long(members[: count + 1]) < LONGEST_LABELS:
            count += 1
        some, members = members[:count], members[count:]
        values = "".join(f",\n    double(inside.{one})" for one in some)
        said, kinds = ",".join(["TimeUS", *some]), "Q" + "f" * len(some)
        calls.append(f'AP::logger().Write("BBI{LINES[len(calls)]}", "{said}", "{kinds}", AP_HAL::micros64(){values});')
    return [line for call in calls for line in call.split("\n")]


def _long(names: list[str]) -> int:
    return len(",".join(["TimeUS", *names]))


AXES = {"roll": 0, "phi": 0, "pitch": 1, "theta": 1, "yaw": 2, "psi": 2, "heading": 2}
"""Words for an axis, and its number in ArduPilot."""
OUTAGE = """
If an outage exceeds the case's `longest_outage`, the main controller takes over, whatever `fallback` the case declares. A working
controller is better than a held or fading torque, or a baseline on an old measurement. A message reports it once in each
engagement. The controller continues to check the samples, with its estimates frozen. It acts again from the first sample
whose measurement, command and result it accepts, with its estimates kept and without a bump. A sensor that remains stuck, or a
bad value that persists, therefore leaves the axis to the main controller.
"""
ANGLES, RATES = {"": 1.0, "rad": 1.0, "deg": DEGREES}, {"": 1.0, "rad/s": 1.0, "deg/s": DEGREES}
"""Units in the labels of a case and their factors relative to ArduPilot's rad and rad/s. A case without labels uses rad and
rad/s."""


def _units(printed: Printed) -> dict[str, str]:
    """The factors from ArduPilot's units to those of the case, for each measurement, and a phrase; raises InputError for a
    different unit."""
    labels, measured = printed.contents.problem.measured_labels, printed.contents.sizes[0]
    units = ("",) * measured if labels is None or not labels.units else labels.units
    admitted = (ANGLES, RATES) if measured == MOST_MEASURED else (ANGLES | RATES,)
    for unit, known in zip(units, admitted, strict=True):
        if unit not in known:
            raise InputError(
                f"the ardupilot target passes {' and then '.join(' or '.join(filter(None, one)) for one in admitted)}: got "
                f"labels.units = {validate.show(list(units))}"
            )
    factors = [f"{known[unit]:.9g}f" if known[unit] != 1.0 else "1.0f" for unit, known in zip(units, admitted, strict=True)]
    said = f" ({' and '.join(dict.fromkeys(units))})" if any(units) else " (rad and rad/s)"
    return {"first_unit": factors[0], "last_unit": factors[-1], "units_said": said}


def _axis(printed: Printed) -> int:
    """The default axis, taken from the name of the export or else from the labels of the case; pitch if they name none or
    several."""
    labels = printed.contents.problem.measured_labels
    for words in (printed.name.split("_"), [] if labels is None else " ".join(labels.names).replace("_", " ").split()):
        if len(named := {AXES[word.lower()] for word in words if word.lower() in AXES}) == 1:
            return named.pop()
    return AXES["pitch"]


def _require_axis(printed: Printed) -> None:
    y, q, m, _ = printed.contents.sizes
    if m != 1 or q != 1 or y > MOST_MEASURED:
        raise InputError(
            f"the ardupilot target needs a single-axis controller with one input, one command, and a measured angle, a measured "
            f"rate, or both in this order; got {m} inputs, {q} commands and {y} measurements"
        )
