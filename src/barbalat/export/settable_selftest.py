"""The self-test of settable parameters: what is refused, the effect of a change, and that it causes no bump."""

from __future__ import annotations

import numpy as np

from barbalat.export.contents import Contents
from barbalat.export.log import logged
from barbalat.export.settable import parameter_names
from barbalat.export.texts import Printed, indented
from barbalat.lowering import c99


def settable_tests(printed: Printed, at: int, fade: int) -> str:
    """The text of ``test_parameters``, from the sample ``at`` on; empty without parameters."""
    contents = printed.contents
    if not contents.parameters:
        return ""
    numbers = [c99.constant(value, contents.real) for value in tried(contents)]
    moves = [str(int(one in contents.read_parameters)) for one in contents.parameters]
    refused = ",\n    ".join(f"{{ {i}, {c99.constant(value, contents.real)} }}" for i, value in _beyond(contents))
    return _WHOLE.format(
        name=printed.name, macro=printed.macro, real=printed.real, measured=printed.measured, at=at, fade=fade,
        started=contents.layout.started.name, u=contents.layout.u.name, tried=", ".join(numbers), moves=", ".join(moves),
        count=len(_beyond(contents)), refused=refused, limits=indented(_limits(printed)),
    )  # fmt: skip


def tried(contents: Contents) -> list[float]:
    """Another value for each parameter."""
    opened = contents.opened
    assert opened is not None
    return [opened.tried[opened.parameters.index(one)] for one in contents.parameters]


def _beyond(contents: Contents) -> list[tuple[int, float]]:
    """Indices of parameters, and values just beyond or far beyond their bounds."""
    numbers, found = contents.real.numbers, []
    for i, one in enumerate(contents.parameters):
        side = {">": -1.0, "<": 1.0}.get(one.bound[:1], 0.0)
        if side:
            least = float(np.nextafter(numbers(0), numbers(side)))
            found += [(i, side * (abs(one.value) or 1.0)), (i, least if one.bound.endswith("= 0") else 0.0)]
        elif one.bound:
            found.append((i, 0.0))
    for low, high, strict in contents.ordered:
        for i, other, towards in ((low, high, np.inf), (high, low, -np.inf)):
            end = numbers(contents.parameters[other].value)
            found.append((i, float(end if strict else np.nextafter(end, numbers(towards)))))
    most = numbers(contents.parameter_range)
    return [*found, *((i, float(np.nextafter(most, numbers(np.inf)))) for i in range(len(contents.parameters)))]


def _limits(printed: Printed) -> list[str]:
    """A newly set limit of the control is the one that applies."""
    contents, lines = printed.contents, []
    limited = [one.name for one in logged(printed) if one.text.startswith("out.u_limited")]
    for which, (one, value) in zip(parameter_names(printed), zip(contents.parameters, tried(contents), strict=True), strict=True):
        if one.limit is None:
            continue
        i, side = one.limit
        between = (one.value + value) / 2
        kept = max(between, value) if side == 0 else min(between, value)  # the limits in the case and here
        for u, expected in ((value + (1.0 if side else -1.0), value), (between, kept)):
            asked, wanted = (c99.constant(number, contents.real) for number in (u, expected))
            lines += [
                f"c = before; (void){printed.name}_set(&c, {which}, tried[{which}], 0L); c.last_u[{i}] = {asked};",
                f"{printed.name}_read_log(&c, &log);",
                f"{{ const {printed.real} expected = {wanted};",
                f'  require(same(&log.{limited[i]}, &expected, 1), "a new limit is not respected"); }}',
            ]
    return lines


