"""README.md of an export: what it is, how to call it, how to check it."""

from __future__ import annotations

from barbalat.controllers.settings import PatentNamed
from barbalat.export.contents import is_explicit
from barbalat.export.header import shape
from barbalat.export.texts import Printed, comment, filled


def readme(printed: Printed, *, closed_loop: bool = False) -> str:
    """The text of README.md."""
    contents = printed.contents
    layout, macro = contents.layout, printed.macro
    y, q, _, _ = contents.sizes
    functions = sorted({op.name for op in contents.step.operations} & LIBRARY)
    members = "\n".join(f"| `{part.name}` | {part.size} | {shape(part.shape)}{part.meaning} |" for part in layout.parts)
    euler = is_explicit(contents) and any(part.path == "controller.swapping" for part in layout.parts)
    return filled(
        "README.md",
        title=comment(contents.controller.name),
        origin=printed.origin.replace("\n *", ""),
        operations=len(contents.step.operations),
        numbers=len(layout.rows),
        calls=", ".join(functions) or "none",
        library=" -lm" if functions else "",
        samples=len(contents.vectors.states),
        name=printed.name,
        macro=macro,
        sample_time=f"{contents.sample_time!r}",
        measured=printed.measured,
        measured_count=f"{y} state{'s' if y > 1 else ''}" if contents.measures_state else "the output",
        commands=f"{q} commands" if q > 1 else "the command",
        start=f"{printed.measured}, " if contents.measures_state else "",
        range=f"{contents.range:g}",
        set=", or an estimate outside the known set" if contents.limits is not None else "",
        freeze=EULER_SWAPPING if euler else "",
        gap=GAP if any(part.path == "controller.span" for part in layout.parts) else "",
        members=members,
        loop=filled("README_loop.md", library=" -lm").rstrip() + "\n" if closed_loop else "",
        patent=_patent(printed),
    )


def _patent(printed: Printed) -> str:
    """What is to be asked before such a law flies."""
    controller = printed.contents.controller
    return f"\n## Before you fly it\n\n{controller.patent}\n" if isinstance(controller, PatentNamed) else ""


EULER_SWAPPING = " The swapping term of (14) moves as if the law did: Euler's steps know it from the law's rate alone."

GAP = """ What the
  prediction error gathered over m samples counts by one sample's share: the law would answer all of it as if it came of one."""

LIBRARY = {"sqrt", "fabs", "floor", "ceil", "exp", "log", "sin", "cos", "tan", "tanh", "pow", "copysign"}
"""Operations that are calls of math.h."""
