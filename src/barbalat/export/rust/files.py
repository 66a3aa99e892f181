"""A crate: the exported C, functions of plain arguments around it, a safe wrapper, and samples of the simulation as its test."""

from __future__ import annotations

import numpy as np

from barbalat.export.c99.files import named, sources
from barbalat.export.settable import parameter_names
from barbalat.export.target import Request
from barbalat.export.texts import Printed, filled, indented
from barbalat.validate import Array, InputError

TESTED = 100
"""Number of samples of the simulation that the test of the crate replays; ``selftest.c`` replays all samples."""


def files(asked: Request) -> dict[str, str]:
    """The files by name; raises InputError as ``export_controller`` does."""
    if asked.closed_loop:
        raise InputError("the rust target exports only the controller: use the c99 target for the closed loop")
    printed, texts = sources(asked)
    own = next(iter(named({"controller.h": ""}, asked.name))), next(iter(named({"controller.c": ""}, asked.name)))
    y, q, m, p = printed.contents.sizes
    around = printed.contents.around
    acts_at_once = around is not None and around.longest == 0 and around.fallback != "hold"
    number = "f64" if printed.real == "double" else "f32"
    given = {
        "name": printed.name,
        "measured": y,
        "commands": q,
        "inputs": m,
        "estimates": p,
        "number": number,
        "start_declared": f"{printed.measured}: *const {number}, " if printed.contents.measures_state else "",
        "start_argument": f"{printed.measured}: &[{number}; MEASURED], " if printed.contents.measures_state else "",
        "start_given": f"{printed.measured}.as_ptr(), " if printed.contents.measures_state else "",
        "samples": _samples(printed),
        **_settable(printed, number),
        "held": "" if acts_at_once else indented(["assert_eq!(out.u, before.u);"], 12),
        "and_held": "" if acts_at_once else "_and_the_control_stays",
        "bits": f"u{number[1:]}",
        "sample_time": f"{float(printed.contents.real.numbers(printed.contents.sample_time))!r}",
    }
    return texts | {
        "plain.c": _plain_functions(printed, own[0]),
        "Cargo.toml": filled("Cargo.toml", name=printed.name.lower()),
        "build.rs": filled("build.rs", name=printed.name, controller=own[1]),
        "lib.rs": filled("lib.rs", **given),
    }


def _plain_functions(printed: Printed, header: str) -> str:
    """The text of plain.c: functions of plain arguments around the controller, because Rust does not read its structs."""
    return filled(
        "plain.c",
        origin=printed.origin,
        header=header,
        name=printed.name,
        macro=printed.macro,
        real=printed.real,
        measured=printed.measured,
        estimates="    memcpy(theta_hat, out.theta_hat, sizeof out.theta_hat);\n"
        if printed.contents.sizes[3]
        else "    (void)theta_hat;\n",
    )


def _settable(printed: Printed, number: str) -> dict[str, str]:
    """The parts of lib.rs for the parameters; empty without parameters."""
    macros = parameter_names(printed)
    if not macros:
        return dict.fromkeys(("set_declared", "parameters", "set", "set_tested"), "")
    names = [macro.removeprefix(f"{printed.macro}_") for macro in macros]
    lines = (
        f"/// {one.name}, {one.meaning}; {one.value:g} in the case.\npub const {name}: usize = {i};\n"
        for i, (name, one) in enumerate(zip(names, printed.contents.parameters, strict=True))
    )
    given = {"name": printed.name, "number": number, "first": names[0]}
    return {
        "parameters": f"\n{''.join(lines)}pub const PARAMETERS: usize = {len(macros)};\n",
        "set_declared": f"    fn {printed.name}_set(c: *mut c_void, which: c_int, value: {number}, samples: c_long) -> c_uint;\n",
        "set": filled("set.rs", **given),
        "set_tested": filled("set_tested.rs", **given),
    }


def _samples(printed: Printed) -> str:
    """Rows of bits: the measurement, the command, the control."""
    contents = printed.contents
    control = contents.vectors.states[:TESTED, list(contents.layout.u.rows)]
    rows = np.hstack([contents.vectors.measured[:TESTED], contents.vectors.commands[:TESTED], control])
    return "".join(f"        [{', '.join(_bits(row, contents.real.numbers))}],\n" for row in rows)


def _bits(row: Array, numbers: type[np.floating]) -> list[str]:
    found = row.astype(numbers)
    return [f"0x{value:x}" for value in found.view(np.uint64 if found.itemsize == 8 else np.uint32)]
