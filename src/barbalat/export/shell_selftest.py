"""The self-test of the shell of a case: which samples are accepted, the end of an outage, the return, and the timer."""

from __future__ import annotations

import numpy as np

from barbalat.export.shell import CLOCK_TOLERANCE, baseline_terms, roundings
from barbalat.export.texts import Printed, indented
from barbalat.loop.around import MOST_COUNTED
from barbalat.lowering import c99
from barbalat.validate import Array

BEYOND_RATE = 1.5
"""Multiple of the allowed change per sample that is rejected at first and accepted after one miss."""

MOST_MADE_UP = 10_000
"""Largest number of missed calls for which the test checks the longest time between two calls, because it makes these calls and
float32 must resolve them."""


def shell_tests(printed: Printed) -> str:
    """The text of ``test_shell``; empty without a shell."""
    around = printed.contents.around
    if around is None:
        return ""
    tests = [*_ranges(printed), *_rates(printed), *_stuck(printed), *(_OUTAGE if around.longest is not None else [])]
    if around.band is not None:
        tests += [
            *_TIMER,
            *(_BEYOND_BAND if leaves_gaps(printed) else []),
            *(_ages("{x}", "MEASUREMENT_LOST", "age", "measurement") if around.rated else []),
            *(_ages("r", "COMMAND_LOST", "command_outage", "command") if around.command_rated else []),
            *(_LONGEST_TIME if (around.longest or 0) <= MOST_MADE_UP else []),
        ]
    if around.longest is not None and around.longest > 0:
        tests += _SHORTER
    return _WHOLE.format(
        name=printed.name, macro=printed.macro, real=printed.real, x=printed.measured, tests=indented(_filled(printed, tests))
    )


ROUNDINGS_BEYOND = 16
"""Distance from the edge of the band, as a multiple of the rounding errors that the edge allows, beyond which a time is certainly
outside."""


def leaves_gaps(printed: Printed) -> bool:
    """Whether there certainly are times between the bands of two successive multiples of the sample time."""
    around = printed.contents.around
    assert around is not None and around.band is not None
    return ROUNDINGS_BEYOND * roundings(printed) * around.T < (around.T / 2 - around.band) / 2


def wrong_time(printed: Printed, whole: int) -> tuple[float, int]:
    """A time in sample times that is outside every band, and the number of samples that have begun in it: halfway between two
    multiples, the ``whole`` one and the next. If their bands leave no gap, the time is less than half a sample time."""
    return (whole + 0.5, whole + 1) if leaves_gaps(printed) else (0.25, 1)


def _filled(printed: Printed, lines: list[str]) -> list[str]:
    around = printed.contents.around
    assert around is not None
    band = 0.0 if around.band is None else around.band
    off, (late, reported) = _off(band, around.T), jitter(printed)
    several, number = (around.longest or 0) >= 2, printed.contents.real.numbers
    half, begun = (1.5, 2) if around.band is None else wrong_time(printed, 1)
    calls = "{M}_MISSED_CALLS" if several else "({M}_WRONG_SAMPLE_TIME | {M}_FALLBACK)"
    names = {
        "n": printed.name, "M": printed.macro, "real": printed.real, "x": printed.measured, "fallen": fallen(printed, "last"),
        "alone": alone_of(printed),
        "jitter": late, "jittered": reported,
        "edge": printed.number(float(np.nextafter(number(around.T + band), number(1e9)))),
        "half": printed.number(half * around.T), "begun": begun, "three": printed.number(3 * around.T + off),
        "beyond": printed.number(around.T + band + min(0.1 * band, (around.T / 2 - band) / 2)),
        "just_beyond": printed.number(around.T + band + ROUNDINGS_BEYOND * roundings(printed) * around.T),
        "held": printed.contents.layout.measured.name, "most": MOST_COUNTED, "suffix": printed.contents.real.suffix,
        "several": int(several), "lost": f"{printed.contents.lost:g}", "close": int(around.fade > 0),
    }  # fmt: skip
    return [line.replace("{calls}", calls).format(**names) for line in lines]


def _off(band: float, T: float) -> float:
    return 0.9 * band if 0.9 * band > 1.05 * CLOCK_TOLERANCE * T else band / 2