_WHOLE = """
/* For each parameter another value, and whether an operation reads it; values beyond bounds. */
static const {real} tried[{macro}_PARAMETERS] = {{ {tried} }};
static const int moves[{macro}_PARAMETERS] = {{ {moves} }};
static const {real} beyond[{count}][2] = {{
    {refused} }};

/* Values beyond the bounds of a parameter are refused; values within them are set, with and without a bump. */
static void test_parameters(void)
{{
    {name}_controller c, before, other;
    {name}_input in;
    {name}_output out, own;
    {name}_log log;
    const {real} nothing = 0;
    int i, j, k;
    (void)log;
    {name}_init(&c);
    (void)replay(&c, {at});
    before = c;
    require({name}_set(&c, -1, tried[0], 1L) == {macro}_PARAMETER_REFUSED && same_state(&c, &before)
            && {name}_set(&c, {macro}_PARAMETERS, tried[0], 1L) == {macro}_PARAMETER_REFUSED && same_state(&c, &before),
        "an index without a parameter is accepted");
    for (k = 0; k < {count}; ++k) {{
        require({name}_set(&c, (int)beyond[k][0], beyond[k][1], 1L) == {macro}_PARAMETER_REFUSED && same_state(&c, &before),
            "a parameter is set beyond its bounds");
    }}
    for (k = 0; k < {macro}_PARAMETERS; ++k) {{
        c = before;
        require({name}_set(&c, k, nothing / nothing, 1L) == {macro}_PARAMETER_REFUSED && same_state(&c, &before)
                && {name}_set(&c, k, 1 / nothing, 1L) == {macro}_PARAMETER_REFUSED && same_state(&c, &before)
                && {name}_set(&c, k, -1 / nothing, 1L) == {macro}_PARAMETER_REFUSED && same_state(&c, &before),
            "a parameter is set to NaN or infinity");
        require({name}_set(&c, k, before.parameter[k], 0L) == {macro}_OK && same_state(&c, &before), "a parameter is refused");
        other = before;
        other.parameter[k] = tried[k];
        require({name}_set(&c, k, tried[k], 0L) == {macro}_OK && same_state(&c, &other), "a parameter is not set exactly");
        c = before;
        require({name}_set(&c, k, tried[k], -1L) == {macro}_OK && same_state(&c, &other), "a parameter is not set exactly");
        c = before;
        require({name}_set(&c, k, tried[k], {fade}L) == {macro}_OK, "a parameter is refused");
        if (moves[k] != 0) {{
            memcpy(other.bump, before.last_u, sizeof other.bump);
            other.fade = {fade}L;
            other.fade_left = {fade}L;
            other.matching = 1;
        }}
        require(same_state(&c, &other), "a change does not begin to fade out as it should");
        for (j = 0; j <= {fade}; ++j) {{
            const {name}_controller now = c;
            {real} bump[{macro}_INPUTS];
            in = sample({at} + j);
            other = c;
            other.matching = 0;
            other.fade_left = 0L;
            require({name}_step(&other, &in, &own) == {name}_step(&c, &in, &out), "a fade changes the status");
            for (i = 0; i < {macro}_INPUTS; ++i) {{
                bump[i] = now.matching != 0 ? now.bump[i] - own.u[i] : now.bump[i];
                if (now.fade_left > 0L) {{
                    own.u[i] = own.u[i] + bump[i] * (({real})now.fade_left / ({real})now.fade);
                }}
            }}
            require(same(out.u, own.u, {macro}_INPUTS), "a change does not fade out as it should");
            require(j > 0 || moves[k] == 0 || close_to(out.u, before.last_u, {macro}_INPUTS), "a change makes a bump");
        }}
        require(c.fade_left == 0L && c.matching == 0, "a change does not fade out in the given time");
        c = before;
        c.parameter[k] = nothing / nothing;
        in = sample({at});
        require({name}_step(&c, &in, &out) == {macro}_STATE_REFUSED, "a corrupted parameter is not refused");
        {name}_init(&c);
        other = c;
        require({name}_set(&c, k, tried[k], {fade}L) == {macro}_OK && c.matching == 0 && c.fade_left == 0L
                && same(&c.parameter[k], &tried[k], 1), "a change before the first sample fades out");
        {name}_reset(&c);
        require(same(&c.parameter[k], &tried[k], 1), "a reset changes a parameter");
        {name}_init(&c);
        require(same_state(&c, &other), "init does not restore a parameter");
    }}
{limits}}}
"""
