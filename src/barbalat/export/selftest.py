"""selftest.c replays the simulation's samples, compares every bit, and tests everything else on which a flight computer
relies."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.export.bounds_selftest import bounds_tests
from barbalat.export.contents import FEWEST_VECTORS, Contents
from barbalat.export.edges_selftest import edges_tests
from barbalat.export.evidence import PRIME, chosen_tests, digest_calls, digests, number_rows
from barbalat.export.log import log_of_u, log_values
from barbalat.export.outage_selftest import GOOD, MISS, outage_tests, surrounded
from barbalat.export.recovery_selftest import checked_values, recovery_tests
from barbalat.export.settable_selftest import settable_tests
from barbalat.export.shell import counted_misses, counters, members
from barbalat.export.shell_selftest import alone_of, fallen, jitter, shell_tests
from barbalat.export.texts import Printed, filled, indented
from barbalat.loop.around import MOST_COUNTED, Around
from barbalat.lowering import c99
from barbalat.validate import Array

MEASUREMENT_LOST, COMMAND_LOST, FROZEN = 1, 2, 4
"""The faults and requests of a sample in the run with losses."""
LOSSES = (1, 3, 2, 0, 0, 1, 0, 2, 0, 1, 1, 1, 0, 1, 0, 1, 0, 3, 0, 4, 4, 1, 5, 0)
"""Losses before the first good sample, single losses, several losses in a row, and loss of every second sample, for each signal
and for both."""
FADE = 4
"""Number of samples over which a start fades out in the self-test: a power of two, so that the fractions of a bump are exact."""


def selftest(printed: Printed) -> str:
    """The text of selftest.c."""
    contents, layout, macro = printed.contents, printed.contents.layout, printed.macro
    vectors, state = contents.vectors, contents.measures_state
    estimates = vectors.states[:, list(layout.theta_hat.rows)]
    lossy, standstill, (off, reported) = with_losses(contents), _standstill(printed), jitter(printed)
    longest = None if contents.around is None else contents.around.longest
    table = f"static const {printed.real} estimates[SAMPLES][{macro}_ESTIMATES] = {{\n{number_rows(printed, estimates)}}};\n"
    differ = f"\n            || !same(out.theta_hat, estimates[k], {macro}_ESTIMATES)"
    chosen = chosen_tests(printed)
    return filled(
        "selftest.c",
        digests=digests(printed),
        digest_calls=digest_calls(printed),
        width=64 if contents.real is c99.DOUBLE else 32,
        prime=f"{PRIME:#x}ULL",
        chosen_tests=chosen,
        run_chosen=indented(["test_chosen();"]) if chosen else "",
        origin=printed.origin,
        guard=printed.guard,
        name=printed.name,
        macro=macro,
        most=MOST_COUNTED,
        real=printed.real,
        samples=len(vectors.states),
        measured=printed.measured,
        measured_rows=number_rows(printed, vectors.measured),
        command_rows=number_rows(printed, vectors.commands),
        control_rows=number_rows(printed, vectors.states[:, list(layout.u.rows)]),
        estimate_table=table if contents.sizes[3] else "",
        estimates_differ=differ if contents.sizes[3] else "",
        limit_rows=_limit_rows(printed),
        losses=", ".join(map(str, LOSSES[: len(lossy)])),
        lossy_rows=number_rows(printed, lossy[:, list(layout.u.rows)]),
        log_row=", ".join(c99.constant(value, contents.real) for value in log_values(printed, vectors.states[-1])),
        log_of_u=log_of_u(printed),
        same_state=_same_state(printed),
        state_tests=indented(_state_is(printed, vectors.states[-1])),
        lossy_tests=indented(_state_is(printed, lossy[-1])),
        frozen_tests=indented(_resting(printed, "frozen, and"), 8),
        limit_tests=indented(_limits(printed)),
        lost=f"{contents.lost:g}",
        **_after_a_refusal(printed),
        off=off,
        reported=reported,
        standstill=standstill
        + shell_tests(printed)
        + outage_tests(printed)
        + recovery_tests(printed)
        + bounds_tests(printed)
        + edges_tests(printed)
        + settable_tests(printed, _where_u_is_large(contents), FADE),
        timer_tests=_timer_tests(printed),
        mirror_outage=indented(_mirrored(contents.around), 12),
        mirror_command=indented(
            ["other.command_outage = c.command_outage;"] if "command_outage" in members(contents.around) else [], 8
        ),
        refused_tests=indented(_refused_tests(printed)),
        fade_test=indented(
            ["test_fade();" if longest is None or longest > 0 else "(void)test_fade; /* no outage is tolerated */"]
        ),
        told="" if longest is None else f" & ~{macro}_FALLBACK",
        shell_test=indented(["test_recovery();", "test_bounds();", "test_edges();"])
        + indented(["test_shell();"] if contents.around is not None else [])
        + indented(["test_outages();"] if longest is not None else [])
        + indented(["test_parameters();"] if contents.parameters else []),
        stands_still=indented(["test_standstill();"]) if standstill else "",
        first_miss=indented(_first_miss(printed)),
        elsewhere=indented(f"c.{name} = 1;" for name in ("refused", *members(contents.around), *counters(contents.around)))
        + indented(f"for (i = 0; i < {part.size}; ++i) {{ c.{part.name}[i] = 2; }}" for part in layout.parts),
        refused_starts=indented(_refused_starts(printed)),
        start_tests=indented(_started_at(printed)),
        kept_tests=indented(_resting(printed, "estimates to be kept, and")),
        fresh_tests=indented(_fresh(printed)),
        fade_from=_where_u_is_large(contents),
        fade=FADE,
        started=layout.started.name,
        u=layout.u.name,
        start_argument=f"in.{printed.measured}, " if state else "",
        fixed_start="measured[0], " if state else "",
        other_start="measured[1], " if state else "",
        small=c99.constant(1e-4, contents.real),
        zero=f"0.0{contents.real.suffix}",
    )


def _timer_tests(printed: Printed) -> str:
    """The tests of the timer: without a tolerance band a wrong sample time is only reported; with a band the shell handles it."""
    if printed.contents.around is not None and printed.contents.around.band is not None:
        return ""
    lines = []
    for time in (f"2 * {printed.macro}_SAMPLE_TIME", f"{printed.macro}_SAMPLE_TIME / 2"):
        lines.append(f"in.sample_time = {time};")
        told = f"{printed.name}_step(&c, &in, &out) == {printed.macro}_WRONG_SAMPLE_TIME"
        lines.append(f'require({told}, "another sample time is not flagged");')
    return indented(lines)


def _first_miss(printed: Printed) -> list[str]:
    """The tests of misses between a start and the first good sample: their effects on the held values, the counters and finally
    u."""
    contents, layout, around = printed.contents, printed.contents.layout, printed.contents.around
    counts, step, M = members(around), f"{printed.name}_step(&c, &in, &out)", printed.macro
    missed = [
        f"memcpy(before.{layout.r.name}, in.r, sizeof in.r);",
        f"memcpy(before.{layout.u.name}, u_now, sizeof u_now);",
        *(["before.outage = 1L;"] if "outage" in counts else []),
        *([f"before.age = {'1' if contents.measures_state else MOST_COUNTED}L;"] if "age" in counts else []),
        *(["before.command_outage = 0L;"] if "command_outage" in counts else []),
    ]
    lines = [
        f"require({step} == {M}_MEASUREMENT_LOST && same(out.u, u_now, {M}_INPUTS) && is_limited(&out),",
        '    "a refused first sample does not hold the actuator where it is");',
        *missed,
        'require(same_state(&c, &before), "a miss before the first good sample changes something else");',
    ]
    if around is None or around.longest is None:
        return lines
    act = [
        f"c.outage = {M}_LONGEST_OUTAGE;",
        f"require({step} == ({M}_MEASUREMENT_LOST | {M}_FALLBACK) && c.outage == {M}_LONGEST_OUTAGE + 1L,",
        '    "the fallback does not act before the first good sample");',
        f"{{ {alone_of(printed)}",
        f"  for (i = 0; i < {M}_INPUTS; ++i) {{ u_now[i] = {fallen(printed, 'u_now')}; }}",
        f'  require(same(out.u, u_now, {M}_INPUTS), "the fallback before the first good sample differs"); }}',
        f"in = sample(1); memcpy(in.r, c.{layout.r.name}, sizeof in.r);",
        f'require({step} == {M}_OK && c.outage == 0L, "the first good sample after the fallback is refused");',
        f'require({int(around.fade > 0)} == 0 || close_to(out.u, u_now, {M}_INPUTS), "the first good sample causes a bump");',
    ]
    return [*(lines if around.longest > 0 else []), *act]


def _mirrored(around: Around | None) -> list[str]:
    """The shell's counters at a miss: one more consecutive miss, and no repetition, because the substituted measurement would
    count as one."""
    missed = [f"other.{name} = k - last + 3L;" for name in counted_misses(around) if name != "command_outage"]
    return [*missed, *(f"other.{name} = c.{name};" for name in counters(around))]


def _refused_tests(printed: Printed) -> list[str]:
    """The tests of bad numbers, one after another; two consecutive samples are lost, so the longest outage must be at least 2."""
    around, macro = printed.contents.around, printed.macro
    few = around is not None and around.longest is not None and around.longest < REFUSED_IN_A_ROW
    bad = [] if few else ["nothing / nothing, 0", "1 / nothing, 0", f"-2 * {macro}_RANGE, 0"]
    return [f"test_refused({given});" for given in (*bad, "nothing / nothing, 1", f"2 * {macro}_RANGE, 1")]


REFUSED_IN_A_ROW = 2
"""Number of consecutive rejections in ``test_refused``."""


def with_losses(contents: Contents) -> Array:
    """(K, S) the flat state after each sample of ``LOSSES``, by the list and by the rules in ``controller.h`` for a lost
    sample."""
    u, started = (list(part.rows) for part in (contents.layout.u, contents.layout.started))
    last_y, last_r = (list(part.rows) for part in (contents.layout.measured, contents.layout.r))
    state, states = contents.initial, []
    kept: Any = None if contents.around is None else contents.around.initial(np.zeros(contents.sizes[0]), contents.sizes[2])
    for y, r, loss in zip(contents.vectors.measured, contents.vectors.commands, LOSSES, strict=False):
        lost = bool(loss & MEASUREMENT_LOST)
        command = state[last_r] if loss & COMMAND_LOST else r
        freeze = contents.lost if lost else float(bool(loss & FROZEN))
        after = contents.evaluated(state, state[last_y] if lost else y, command, freeze)
        if contents.around is not None:
            after, kept = surrounded(
                contents, contents.around, (state, after, state[last_y] if lost else y), kept, MISS if lost else GOOD
            )
        elif lost and not state[started] > 0:
            after = state.copy()
            after[last_r] = command
        elif lost:
            after[u] = state[u]
        state = after
        states.append(state)
    return np.array(states)


def _limit_rows(printed: Printed) -> str:
    """The actuator limits for each input; for an input without limits, values that are never reached."""
    contents = printed.contents
    beyond = 4 * contents.range
    limits = contents.saturation
    found = np.full((2, contents.sizes[2]), np.inf) * [[-1.0], [1.0]] if limits is None else limits
    return number_rows(printed, np.clip(found, -beyond, beyond).T)


def _same_state(printed: Printed) -> str:
    tests = [f"same(a->{part.name}, b->{part.name}, {part.size})" for part in printed.contents.layout.parts]
    tests += [f"same(a->{name}, b->{name}, {printed.macro}_INPUTS)" for name in ("last_u", "bump")]
    if printed.contents.parameters:
        tests += [f"same(a->{name}, b->{name}, {printed.macro}_PARAMETERS)" for name in ("parameter", "previous")]
        tests += ["a->change == b->change"]
    tests += [
        f"a->{name} == b->{name}"
        for name in (
            "fade",
            "fade_left",
            "matching",
            "refused",
            *members(printed.contents.around),
            *counters(printed.contents.around),
        )
    ]
    return "\n        && ".join(tests)


def _state_is(printed: Printed, state: Array) -> list[str]:
    """Every stored number equals this one, bit for bit."""
    contents, lines = printed.contents, []
    for part in contents.layout.parts:
        values = ", ".join(c99.constant(state[row], contents.real) for row in part.rows)
        lines.append(f"{{ const {printed.real} expected[{part.size}] = {{ {values} }};")
        lines.append(f'  require(same(c.{part.name}, expected, {part.size}), "the state differs: {part.name}"); }}')
    return lines


def _started_at(printed: Printed) -> list[str]:
    """After a start that keeps nothing, at the measurement of the second vector, every number has the value of the case, up to
    rounding."""
    contents = printed.contents
    counted = dict.fromkeys(("refused", *members(contents.around), *counters(contents.around)), 0)
    counted |= {"age": 0 if contents.measures_state else MOST_COUNTED} if "age" in counted else {}
    counted |= {"command_outage": MOST_COUNTED} if "command_outage" in counted else {}
    lines = [f'require(c.{name} == {count}L, "not started again: {name}");' for name, count in counted.items()]
    rest, of_x = contents.at_start
    there = rest + of_x @ contents.vectors.measured[1]
    for part in contents.layout.parts:
        values = ", ".join(c99.constant(there[row], contents.real) for row in part.rows)
        lines.append(f"{{ const {printed.real} expected[{part.size}] = {{ {values} }};")
        lines.append(
            f'  require(close_to(c.{part.name}, expected, {part.size}), "not started at the given values: {part.name}"); }}'
        )
    return lines


def _refused_starts(printed: Printed) -> list[str]:
    """A start whose last entry is out of range, or not accepted by a range of the shell, is reported, and nothing changes."""
    contents, (y, _, m, _) = printed.contents, printed.contents.sizes
    beyond = f"2 * {printed.macro}_RANGE"
    x, around, number = printed.measured, printed.contents.around, printed.contents.real.numbers
    lines, given = list[str](), [(f"u_start[{m - 1}]", beyond)]
    if contents.measures_state:
        given.append((f"start.{x}[{y - 1}]", beyond))
        ends = [] if around is None else [(i, around.low[i], -np.inf) for i in around.ranged]
        ends += [] if around is None else [(i, around.high[i], np.inf) for i in around.ranged]
        for i, end, far in ends:  # the shell rejects these too
            given.append((f"start.{x}[{i}]", c99.constant(float(np.nextafter(number(end), number(far))), contents.real)))
    for place, value in given:
        start = f"{printed.name}_start(&c, {f'start.{x}, ' if contents.measures_state else ''}u_start, {FADE}L, 0)"
        lines += [
            f"{{ {printed.name}_input start = sample(1); {printed.real} u_start[{printed.macro}_INPUTS];",
            "  memcpy(u_start, u_now, sizeof u_start); (void)start;",
            f"  {place} = {value};",
            f"  require({start} == {printed.macro}_START_REFUSED && same_state(&c, &before),",
            '      "a start out of range is not refused"); }',
        ]
    return lines


def _resting(printed: Printed, when: str) -> list[str]:
    """The learnt values are unchanged."""
    contents, lines = printed.contents, []
    for part in contents.layout.parts:
        for i in (row - part.start for row in part.rows if row in contents.learnt):
            both = f"&c.{part.name}[{i}], &before.{part.name}[{i}]"
            lines.append(f'require(same({both}, 1), "{when} {part.name} moves");')
    return lines


def _fresh(printed: Printed) -> list[str]:
    """If the initial state is a copy of x, a controller that is started again behaves as after a fresh start, whatever its
    history."""
    contents = printed.contents
    _, of_x = contents.at_start
    if not np.isin(of_x, (0.0, 1.0)).all() or (of_x.sum(axis=1) > 1).any():
        return []
    x0 = contents.loop.at_first.reshape(-1)
    values = ", ".join(c99.constant(value, contents.real) for value in x0)
    started = f"(void){printed.name}_start(&c, {'x0, ' if contents.measures_state else ''}controls[0], 0L, 0);"
    given = f"const {printed.real} x0[] = {{ {values} }};" if contents.measures_state else ""
    return [
        f"{{ {given} {started}",
        '  require(replay(&c, SAMPLES) == SAMPLES, "a controller that is enabled again differs from a fresh start"); }',
    ]


def _limits(printed: Printed) -> list[str]:
    """An estimate outside the known set causes the state to be rejected, unless the bound is a parameter."""
    contents = printed.contents
    if contents.limits is None or not contents.sizes[3]:
        return []
    lines = []
    name = contents.layout.theta_hat.name
    are_open = np.zeros_like(contents.limits, dtype=bool) if contents.opened is None else contents.opened.open_limits
    for side, sign, is_open in zip(("LOWER", "UPPER"), ("-", "+"), are_open, strict=True):
        passed = " || ".join(f"i == {i}" for i in np.flatnonzero(is_open))
        if is_open.all():
            continue
        lines += [
            f"{{ const {printed.real} bounds[] = {printed.macro}_THETA_HAT_{side};",
            f"  for (i = 0; i < {printed.macro}_ESTIMATES; ++i) {{",
            *([f"      if ({passed}) {{ continue; }}"] if passed else []),
            f"      {printed.name}_init(&c);",
            f"      c.{name}[i] = bounds[i] {sign} {c99.constant(0.01, contents.real)} * (1 + bounds[i] * bounds[i]);",
            f"      require({printed.name}_step(&c, &in, &out) == {printed.macro}_STATE_REFUSED,",
            '          "an estimate outside the known set is not refused");',
            "  } }",
        ]
    return lines


_STANDSTILL = """
/* A lost sample that would lead out of range, with every number of the state at the end of its range: nothing moves. */
static void test_standstill(void)
{{
    {name}_controller c, before;
    {name}_input in = sample(0);
    {name}_output out;
    int i;
    {name}_init(&c);
    (void)replay(&c, 2);
{poked}    before = c;
    in.{measured}[0] = 2 * {macro}_RANGE;
    in.r[0] = 2 * {macro}_RANGE;
    require({name}_step(&c, &in, &out) == ({macro}_MEASUREMENT_LOST | {macro}_COMMAND_LOST | {refused_status}),
        "a standstill is not reported");
{refused_misses}    require({begins_again}(same_state(&c, &before) && same(out.u, before.last_u, {macro}_INPUTS)),
        "a step out of range is not omitted");
}}
"""


def _standstill(printed: Printed) -> str:
    """C test: a lost sample that would push a number past the end of its range is reported, and nothing changes. Such a sample
    exists for most controllers."""
    contents, layout = printed.contents, printed.contents.layout
    poked = [part for part in layout.parts if part not in (layout.theta_hat, layout.started, *checked_values(contents))]
    state = contents.vectors.states[1].copy()
    for part in poked:
        state[part.rows] = contents.range
    after = contents.evaluated(state, state[layout.measured.rows], state[layout.r.rows], contents.lost)
    after[layout.u.rows] = 0.0  # which does not change
    if not (np.abs(after) > contents.range).any():
        return ""
    lines = [f"for (i = 0; i < {part.size}; ++i) {{ c.{part.name}[i] = {printed.macro}_RANGE; }}" for part in poked]
    names = {"name": printed.name, "macro": printed.macro, "measured": printed.measured, **_after_a_refusal(printed)}
    return _STANDSTILL.format(**names, poked=indented(lines))


def _after_a_refusal(printed: Printed) -> dict[str, str]:
    """The test of a first sample whose result is out of range; it may be a miss, even one beyond the longest outage."""
    around, status = printed.contents.around, f"{printed.macro}_RESULT_REFUSED"
    longest = None if around is None else around.longest
    return {
        "refused_status": f"({status} | {printed.macro}_FALLBACK)" if longest == 0 else status,
        "refused_misses": indented(f"before.{name} = 1L;" for name in counted_misses(around)),
        "counted": indented(["before.refused = 1;"]),
        "begins_again": "c.outage == 1L || " if longest == 0 else "",
    }


def _where_u_is_large(contents: Contents) -> int:
    """A sample at which no input is near zero, if there is one; it is neither the first nor among the last samples."""
    u = np.abs(contents.vectors.states[:, list(contents.layout.u.rows)]).min(axis=1)
    return 1 + int(np.argmax(u[1 : len(u) - FADE - 1]))


assert FEWEST_VECTORS >= FADE + 4
