"""The self-test of recovery: after a result or a state out of range, the controller restarts by itself."""

from __future__ import annotations

import numpy as np

from barbalat.export.contents import Contents
from barbalat.export.layout import StatePart
from barbalat.export.shell import counted_misses, held_in_range
from barbalat.export.shell_selftest import alone_of, fallen
from barbalat.export.texts import Printed, indented
from barbalat.loop.around import MOST_COUNTED, Around
from barbalat.validate import Array


def recovery_tests(printed: Printed) -> str:
    """The text of ``test_recovery``."""
    return _WHOLE.format(
        name=printed.name,
        macro=printed.macro,
        real=printed.real,
        x=printed.measured,
        u=printed.contents.layout.u.name,
        given=_given(printed),
        fade=f"{printed.macro}_FADE" if _ends(printed.contents.around) else "0L",
        measures=int(printed.contents.measures_state),
        refused=indented(_refused(printed)),
        without=indented(_without_measurement(printed)),
    )


def _ends(around: Around | None) -> bool:
    return around is not None and around.longest is not None


def checked_values(contents: Contents) -> list[StatePart]:
    """The stored last good values that have a range or from which rates are checked. If one of them is out of range, the state is
    rejected, and otherwise every new value would exceed the rate."""
    around, layout = contents.around, contents.layout
    if around is None:
        return []
    checked = held_in_range(contents)
    pairs = (layout.measured, around.rated), (layout.r, around.command_rated)
    return [part for part, rated in pairs if rated or checked[part.name]]


def _given(printed: Printed) -> str:
    return f"in.{printed.measured}, " if printed.contents.measures_state else ""


def poked_parts(contents: Contents, *, kept: bool) -> list[StatePart]:
    """Parts of the state that give a result out of range if they are at the end of the range; learnt values are omitted if they
    are ``kept``."""
    layout = contents.layout
    spared = [layout.theta_hat, layout.started, layout.measured, layout.part("held.baseline"), *checked_values(contents)]
    learnt = [part for part in layout.parts if kept and not contents.learnt.isdisjoint(part.rows)]
    return [part for part in layout.parts if part not in (*spared, *learnt)]


def leads_out_of_range(contents: Contents, poked: list[range]) -> tuple[bool, bool]:
    """Whether the results of a good and of a lost sample are out of range if these entries are at the end of their range."""
    layout, state = contents.layout, contents.vectors.states[3].copy()
    for rows in poked:
        state[rows] = contents.range
    with np.errstate(all="ignore"):
        after = contents.evaluated(state, contents.vectors.measured[4], contents.vectors.commands[4])
        held = contents.evaluated(state, state[layout.measured.rows], state[layout.r.rows], contents.lost)
    held[layout.u.rows] = 0.0
    good, lost = (bool((np.abs(one[layout.rows]) > contents.range).any()) for one in (after, held))
    return good, lost


def pushed(contents: Contents, poked: list[range]) -> tuple[int, str] | None:
    """A sample for a state with these entries at the end of their range, and C that pushes the result of this sample out of range
    with a bump. None if every u vanishes in the rounding of such a bump."""
    u, vectors = list(contents.layout.u.rows), contents.vectors
    large = 4 + int(np.argmax(np.abs(vectors.states[4:-1, u]).max(axis=1)))
    for at in (4, large):
        state = vectors.states[at - 1].copy()
        for rows in poked:
            state[rows] = contents.range
        with np.errstate(all="ignore"):
            text = bump_beyond(contents, contents.evaluated(state, vectors.measured[at], vectors.commands[at])[u])
        if text:
            return at, text
    return None


def bump_beyond(contents: Contents, u: Array) -> str:
    """C for a fade that has just begun, with a bump that pushes this control out of range; empty if there is none."""
    numbers, most = contents.real.numbers, contents.real.numbers(contents.range)
    for i, one in enumerate(u):
        if np.abs(numbers(one)) + most > most:
            return f"c.bump[{i}] = {'-' if one < 0 else ''}{{M}}_RANGE; c.fade = 5L; c.fade_left = 5L; c.matching = 0;"
    return ""