def jitter(printed: Printed) -> tuple[str, str]:
    """A late time between two calls, within the band if there is one, and its status."""
    around = printed.contents.around
    if around is None or around.band is None:
        return f"2 * {printed.macro}_SAMPLE_TIME", f"{printed.macro}_WRONG_SAMPLE_TIME"
    off = _off(around.band, around.T)
    return printed.number(around.T + off), f"{printed.macro}_{'JITTER' if off > CLOCK_TOLERANCE * around.T else 'OK'}"


def fallen(printed: Printed, last: str) -> str:
    """The first control of the fallback for an input, from the array ``last`` and, for the baseline, ``alone``."""
    around = printed.contents.around
    assert around is not None
    found = {"hold": f"{last}[i]", "zero": f"0.0{printed.contents.real.suffix}"}
    one = f"1.0{printed.contents.real.suffix}"
    left = f"{one} - {one} / ({printed.real}){printed.macro}_FADE"
    within = f"({last}[i] < limits[i][0] ? limits[i][0] : {last}[i] > limits[i][1] ? limits[i][1] : {last}[i])"
    found["baseline"] = f"alone[i] + ({within} - alone[i]) * {int(around.fade > 0)}"
    found["fade"] = f"{within} * ({left})" if around.fade else found["zero"]
    return found[around.fallback]


def alone_of(printed: Printed) -> str:
    """The output of the baseline, if it is the fallback."""
    terms = baseline_terms(printed, "c.")
    return f"const {printed.real} alone[] = {{ {', '.join(terms)} }};" if terms else ""


def checked_inputs(printed: Printed) -> list[tuple[str, str, Array, tuple[tuple[int, ...], ...], tuple[Array, ...]]]:
    """For measurements and for commands: the input member, the status, the samples of the simulation, the positions with a range
    and with a rate, and the limits."""
    around, vectors, x = printed.contents.around, printed.contents.vectors, printed.measured
    assert around is not None
    of_commands = around.command_low, around.command_high, around.command_rate
    return [
        (x, "MEASUREMENT_LOST", vectors.measured, (around.ranged, around.rated), (around.low, around.high, around.rate)),
        ("r", "COMMAND_LOST", vectors.commands, (around.command_ranged, around.command_rated), of_commands),
    ]


def _ranges(printed: Printed) -> list[str]:
    """The tests of ranges: the ends are accepted, and the next numbers beyond them are rejected."""
    lines, number = list[str](), printed.contents.real.numbers
    for member, lost, _, (ranged, _), (lows, highs, _) in checked_inputs(printed):
        for i in ranged:
            for end, far in ((lows[i], -np.inf), (highs[i], np.inf)):
                beyond = c99.constant(float(np.nextafter(number(end), number(far))), printed.contents.real)
                for value, status in ((printed.number(end), "OK"), (beyond, lost)):
                    lines.append(f"{{n}}_init(&c); in = sample(0); in.{member}[{i}] = {value};")
                    lines.append(f'require({{n}}_step(&c, &in, &out) == {{M}}_{status}, "a range differs: {member}[{i}]");')
    return lines


def _rates(printed: Printed) -> list[str]:
    """The tests of rates: a change beyond the rate is rejected and accepted a sample later, when enough time has passed; the same
    change back is rejected, because the gap has ended."""
    lines, step = list[str](), "{n}_step(&c, &in, &out)"
    for member, lost, samples, (_, rated), (lows, highs, rates) in checked_inputs(printed):
        for i in rated:
            for value in (samples[1, i] + sign * BEYOND_RATE * rates[i] for sign in (-1, 1)):
                if not (lows[i] <= value <= highs[i] and abs(value) < printed.contents.range):
                    continue
                lines += ["{n}_init(&c); (void)replay(&c, 2); in = sample(1);", f"in.{member}[{i}] = {printed.number(value)};"]
                lines += [f'require(({step} & {{M}}_{lost}) != 0u, "a rate is not checked: {member}[{i}]");']
                lines += [f'require({step} == {{M}}_OK, "a rate does not grow with the gap: {member}[{i}]");']
                lines += [f"in.{member}[{i}] = {printed.number(samples[1, i])};"]
                lines += [f'require(({step} & {{M}}_{lost}) != 0u, "the end of a gap is ignored: {member}[{i}]");']
    return lines


