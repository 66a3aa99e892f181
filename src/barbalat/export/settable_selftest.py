"""The self-test of settable parameters: rejected values, the effect of a change, and the absence of a bump, even during another
fade."""

from __future__ import annotations

import numpy as np

from barbalat.export import acceptance
from barbalat.export.acceptance import Apart, Norm, Order
from barbalat.export.contents import Contents
from barbalat.export.log import logged
from barbalat.export.settable import parameter_names
from barbalat.export.texts import Printed, indented
from barbalat.loop.around import MOST_COUNTED
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
        most=MOST_COUNTED,
        started=contents.layout.started.name, u=contents.layout.u.name, tried=", ".join(numbers), moves=", ".join(moves),
        count=len(_beyond(contents)), refused=refused, limits=indented(_limits(printed, at)),
        given=f"in.{printed.measured}, " if contents.measures_state else "", returned=_returned(printed, at),
    )  # fmt: skip


def tried(contents: Contents) -> list[float]:
    """A different value for each parameter."""
    opened = contents.opened
    assert opened is not None
    return [opened.tried[opened.parameters.index(one)] for one in contents.parameters]


def _beyond(contents: Contents) -> list[tuple[int, float]]:
    """Indices of parameters, and values just beyond or far beyond their bounds."""
    numbers, found = contents.real.numbers, []
    values = np.array([one.value for one in contents.parameters])
    for condition in contents.conditions:
        if isinstance(condition, Apart):
            found += [(i, condition.value) for i in acceptance.numbers(condition) if len(condition.numbers) == 1]
            continue
        strict = isinstance(condition, Order) and condition.strict
        for i in sorted(acceptance.numbers(condition)):
            for end, towards in zip(condition.around(i, values), (-np.inf, np.inf), strict=True):
                if np.isinf(end):
                    continue
                far = np.copysign(abs(values[i]) or 1.0, towards)
                beyond = end + FAR_BEYOND * far if isinstance(condition, Norm) else np.nextafter(numbers(end), numbers(towards))
                found += [(i, float(end if strict else beyond)), (i, float(end + far))]
    most = numbers(contents.parameter_range)
    return [*found, *((i, float(np.nextafter(most, numbers(np.inf)))) for i in range(len(contents.parameters)))]


FAR_BEYOND = 1e-3
"""Relative distance from the limit of a norm, which is tested up to rounding, to a value beyond it."""


def _limits(printed: Printed, at: int) -> list[str]:
    """A newly set control limit takes effect."""
    contents, lines = printed.contents, []
    limited = [one.name for one in logged(printed) if one.text.startswith("out.u_limited")]
    for which, (one, value) in zip(parameter_names(printed), zip(contents.parameters, tried(contents), strict=True), strict=True):
        if one.limit is None:
            continue
        i, side = one.limit
        between = (one.value + value) / 2
        kept = max(between, value) if side == 0 else min(between, value)  # the tighter limit
        for u, expected in ((value + (1.0 if side else -1.0), value), (between, kept)):
            asked, wanted = (c99.constant(number, contents.real) for number in (u, expected))
            lines += [
                f"c = before; (void){printed.name}_set(&c, {which}, tried[{which}], 0L); c.last_u[{i}] = {asked};",
                f"{printed.name}_read_log(&c, &log);",
                f"{{ const {printed.real} expected = {wanted};",
                f'  require(same(&log.{limited[i]}, &expected, 1), "a new limit is not respected"); }}',
            ]
        if (far := _refused_beyond(contents, contents.parameters.index(one), side)) is not None:
            ends = contents.around is not None and contents.around.longest is not None
            acts = f"(out.status & {printed.macro}_FALLBACK) != 0u || " if ends else ""
            names = {"name": printed.name, "macro": printed.macro, "which": which, "at": at, "i": i, "acts": acts}
            numbers = {"far": c99.constant(far, contents.real), "zero": c99.constant(0.0, contents.real)}
            lines += _CORRUPTED_LIMIT.format(**numbers, **names).splitlines()
    return lines


def _refused_beyond(contents: Contents, k: int, side: int) -> float | None:
    """A value of a lower (side 0) or upper limit that is far beyond the opposite limit and that the case rejects; None if it
    rejects no such value."""
    values = np.array([one.value for one in contents.parameters])
    for far in (10.0, 1e3, 1e5):
        values[k] = far if side == 0 else -far
        if not contents.takes(values[:, None])[0]:
            return float(values[k])
    return None


_CORRUPTED_LIMIT = """\
c = before; c.last_u[{i}] = {zero}; c.parameter[{which}] = {far};
in = sample({at});
require(({name}_step(&c, &in, &out) & {macro}_STATE_REFUSED) != 0u && out.u_limited[{i}] == out.u[{i}]
        && ({acts}out.u[{i}] == {zero}), "a corrupted limit drives the control");"""


def _returned(printed: Printed, at: int) -> str:
    """The test that u continues without a bump after a fallback, even if a parameter has been set; empty without a longest
    outage."""
    around = printed.contents.around
    if around is None or around.longest is None:
        return ""
    return _RETURNED.format(name=printed.name, macro=printed.macro, at=at)