def _without_measurement(printed: Printed) -> list[str]:
    """The test of a bad state without a measurement: u is held, and after the longest outage the fallback acts."""
    around, name, M = printed.contents.around, printed.name, printed.macro
    step, told = f"{name}_step(&c, &in, &out)", '"a bad state is not reported, or the last control is not held"'
    aged = [name for name in counted_misses(around) if name != "outage"] if printed.contents.measures_state else []
    unknown = " && ".join(f"c.{name} == {MOST_COUNTED}L" for name in aged)
    forgotten = [f'require({unknown}, "the last good values of a bad state are kept");'] if aged else []
    if not _ends(around) or not printed.contents.measures_state:
        return [f"require({step} == {M}_STATE_REFUSED && same(out.u, other.last_u, {M}_INPUTS), {told});", *forgotten]
    assert around is not None
    held = ["c.outage = -1L;", f"require({step} == {M}_STATE_REFUSED && c.outage == 1L && same(out.u, other.last_u, {M}_INPUTS),"]
    zero = f"0.0{printed.contents.real.suffix}"
    after = zero if around.baseline is not None else fallen(printed, "u")
    return [
        *([*held, f"    {told});"] if around.longest else []),
        *(_missed_calls(printed) if around.band is not None else []),
        f"memcpy(u, c.last_u, sizeof u); c.outage = {M}_LONGEST_OUTAGE;",
        f"for (i = 0; i < {M}_INPUTS; ++i) {{ u[i] = {after}; }}",
        f"require({step} == ({M}_STATE_REFUSED | {M}_FALLBACK) && c.outage == {M}_LONGEST_OUTAGE + 1L",
        f"        && same(out.u, u, {M}_INPUTS),",
        '    "no fallback acts in a bad state without a measurement");',
        f'c.outage = {MOST_COUNTED}L; require({step} != {M}_OK && c.outage == {MOST_COUNTED}L, "an outage is counted too far");',
        f"memcpy(other.last_u, c.last_u, sizeof u); c.outage = {MOST_COUNTED}L + 1L;",
        f'require({step} != {M}_OK && c.outage == 1L, "a bad count is kept"); memcpy(other.last_u, c.last_u, sizeof u);',
        *forgotten,
    ]


def _missed_calls(printed: Printed) -> list[str]:
    """The test of missed calls, and of a wrong time, in a bad state without a measurement."""
    around, M, tests = printed.contents.around, printed.macro, list[tuple[str, str, str, str]]()
    assert around is not None and around.longest is not None
    if around.longest >= 2:
        later = f" | {M}_FALLBACK" if around.longest < 3 else ""
        tests.append((printed.number(3 * around.T), f"{M}_MISSED_CALLS{later}", "3L", "missed calls do not count"))
    tests.append(("0", f"{M}_WRONG_SAMPLE_TIME | {M}_FALLBACK", f"{M}_LONGEST_OUTAGE + 1L", "a wrong time does not count"))
    lines = []
    for time, status, outage, told in tests:
        lines += [
            f"c.outage = 0L; in.sample_time = {time};",
            f"require({printed.name}_step(&c, &in, &out) == ({M}_STATE_REFUSED | {status}) && c.outage == {outage},",
            f'    "{told} in a bad state");',
            "memcpy(c.last_u, other.last_u, sizeof u);",
        ]
    return [*lines, f"in.sample_time = {M}_SAMPLE_TIME;"]


def _refused(printed: Printed) -> list[str]:
    """The test of states whose result is out of range at every sample: at first nothing changes, then the controller restarts and
    returns."""
    sides: list[int | None] = [*sorted({side for _, side in printed.limits()})] or [None]
    lines = [line for side in sides for line in _begun_again(printed, kept=1, beyond=side)]
    lines += _begun_again(printed, kept=0)
    return [line.format(n=printed.name, M=printed.macro, x=printed.measured) for line in lines]


