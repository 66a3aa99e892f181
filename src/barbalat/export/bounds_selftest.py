"""The self-test of bounds on numbers and counters of the state, on times between two calls, and on the control after rejected
results."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from barbalat.export.recovery_selftest import bump_beyond, leads_out_of_range, poked_parts, pushed
from barbalat.export.shell import counted_misses, counters, held_in_range, members
from barbalat.export.shell_selftest import MOST_MADE_UP, jitter
from barbalat.export.texts import Printed, indented
from barbalat.loop.around import MOST_COUNTED
from barbalat.validate import Array

COMPARED = "age", "command_outage"
"""The counters that determine whether rates are checked against the last good measurement and command."""


def bounds_tests(printed: Printed) -> str:
    """The text of ``test_bounds``."""
    contents, around = printed.contents, printed.contents.around
    lines = [*_numbers(printed), *_last_good(printed), *_counts(printed)]
    times = around is not None and around.band is not None
    lines += _CALLS if times and around is not None and 1 <= (around.longest or 0) <= MOST_MADE_UP else []
    if around is not None and around.longest is not None:
        lines += _beyond_limits(printed)
    lines += _undone(printed)
    off, reported = jitter(printed)
    given = {"n": printed.name, "M": printed.macro, "x": printed.measured, "off": off, "reported": reported, "real": printed.real}
    given |= {"y": f"in.{printed.measured}, " if contents.measures_state else "", "wrong": ""}
    given |= {"half_band": printed.number((around.band or 0.0) / 2) if around is not None else ""}
    given["wrong"] = _WRONG_TIME.format(**given) if times else ""
    given |= {"counted": indented(_forgotten(printed))}
    return _WHOLE.format(tests=indented(line.format(**given) for line in lines), **given)


def _numbers(printed: Printed) -> Iterator[str]:
    """Test that each number of the state is checked at both ends and for NaN, even when rates are no longer compared with it."""
    forgotten = "".join(f" c.{name} = {MOST_COUNTED}L;" for name in counted_misses(printed.contents.around) if name in COMPARED)
    layout, sizes = printed.contents.layout, {"last_u": printed.contents.sizes[2], "bump": printed.contents.sizes[2]}
    for name, size in ({part.name: part.size for part in layout.parts if part.size} | sizes).items():
        yield f"for (i = 0; i < {3 * size}; ++i) {{{{"
        yield f"    {{n}}_init(&c); (void)replay(&c, 2);{forgotten}"
        yield f"    c.{name}[i / 3] = i % 3 == 0 ? nothing / nothing : (i % 3 == 1 ? -2 : 2) * {{M}}_RANGE;"
        yield f'    require(refuses_state(&c), "a number out of range is not refused: {name}");'
        yield "}}"
    for sign in ("-", ""):
        yield f"{{n}}_init(&c); (void)replay(&c, 2); c.bump[0] = {sign}{{M}}_RANGE;"
        yield 'require(!refuses_state(&c), "a number at the end of the range is refused");'


def _last_good(printed: Printed) -> Iterator[str]:
    """Each checked entry of the last good measurement and command, at both ends of its range and just beyond them."""
    around, layout, numbers = printed.contents.around, printed.contents.layout, printed.contents.real.numbers
    if around is None:
        return
    checked = held_in_range(printed.contents)
    for part, low, high in (
        (layout.measured, around.low, around.high),
        (layout.r, around.command_low, around.command_high),
    ):
        for i in checked[part.name]:
            for end, far in ((numbers(low[i]), -np.inf), (numbers(high[i]), np.inf)):
                for value, bad in ((end, 0), (np.nextafter(end, numbers(far)), 1)):
                    if abs(end) <= printed.contents.range:
                        yield f"{{n}}_init(&c); (void)replay(&c, 2); c.{part.name}[{i}] = {printed.number(float(value))};"
                        yield f'require(refuses_state(&c) == {bad}, "the range of a last good value differs: {part.name}");'


def _counts(printed: Printed) -> Iterator[str]:
    """Test that each counter is accepted at both ends of its range, is rejected beyond them, and stays at the upper end."""
    around = printed.contents.around
    most = members(around)
    most |= {} if around is None else dict(zip(counters(around), (one for _, one in around.repeats), strict=True))
    ends = [(f"c.{name}", value, bad) for name, end in most.items() for value, bad in ((-1, 1), (0, 0), (end, 0), (end + 1, 1))]
    ends += [("c.fade = 5L; c.fade_left", value, bad) for value, bad in ((-1, 1), (5, 0), (6, 1))]
    for setting, value, bad in ends:
        yield f"{{n}}_init(&c); (void)replay(&c, 2); {setting} = {value}L;"
        yield f'require(refuses_state(&c) == {bad}, "the limits of a count differ: {setting.split()[-1]}");'
    for name in counted_misses(around):
        lost = "r" if "command" in name else "{x}"
        yield f"{{n}}_init(&c); (void)replay(&c, 2); c.{name} = {MOST_COUNTED - 1}L;"
        yield f"for (k = 0; k < 2; ++k) {{{{ in = sample(2); in.{lost}[0] = nothing / nothing;"
        yield f"    require(({{n}}_step(&c, &in, &out) & {{M}}_STATE_REFUSED) == 0u && c.{name} == {MOST_COUNTED}L,"
        yield f'        "a long outage is not counted to its end: {name}"); }}}}'


def _forgotten(printed: Printed) -> list[str]:
    """Test that a reset clears every counter."""
    around, name = printed.contents.around, printed.name
    after = {one: MOST_COUNTED if one in COMPARED else 0 for one in (*members(around), *counters(around))}
    lines = [*(f"c.{one} = 1L;" for one in after), f"{name}_reset(&c);"]
    return lines + [f'require(c.{one} == {count}L, "a reset keeps a count: {one}");' for one, count in after.items()]


def _beyond_limits(printed: Printed) -> Iterator[str]:
    """Test that, after a result out of range beyond the longest outage, u is within the limits, however far the last u exceeded
    them."""
    poked = poked_parts(printed.contents, kept=True)
    rows = [part.rows for part in poked]
    at, push = (4, "") if leads_out_of_range(printed.contents, rows)[0] else pushed(printed.contents, rows) or (0, "")
    if not printed.limits() or not at:
        return
    for side, sign in ((0, "-"), (1, "+")):
        yield f"{{n}}_init(&c); (void)replay(&c, {at}); in = sample({at}); c.outage = {{M}}_LONGEST_OUTAGE; {push}"
        yield from (f"for (i = 0; i < {part.size}; ++i) {{{{ c.{part.name}[i] = {{M}}_RANGE; }}}}" for part in poked)
        yield "for (i = 0; i < {M}_INPUTS; ++i) {{"
        yield f"    const {{real}} limit = limits[i][{side}], size = limit > 0 ? limit : -limit;"
        yield f"    if (size <= {{M}}_RANGE) {{{{ c.last_u[i] = limit {sign} 3 * (1 + size); }}}}"
        yield "}}"
        yield "require(({n}_step(&c, &in, &out) & {M}_RESULT_REFUSED) != 0u, "
        yield '    "a result out of range is accepted");'
        yield "require(same(out.u, out.u_limited, {M}_INPUTS) && same(out.u, c.last_u, {M}_INPUTS) && is_limited(&out),"
        yield '    "the controller begins again beyond the limits of the control");'


def _undone(printed: Printed) -> Iterator[str]:
    """The tests of measurements at which the controller cannot begin again, because the result of a start or of the baseline
    would be out of range: only the counters change."""
    contents, around, layout = printed.contents, printed.contents.around, printed.contents.layout
    ends = around is not None and around.longest is not None
    poked = poked_parts(contents, kept=True)
    for value in _out_of_reach(printed):
        state, command = contents.vectors.states[3].copy(), contents.vectors.commands[4]
        for part in poked:
            state[part.rows] = contents.range
        state[list(layout.measured.rows)] = value
        with np.errstate(all="ignore"):
            after = contents.evaluated(state, value, command)
        out = bool((np.abs(after[layout.rows]) > contents.range).any())
        push = "" if out else bump_beyond(contents, after[list(layout.u.rows)])
        if not (out or push):
            continue
        outage = " c.outage = {M}_LONGEST_OUTAGE;" * ends
        yield f"{{n}}_init(&c); (void)replay(&c, 4); in = sample(4); c.refused = 1;{outage} {push}"
        yield from (f"for (i = 0; i < {part.size}; ++i) {{{{ c.{part.name}[i] = {{M}}_RANGE; }}}}" for part in poked)
        for i, one in enumerate(value):
            yield f"in.{{x}}[{i}] = c.{layout.measured.name}[{i}] = {printed.number(float(one))};"
        yield "other = c; other.refused = 2;" + " other.outage = {M}_LONGEST_OUTAGE + 1L;" * ends
        yield from (f"other.{name} = 1L;" for name in counted_misses(around) if name != "outage")
        yield from ["other.paused = c.fade_left;"] if "paused" in members(around) else []
        yield f"require({{n}}_step(&c, &in, &out) == ({{M}}_RESULT_REFUSED{' | {M}_FALLBACK' * ends}) && same_state(&c, &other),"
        yield '    "a state or an output changes although the result of a new beginning is out of range, too");'


def _out_of_reach(printed: Printed) -> Iterator[Array]:
    """Accepted measurements at which a start, or the baseline if it acts as the fallback, gives a result out of range."""
    contents, around = printed.contents, printed.contents.around
    most, free = contents.range, np.full(contents.sizes[0], np.inf)
    low, high = (-free, free) if around is None else (around.low, around.high)
    low, high = np.maximum(low, -0.99 * most), np.minimum(high, 0.99 * most)
    rest, of_x = contents.at_start
    for row in np.flatnonzero(np.abs(of_x).sum(axis=1) > 1):
        value = np.where(of_x[row] > 0, high, low)
        if rest[row] + of_x[row] @ value > 1.01 * most:
            yield value
            break
    if around is None or around.baseline is None:
        return
    commands = np.abs(contents.vectors.commands[4]).max()
    for row, gains in zip(around.baseline.K[:, : contents.sizes[0]], around.baseline.k_r, strict=True):
        value = np.where(row > 0, low, high)
        if -row @ value - np.abs(gains).sum() * commands > 1.01 * most:
            yield value


_CALLS = [
    "{n}_init(&c); (void)replay(&c, 4); other = c; none = sample(4); in = sample(4); in.sample_time = 2 * {M}_SAMPLE_TIME;",
    "for (i = 0; i < {M}_MEASURED; ++i) {{ none.{x}[i] = nothing / nothing; }}",
    "for (i = 0; i < {M}_COMMANDS; ++i) {{ none.r[i] = nothing / nothing; }}",
    'require({n}_step(&c, &in, &out) == {M}_MISSED_CALLS, "a single missed call is not reported");',
    "in = sample(4); (void){n}_step(&other, &none, &out); (void){n}_step(&other, &in, &out);",
    'require(same_state(&c, &other), "a single missed call does not count as a miss");',
    "{n}_init(&c); {n}_init(&other); in = sample(0);",
    "(void){n}_step(&other, &in, &out);",
    "in.sample_time = 2 * {M}_SAMPLE_TIME;",
    'require({n}_step(&c, &in, &out) == {M}_MISSED_CALLS && same_state(&c, &other), "a call is missed before the first sample");',
    "{n}_init(&c); (void)replay(&c, 4); in = sample(4);",
    "in.sample_time = ({real})({M}_LONGEST_OUTAGE + 1L) * {M}_SAMPLE_TIME + {half_band};",
    "require(({n}_step(&c, &in, &out) & ({M}_MISSED_CALLS | {M}_WRONG_SAMPLE_TIME)) == {M}_MISSED_CALLS,",
    '    "missed calls up to the longest outage are not processed if the last one is late");',
    "{n}_init(&c); (void)replay(&c, 4); c.outage = {M}_LONGEST_OUTAGE; in = sample(4); in.sample_time = 2 * {M}_SAMPLE_TIME;",
    'require({n}_step(&c, &in, &out) == {M}_MISSED_CALLS, "the fallback of a missed call is reported although it has ended");',
    "{n}_init(&c); (void)replay(&c, 4); c.fade_left = -1L; other = c; in = sample(4);",
    "(void){n}_step(&other, &in, &out); in.sample_time = 2 * {M}_SAMPLE_TIME;",
    "require({n}_step(&c, &in, &out) == ({M}_MISSED_CALLS | {M}_STATE_REFUSED) && same_state(&c, &other),",
    '    "the controller does not begin again at once if calls were missed before a bad state");',
]
_WRONG_TIME = """\
    {n}_init(&c); (void)replay(&c, 4); in = sample(4); in.sample_time = 0;
    (void){n}_step(&c, &in, &out);
    require(c.outage == {M}_LONGEST_OUTAGE + 1L, "a wrong time does not count as the longest outage");
    c.outage = {M}_LONGEST_OUTAGE + 2L;
    (void){n}_step(&c, &in, &out);
    require(c.outage == {M}_LONGEST_OUTAGE + 3L, "a wrong time begins an outage again");
