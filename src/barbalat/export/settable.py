"""The C of parameters that can be set while the controller runs: their list, their bounds, and the function that sets a
parameter."""

from __future__ import annotations

import re

from barbalat.export.acceptance import Entry, numbers
from barbalat.export.parameters import Parameter
from barbalat.export.texts import Printed, comment, filled, indented
from barbalat.loop.around import MOST_COUNTED


def settable(printed: Printed) -> dict[str, str]:
    """The parts of ``controller.h`` and ``controller.c`` for the parameters; each part is empty without parameters."""
    names = ("parameter_macros", "parameter_declared", "parameter_functions", "parameter_change", "parameter_set")
    if not printed.contents.parameters:
        return dict.fromkeys((*names, "unchanged", "no_change"), "") | {"advances": "        advance(c, in);\n"}
    given = {
        "name": printed.name,
        "macro": printed.macro,
        "real": printed.real,
        "u": printed.contents.layout.u.name,
        "count": len(printed.contents.parameters),
        "most": MOST_COUNTED,
        "range": printed.number(printed.contents.parameter_range),
        "each": "".join(f"#define {_macro(printed, one)} {i} /* {_about(printed, i)} */\n" for i, one in _numbered(printed)),
        "tests": "\n        && ".join([f"in_range_of_parameters(parameter, {printed.macro}_PARAMETERS)", *_tests(printed)]),
        "moves": "\n            && ".join(
            [
                "samples > 0L",
                f"c->{printed.contents.layout.started.name}[0] > 0",
                *_not_at_start(printed),
                "parameters_are_usable(c->parameter)",
            ]
        ),
    }
    return {name: filled(f"{name}.txt", **given) for name in names} | {
        "advances": _ADVANCES.format(macro=printed.macro),
        "unchanged": "        before.change = 0L; /* the result of the previous parameters may be out of range */\n",
        "no_change": "    c->change = 0L;\n",
    }


_ADVANCES = """\
        const int changes = measured > 0 && c->change > 0L;
        int pass;
        for (pass = changes; pass >= 0; --pass) {{ /* after a change, the first pass uses the previous parameters */
            if (pass > 0) {{
                exchange(c);
            }}
            advance(c, in);
            if (pass > 0) {{
                change(c, &before);
            }}
        }}
"""


def parameter_names(printed: Printed) -> list[str]:
    """The macros of all parameters, in order."""
    return [_macro(printed, one) for one in printed.contents.parameters]


def _numbered(printed: Printed) -> list[tuple[int, Parameter]]:
    return list(enumerate(printed.contents.parameters))


def _macro(printed: Printed, one: Parameter) -> str:
    """The macro for a path: L1_SET_GAMMA for controller[0].gamma; the export has one controller."""
    keys = one.path.keys[2:] if one.path.keys[0] == "controller" else one.path.keys
    return f"{printed.macro}_SET_{re.sub(r'[^A-Z0-9]+', '_', '_'.join(map(str, keys)).upper())}"


def _about(printed: Printed, i: int) -> str:
    """The path, its meaning, its value in the case, and the admissible values."""
    one, contents = printed.contents.parameters[i], printed.contents
    names = [other.name for other in contents.parameters]
    bounds = [
        condition.of_number(i, lambda entry: names[entry] if isinstance(entry, int) else f"{entry:g}")
        for condition in contents.conditions
        if i in numbers(condition)
    ]
    first = "; takes effect at the next reset" if _only_starts(printed, one) else ""
    return comment(f"{one.name} = {one.value:g}, {one.meaning}{first}{''.join(f'; {bound}' for bound in bounds)}")


def _only_starts(printed: Printed, one: Parameter) -> bool:
    """Whether the parameter is only an initial value of states, so that no operation reads it."""
    contents = printed.contents
    return one in contents.starts.values() and one not in contents.read_parameters


def _tests(printed: Printed) -> list[str]:
    """The conditions on the parameters."""

    def text(entry: Entry) -> str:
        if isinstance(entry, int):
            return f"parameter[{entry}]"
        return "0" if entry == 0.0 else printed.number(entry)

    return [one.as_c(text, printed.contents.real) for one in printed.contents.conditions]


def _not_at_start(printed: Printed) -> list[str]:
    """C text that tests whether a changed parameter takes effect while the controller runs."""
    return [f"which != {_macro(printed, one)}" for _, one in _numbered(printed) if _only_starts(printed, one)]


def parameters_readme(printed: Printed) -> str:
    """The section of README.md; empty without parameters."""
    if not printed.contents.parameters:
        return ""
    rows = indented((f"| `{_macro(printed, one)}` | {_about(printed, i)} |" for i, one in _numbered(printed)), 0)
    given = {"name": printed.name, "macro": printed.macro, "range": f"{printed.contents.parameter_range:g}", "rows": rows}
    return "\n" + filled("README_parameters.md", first=_macro(printed, printed.contents.parameters[0]), **given)