def _begun_again(printed: Printed, *, kept: int, beyond: int | None = None) -> list[str]:
    """The test with the learnt values kept or reset; empty if no such state gives a result out of range, not even with a bump.

    beyond  the limit (0 for the lower one) that the held control exceeds; None for a control of the run
    """
    contents, layout, around = printed.contents, printed.contents.layout, printed.contents.around
    poked = poked_parts(contents, kept=bool(kept))
    own, rows = layout.part("held.baseline"), [part.rows for part in poked]
    good, lost = leads_out_of_range(contents, rows)
    at, fades = 4, "c.fade = 5L; c.fade_left = 3L; c.matching = 1;"
    if not good:
        at, fades = pushed(contents, rows if kept or own is None else [*rows, own.rows]) or (0, "")
    if not fades:
        return []
    ends, longest = _ends(around), None if around is None else around.longest
    aged = [name for name in counted_misses(around) if name != "outage"]
    status = "({M}_RESULT_REFUSED | {M}_FALLBACK)" if ends else "{M}_RESULT_REFUSED"
    others = [part for part in layout.parts if part != layout.u and (part != own or not kept)]
    same = "\n        && ".join(f"same(c.{part.name}, other.{part.name}, {part.size})" for part in others)
    at_rest = [
        f"{fades} before = c; before.refused = 1;"
        + " before.outage = 1L;" * ends
        + "".join(f" before.{name} = 1L;" for name in aged),
        "require({n}_step(&c, &in, &out) == {M}_RESULT_REFUSED && same_state(&c, &before),",
        '    "a first result out of range changes the state");',
    ]
    tolerated = [
        "c.outage = {M}_LONGEST_OUTAGE - 1L; before.outage = {M}_LONGEST_OUTAGE; before.refused = 2;"
        + "".join(f" before.{name} = 2L;" for name in aged),
        "require({n}_step(&c, &in, &out) == {M}_RESULT_REFUSED && same_state(&c, &before),",
        '    "the controller begins again too early");',
    ]
    first = [*(at_rest if longest != 0 else []), *(tolerated if longest else [])]
    return [
        f"{{n}}_init(&c); (void)replay(&c, {at}); in = sample({at});",
        *(f"for (i = 0; i < {part.size}; ++i) {{{{ c.{part.name}[i] = {{M}}_RANGE; }}}}" for part in poked),
        *(first if kept else ["c.refused = {M}_REFUSALS - 1;"]),
        *([] if kept or own is None else [f"for (i = 0; i < {own.size}; ++i) {{{{ c.{own.name}[i] = {{M}}_RANGE; }}}}"]),
        "c.outage = {M}_LONGEST_OUTAGE;" * ends + ("c.fade = 0L; c.fade_left = 0L; c.matching = 0;" if ends and good else fades),
        *(_BEYOND[beyond] if beyond is not None and not ends else []),
        "other = c; before = c;",
        "memcpy(u, c.last_u, sizeof u);" if kept else "for (i = 0; i < {M}_INPUTS; ++i) {{ u[i] = 0; }}",
        f"(void){{n}}_start(&other, {_given(printed)}u, 0L, {kept}); (void){{n}}_step(&other, &in, &out);",
        f"require({{n}}_step(&c, &in, &out) == {status}"
        + " && c.outage == {M}_LONGEST_OUTAGE + 1L" * ends
        + "".join(f" && c.{name} == 0L" for name in aged)
        + ",",
        '    "the status differs after results out of range");',
        f"require({same},",
        f'    "the controller does not begin again {"with" if kept else "without"} what was learnt");',
        _fallen(printed),
        'require(same(out.u, u, {M}_INPUTS) && same(c.last_u, u, {M}_INPUTS), "u differs after results out of range");',
        *([] if ends else _NO_FADE),
        *(_COUNTED if kept else []),
        *([*_NOT_COUNTED, f"in = sample({at});"] if kept and lost else []),
        *(_AT_WRONG_TIME if kept and lost and around is not None and around.band is not None else []),
        f"in = sample({at + 1});",
        "require({n}_step(&c, &in, &out) == {M}_OK && c.refused == 0" + " && c.outage == 0L" * ends + ",",
        '    "the controller does not return after results out of range");',
        *(
            ['require(close_to(out.u, u, {M}_INPUTS), "this return causes a bump");']
            if around is not None and around.fades
            else []
        ),
    ]