"""
_WHOLE = """
/* Whether this state is refused. */
static int refuses_state({n}_controller *c)
{{
    {n}_input in = sample(2);
    {n}_output out;
    return ({n}_step(c, &in, &out) & {M}_STATE_REFUSED) != 0u;
}}

/* The largest and smallest accepted values of every number and count of the state, and of the time between two calls. */
static void test_bounds(void)
{{
    {n}_controller c, other;
    {n}_input in, none;
    {n}_output out;
    const {real} nothing = 0;
    int i, k;
    (void)other; (void)none; (void)k;
{tests}    {n}_init(&c);
    in = sample(0);
    (void){n}_start(&c, {y}controls[0], 1L, 0);
    require(c.fade == 1L && c.fade_left == 1L, "a fade over one sample does not act");
    c.refused = 1;
{counted}    require(c.fade == 0L && c.fade_left == 0L && c.matching == 0 && c.refused == 0, "a reset keeps a fade or refusals");
    for (i = 0; i < 2; ++i) {{ /* a lost input, and at the same time another sample time */
        {n}_init(&c);
        (void)replay(&c, 2);
        in = sample(2);
        in.sample_time = {off};
        *(i == 0 ? &in.r[0] : &in.{x}[0]) = nothing / nothing;
        k = (int)({n}_step(&c, &in, &out) & ({reported} | {M}_COMMAND_LOST | {M}_MEASUREMENT_LOST));
        require(k == (int)({reported} | (i == 0 ? {M}_COMMAND_LOST : {M}_MEASUREMENT_LOST)), "one status replaces another");
    }}
{wrong}}}
"""
