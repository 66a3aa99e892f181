"""Functions of plain arguments around an exported controller, for languages that do not read its structs."""

from __future__ import annotations

from barbalat.export.texts import Printed, filled


def plain_functions(printed: Printed, header: str) -> str:
    """The text of plain.c."""
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