def _fallen(printed: Printed) -> str:
    """C that turns ``u``, the last control, into the output: the first control of the fallback, or the limited held control."""
    acts = _ends(printed.contents.around)
    alone = alone_of(printed).replace("{", "{{").replace("}", "}}") if acts else ""
    inside = "u[i] = u[i] < limits[i][0] ? limits[i][0] : u[i] > limits[i][1] ? limits[i][1] : u[i];"
    found = fallen(printed, "u") if acts else "u[i]"
    return f"{{{{ {alone} for (i = 0; i < {{M}}_INPUTS; ++i) {{{{ u[i] = {found}; {inside} }}}} }}}}"


_BEYOND = [
    ["for (i = 0; i < {M}_INPUTS; ++i) {{ if (limits[i][1] <= {M}_RANGE) {{ c.last_u[i] = limits[i][0] - 1; }} }}"],
    ["for (i = 0; i < {M}_INPUTS; ++i) {{ if (limits[i][1] <= {M}_RANGE) {{ c.last_u[i] = limits[i][1] + 1; }} }}"],
]
_NO_FADE = ['require(c.fade_left == 0L && c.matching == 0, "a fade goes on after results out of range");']
_COUNTED = [
    "other = before; other.refused = {M}_REFUSALS;",
    "require(({n}_step(&other, &in, &out) & {M}_RESULT_REFUSED) != 0u && other.refused == {M}_REFUSALS,",
    '    "refused results are counted too far");',
]
_NOT_COUNTED = [
    "other = before; other.refused = 3; in.{x}[0] = nothing / nothing;",
    "require(({n}_step(&other, &in, &out) & {M}_RESULT_REFUSED) != 0u && other.refused == 3,",
    '    "a lost sample counts as a refused result");',
]
"""For a lost sample."""
_AT_WRONG_TIME = [
    "other = before; other.outage = 0L; in.sample_time = 0;",
    "require({n}_step(&other, &in, &out) == ({M}_RESULT_REFUSED | {M}_WRONG_SAMPLE_TIME | {M}_FALLBACK)",
    "        && other.outage == {M}_LONGEST_OUTAGE + 1L,",
    '    "a result out of range at a wrong time is not followed by the fallback at once");',
]
_WHOLE = """
/* The controller begins again by itself after results out of range, and from a state out of range at a good measurement. */
static void test_recovery(void)
{{
    {name}_controller c, other, before;
    {name}_input in;
    {name}_output out;
    {real} u[{macro}_INPUTS];
    const {real} nothing = 0;
    int i;
    (void)before; (void)u; (void)i;
    {name}_init(&c);
    (void)replay(&c, 4);
    other = c;
    c.{u}[0] = nothing / nothing;
    c.refused = 1;
    in = sample(4);
    in.{x}[0] = nothing / nothing;
{without}    in = sample(4);
    require({measures} == 0 || ({name}_step(&c, &in, &out) == {macro}_STATE_REFUSED && same(out.u, other.last_u, {macro}_INPUTS)),
        "the controller begins again without a measurement");
    (void){name}_start(&other, {given}other.last_u, {fade}, 0);
    require(same_state(&c, &other), "the controller does not begin again from a bad state");
    require({name}_step(&c, &in, &out) == {macro}_OK, "the controller does not return from a bad state");
{refused}}}
"""