def _stuck(printed: Printed) -> list[str]:
    """A repeated measurement is accepted as often as the channel may repeat its value, and not more often."""
    around, lines = printed.contents.around, []
    assert around is not None
    for place, (_, most) in enumerate(around.repeats):
        lines.append("{n}_init(&c); (void)replay(&c, 2); in = sample(1);")
        if most:
            told = f"{{n}}_step(&c, &in, &out) == {{M}}_OK && c.repeats[{place}] == {most}L"
            lines += [f"c.repeats[{place}] = {most - 1}L;", f'require({told}, "a repeat is refused");']
        lines.append('require(({n}_step(&c, &in, &out) & {M}_MEASUREMENT_LOST) != 0u, "a stuck channel is accepted");')
    return lines


def _ages(member: str, lost: str, count: str, what: str) -> list[str]:
    """The tests of the age of the last good measurement or command: at wrong times, after a long time, and sample by sample."""
    return [
        f"{{n}}_init(&c); (void)replay(&c, 4); in = sample(4); in.{member}[0] = nothing / nothing; in.sample_time = {{half}};",
        f"require({{n}}_step(&c, &in, &out) == ({{M}}_WRONG_SAMPLE_TIME | {{M}}_{lost} | {{M}}_FALLBACK)",
        f'        && c.{count} == {{begun}}L, "the age of the last good {what} differs");',
        f"in.sample_time = ({{real}})1000000 * {{M}}_SAMPLE_TIME; (void){{n}}_step(&c, &in, &out); k = c.{count} - {{begun}}L;",
        f'require(k >= 1000000L && k <= 1000001L, "the age of a {what} after a long time differs");',
        "in.sample_time = 0; (void){n}_step(&c, &in, &out);",
        f'require(c.{count} == k + {{begun}}L + 1L, "the age of a {what} after a time of zero differs");',
        "in.sample_time = 1e12{suffix} * {M}_SAMPLE_TIME; (void){n}_step(&c, &in, &out);",
        f'require(c.{count} == {{most}}L, "the age of a {what} is counted too far");',
        f"c.{count} = 5L; in.sample_time = {{M}}_SAMPLE_TIME; (void){{n}}_step(&c, &in, &out);",
        f'require(c.{count} == 6L, "the age of the last good {what} is not counted");',
    ]