_RETURNED = """\
        c = before;
        c.outage = {macro}_LONGEST_OUTAGE + 1L;
        other = c;
        in = sample({at});
        require({name}_set(&c, k, tried[k], 1L) == {macro}_OK && {name}_step(&c, &in, &out) == {name}_step(&other, &in, &own)
                && c.change == 0L && c.fade == {macro}_FADE && close_to(out.u, own.u, {macro}_INPUTS),
            "a return from the fallback after a change makes a bump");
"""
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
    {name}_output out, own, was;
    {name}_log log;
    const {real} nothing = 0;
    int i, j, k;
    (void)log;
    {name}_init(&c);
    (void)replay(&c, {at});
    for (i = 0; i < {macro}_INPUTS; ++i) {{
        c.bump[i] = 1;
    }}
    c.fade = 7L;
    c.fade_left = 2L;
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
        for (j = -1; j <= 1; ++j) {{
            c = before;
            require({name}_set(&c, k, tried[k], {most}L + j) == {macro}_OK
                    && c.change == (moves[k] == 0 ? 0L : j < 0 ? {most}L - 1L : {most}L),
                "a change does not fade out over the given number of samples, or over more than are counted");
        }}
        c = before;
        require({name}_set(&c, k, tried[k], {fade}L) == {macro}_OK, "a parameter is refused");
        if (moves[k] != 0) {{
            memcpy(other.previous, before.parameter, sizeof other.previous);
            other.change = {fade}L;
        }}
        require(same_state(&c, &other), "a change does not begin to fade out as it should");
        in = sample({at});
        other = before;
        (void){name}_step(&other, &in, &was);
        for (j = 0; j <= {fade}; ++j) {{
            const {name}_controller now = c;
            const int begins = j == 0 && moves[k] != 0;
            const long left = begins != 0 ? {fade}L : now.fade_left;
            {real} bump[{macro}_INPUTS];
            in = sample({at} + j);
            other = c;
            other.change = 0L;
            other.matching = 0;
            other.fade_left = 0L;
            require({name}_step(&other, &in, &own) == {name}_step(&c, &in, &out), "a fade changes the status");
            for (i = 0; i < {macro}_INPUTS; ++i) {{
                bump[i] = begins != 0 ? was.u[i] - own.u[i] : now.bump[i];
                if (left > 0L) {{
                    own.u[i] = own.u[i] + bump[i] * (({real})left / ({real})(begins != 0 ? {fade}L : now.fade));
                }}
            }}
            require(same(out.u, own.u, {macro}_INPUTS), "a change does not fade out as it should");
            memcpy(other.{u}, own.u, sizeof other.{u});
            memcpy(other.last_u, own.u, sizeof other.last_u);
            memcpy(other.bump, bump, sizeof other.bump);
            other.fade = begins != 0 ? {fade}L : now.fade;
            other.fade_left = left > 0L ? left - 1L : 0L;
            require(same_state(&c, &other), "after a change the state does not continue with the new value");
            require(j > 0 || moves[k] == 0 || close_to(out.u, was.u, {macro}_INPUTS), "a change causes a bump");
        }}
        require(c.fade_left == 0L && c.matching == 0 && c.change == 0L, "a change does not fade out in the given time");
        if (moves[k] != 0) {{
            c = before;
            (void){name}_set(&c, k, tried[k], {fade}L);
            (void){name}_set(&c, k, before.parameter[k], 0L);
            require(same(c.previous, before.parameter, {macro}_PARAMETERS) && c.change == {fade}L,
                "a second change ends the first");
            (void){name}_set(&c, k, tried[k], {fade}L);
            (void){name}_set(&c, k, before.parameter[k], {fade}L + 1L);
            require(same(c.previous, before.parameter, {macro}_PARAMETERS) && c.change == {fade}L + 1L,
                "a second change forgets where the first began");
            in.{measured}[0] = nothing / nothing;
            (void){name}_step(&c, &in, &out);
            require(same(c.previous, before.parameter, {macro}_PARAMETERS) && c.change == {fade}L + 1L,
                "a lost sample ends a change");
            in = sample({at});
            require({name}_start(&c, {given}before.last_u, 1L, 1) == {macro}_OK && c.change == 0L, "a start keeps a change");
            c = before;
            (void){name}_set(&c, k, tried[k], {fade}L);
            {name}_reset(&c);
            require(c.change == 0L, "a reset keeps a change");
            c = before;
            c.bump[0] = was.u[0] > 0 ? {macro}_RANGE : -{macro}_RANGE;
            c.fade_left = 7L;
            (void){name}_set(&c, k, tried[k], {fade}L);
            (void){name}_step(&c, &in, &out);
            require(c.change == 0L, "a refused result keeps a change");
        }}
        c = before;
        c.parameter[k] = nothing / nothing;
        require({name}_set(&c, k, tried[k], {fade}L) == {macro}_OK && c.change == 0L, "a corrupted number fades out");
        c = before;
        c.previous[k] = nothing / nothing;
        other = before;
        require({name}_step(&c, &in, &out) == {name}_step(&other, &in, &own), "a number that is not needed is read");
        c = before;
        c.previous[k] = nothing / nothing;
        c.change = 1L;
        require({name}_step(&c, &in, &out) == {macro}_STATE_REFUSED && c.change == 0L, "a corrupted old number is not refused");
        c = before;
        c.change = -1L;
        require({name}_step(&c, &in, &out) == {macro}_STATE_REFUSED, "a negative count of a change is not refused");
{returned}        c = before;
        c.parameter[k] = nothing / nothing;
        in = sample({at});
        require({name}_step(&c, &in, &out) == {macro}_STATE_REFUSED, "a corrupted parameter is not refused");
        {name}_init(&c);
        other = c;
        require({name}_set(&c, k, tried[k], {fade}L) == {macro}_OK && c.change == 0L
                && same(&c.parameter[k], &tried[k], 1), "a change before the first sample fades out");
        {name}_reset(&c);
        require(same(&c.parameter[k], &tried[k], 1), "a reset changes a parameter");
        {name}_init(&c);
        require(same_state(&c, &other), "init does not restore a parameter");
    }}
{limits}}}
"""