_WHOLE = """
/* The shell of the case: accepted samples, the fallback, the time between calls. */
static void test_shell(void)
{{
    {name}_controller c, other;
    {name}_input in, none;
    {name}_output out, expected;
    {real} last[{macro}_INPUTS];
    const {real} nothing = 0;
    long k = 0L;
    int i;
    none = sample(0);
    none.sample_time = {macro}_SAMPLE_TIME;
    for (i = 0; i < {macro}_MEASURED; ++i) {{ none.{x}[i] = nothing / nothing; }}
    for (i = 0; i < {macro}_COMMANDS; ++i) {{ none.r[i] = nothing / nothing; }}
    (void)k; (void)none; (void)other; (void)expected; (void)last; (void)in; (void)c; (void)out;
{tests}}}
"""
_SHORTER = [
    "{n}_init(&c); (void)replay(&c, 4); in = sample(4);",
    "memcpy(last, c.last_u, sizeof last);",
    "c.outage = {M}_LONGEST_OUTAGE - 1L;",
    "in.{x}[0] = nothing / nothing;",
    'require({n}_step(&c, &in, &out) == {M}_MEASUREMENT_LOST && same(out.u, last, {M}_INPUTS), "an outage ends too early");',
]
_BEYOND = "for (i = 0; i < {M}_INPUTS; ++i) {{ c.last_u[i] = limits[i][1] <= {M}_RANGE ? limits[i][1] + 1 : c.last_u[i]; }}"
_OUTAGE = [
    "{n}_init(&c); (void)replay(&c, 4); in = sample(4);",
    _BEYOND,
    "memcpy(last, c.last_u, sizeof last);",
    "c.outage = {M}_LONGEST_OUTAGE;",
    "in.{x}[0] = nothing / nothing;",
    'require({n}_step(&c, &in, &out) == ({M}_MEASUREMENT_LOST | {M}_FALLBACK), "the fallback does not act, or is not reported");',
    "{alone}",
    "for (i = 0; i < {M}_INPUTS; ++i) {{ last[i] = {fallen}; }}",
    'require(same(out.u, last, {M}_INPUTS) && is_limited(&out), "the fallback differs");',
    _BEYOND,
    "memcpy(last, c.last_u, sizeof last);",
    "in = sample(4);",
    'require({n}_step(&c, &in, &out) == {M}_OK && c.outage == 0L, "the controller does not return from an outage");',
    "for (i = 0; i < {M}_INPUTS; ++i) {{",
    "    last[i] = last[i] < limits[i][0] ? limits[i][0] : last[i] > limits[i][1] ? limits[i][1] : last[i];",
    "}}",
    "require({close} == 0 || (close_to(out.u, last, {M}_INPUTS) && c.fade_left == {M}_FADE - 1L),",
    '    "a return causes a bump");',
]
_TIMER = [
    "{n}_init(&c); (void)replay(&c, 4); other = c; in = sample(4); in.sample_time = {jitter};",
    'require({n}_step(&c, &in, &out) == {jittered}, "a time within the band is not reported");',
    "in.sample_time = {M}_SAMPLE_TIME;",
    "(void){n}_step(&other, &in, &expected);",
    'require(same_state(&c, &other), "a time within the band is not treated as nominal");',
    "in.sample_time = {edge};",
    'require({n}_step(&c, &in, &out) == {M}_JITTER, "the edge of the band is outside of it");',
    "in.sample_time = {half};",
    'require({n}_step(&c, &in, &out) == ({M}_WRONG_SAMPLE_TIME | {M}_FALLBACK), "the fallback does not act at a wrong time");',
    "{n}_init(&c); (void)replay(&c, 4); in = sample(4); in.sample_time = {half}; (void){n}_step(&c, &in, &out);",
    'require(same(c.{held}, in.{x}, {M}_MEASURED), "a good measurement at a wrong time is not held");',
    "{n}_init(&other); (void)replay(&other, 4); in.freeze = {lost}; (void){n}_step(&other, &in, &expected);",
    'require(same_state(&c, &other), "the law learns at a wrong time");',
    "{n}_init(&c); (void)replay(&c, 4); in = sample(4); in.sample_time = 0;",
    'require({n}_step(&c, &in, &out) == ({M}_WRONG_SAMPLE_TIME | {M}_FALLBACK), "a time of zero between two calls is accepted");',
    "{n}_init(&c); (void)replay(&c, 4); other = c; in = sample(4); in.sample_time = {three};",
    'require({n}_step(&c, &in, &out) == {calls}, "missed calls are not reported");',
    "in.sample_time = {M}_SAMPLE_TIME;",
    "(void){n}_step(&other, &none, &expected); (void){n}_step(&other, &none, &expected); (void){n}_step(&other, &in, &expected);",
    'require({several} == 0 || same_state(&c, &other), "missed calls do not count as misses");',
]
_BEYOND_BAND = [
    "{n}_init(&c); (void)replay(&c, 4); in = sample(4); in.sample_time = {beyond};",
    'require({n}_step(&c, &in, &out) == ({M}_WRONG_SAMPLE_TIME | {M}_FALLBACK), "a time beyond the band is accepted");',
    "{n}_init(&c); (void)replay(&c, 4); in = sample(4); in.sample_time = {just_beyond};",
    'require({n}_step(&c, &in, &out) == ({M}_WRONG_SAMPLE_TIME | {M}_FALLBACK), "a time just beyond the band is accepted");',
]
_LONGEST_TIME = [
    "{n}_init(&c); (void)replay(&c, 4); other = c; in = sample(4);",
    "in.sample_time = ({real})({M}_LONGEST_OUTAGE + 1L) * {M}_SAMPLE_TIME;",
    "require({several} == 0 || ({n}_step(&c, &in, &out) & ({M}_MISSED_CALLS | {M}_WRONG_SAMPLE_TIME)) == {M}_MISSED_CALLS,",
    '    "missed calls up to the longest outage are not processed");',
    "in.sample_time = ({real})({M}_LONGEST_OUTAGE + 2L) * {M}_SAMPLE_TIME;",
    "require({n}_step(&other, &in, &out) == ({M}_WRONG_SAMPLE_TIME | {M}_FALLBACK),",
    '    "more missed calls than the longest outage are processed");',
]
