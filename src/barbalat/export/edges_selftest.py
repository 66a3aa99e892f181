"""The self-test at the edges of what an export accepts: for every limit, the last number within it and the next one beyond."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from barbalat.export.log import logged
from barbalat.export.shell import CLOCK_TOLERANCE
from barbalat.export.shell_selftest import checked_inputs
from barbalat.export.source import estimate_ends
from barbalat.export.texts import Printed, indented


def edges_tests(printed: Printed) -> str:
    """The text of ``test_edges``."""
    given = {"n": printed.name, "M": printed.macro, "x": printed.measured}
    given["y"] = f"in.{printed.measured}, " if printed.contents.measures_state else ""
    lines = [*_rates(printed), *_controls(printed), *_starts(printed), *_estimates(printed), *_numbers(printed), *_clock(printed)]
    filled = indented(line.format(**given) for line in lines)
    return _WHOLE.format(name=printed.name, macro=printed.macro, real=printed.real, tests=filled)


def _beyond(printed: Printed, end: Any, towards: float) -> Any:
    """The next number in this direction. Next to zero it is the smallest normal number, because a computer may treat smaller ones
    as zero."""
    numbers = printed.contents.real.numbers
    return numbers(np.copysign(np.finfo(numbers).tiny, towards)) if end == 0 else np.nextafter(end, numbers(towards))


def _rates(printed: Printed) -> Iterator[str]:
    """The largest change that a rate allows is accepted and the next one rejected, in both directions, after one sample and
    after two."""
    contents = printed.contents
    numbers, around = contents.real.numbers, contents.around
    if around is None:
        return
    of_input = (contents.layout.measured, "age"), (contents.layout.r, "command_outage")
    for (member, lost, _, (_, rated), (lows, highs, rates)), (last, count) in zip(checked_inputs(printed), of_input, strict=True):
        for i in rated:
            ends = numbers(max(lows[i], -contents.range)), numbers(min(highs[i], contents.range))
            for sign, samples in ((-1, 1), (1, 1), (-1, 2), (1, 2)):
                before, most, beyond = _change(ends, numbers(rates[i]) * numbers(samples), sign)
                for value, told in ((most, "0u"), (beyond, f"{{M}}_{lost}")):
                    if value is None or value == before:
                        continue
                    yield f"{{n}}_init(&c); (void)replay(&c, 2); in = sample(2); c.{count} = {samples - 1}L;"
                    yield f"c.{last.name}[{i}] = {printed.number(float(before))};"
                    yield f"in.{member}[{i}] = {printed.number(float(value))};"
                    yield f"told = {{n}}_step(&c, &in, &out) & ({{M}}_{lost} | {{M}}_STATE_REFUSED);"
                    yield f'require(told == {told}, "the edge of a rate differs: {member}[{i}]");'


def _change(ends: tuple[Any, Any], most: Any, sign: int) -> tuple[Any, Any, Any]:
    """Three values: a last value, the value farthest from it in this direction whose rounded difference is at most ``most``, and
    the next value beyond. The third is None if the second is at the end of the range."""
    end, numbers = ends[sign > 0], type(most)
    last = numbers(0) if ends[0] <= 0 <= ends[1] and most <= abs(end) else ends[sign < 0]
    value = last + sign * most
    far = numbers(sign * np.inf)
    while sign * (value - last) > most:
        value = np.nextafter(value, -far)
    while sign * (np.nextafter(value, far) - last) <= most:
        value = np.nextafter(value, far)
    return (last, value, np.nextafter(value, far)) if sign * value < sign * end else (last, end, None)


def _controls(printed: Printed) -> Iterator[str]:
    """A held control, and the control of a start, are limited as soon as they exceed the actuator's limits, and not before."""
    contents = printed.contents
    numbers, logs = contents.real.numbers, {one.text: f"&log.{one.name}" for one in logged(printed)}
    for i, side in printed.limits():
        assert contents.saturation is not None
        end, sign = numbers(contents.saturation[side, i]), (-np.inf, np.inf)[side]
        for value, limited in ((_beyond(printed, end, -sign), None), (end, end), (_beyond(printed, end, sign), end)):
            if abs(value) > contents.range:
                continue
            u, expected = (printed.number(float(value if one is None else one)) for one in (value, limited))
            yield f"{{n}}_init(&c); (void)replay(&c, 2); in = sample(2); c.last_u[{i}] = expected = {u};"
            yield f"{{n}}_read_log(&c, &log); limited = {expected};"
            both = logs[f"out.u[{i}]"], logs[f"out.u_limited[{i}]"]
            yield f"require(same({both[0]}, &expected, 1) && same({both[1]}, &limited, 1),"
            yield f'    "the edge of a limit differs: u_limited[{i}]");'
            yield f"memcpy(u, controls[2], sizeof u); u[{i}] = {u};"
            yield "require({n}_start(&c, {y}u, 1L, 1) == {M}_OK"
            yield f"        && same(&c.last_u[{i}], &limited, 1) && same(&c.bump[{i}], &limited, 1),"
            yield f'    "the edge of a limit differs for the control of a start: u_now[{i}]");'


def _starts(printed: Printed) -> Iterator[str]:
    """A start is accepted at both ends of each measurement's range."""
    contents, around = printed.contents, printed.contents.around
    for i in () if around is None or not contents.measures_state else around.ranged:
        for end in (around.low[i], around.high[i]):  # type: ignore[union-attr]
            if abs(end) <= contents.range:
                yield f"{{n}}_init(&c); in = sample(0); in.{{x}}[{i}] = {printed.number(end)};"
                yield "require({n}_start(&c, {y}controls[0], 0L, 0) == {M}_OK,"
                yield f'    "a start at the end of a range is refused: {{x}}[{i}]");'


def _estimates(printed: Printed) -> Iterator[str]:
    """An estimate at the end of its checked set is accepted, and the next number beyond it is not."""
    contents = printed.contents
    numbers, name = contents.real.numbers, contents.layout.theta_hat.name
    for i, ends in enumerate(estimate_ends(contents)):
        for end, sign in zip(ends, (-np.inf, np.inf), strict=True):
            for value, bad in ((numbers(end), 0), (_beyond(printed, numbers(end), sign), 1)):
                if abs(end) < contents.range:
                    yield from _state(printed, f"{name}[{i}]", float(value), bad)


def _numbers(printed: Printed) -> Iterator[str]:
    """A number of the state at the end of the range is accepted, and the next number beyond it is not."""
    numbers = printed.contents.real.numbers
    for sign in (-np.inf, np.inf):
        end = numbers(np.copysign(printed.contents.range, sign))
        for value, bad in ((end, 0), (_beyond(printed, end, sign), 1)):
            yield from _state(printed, "bump[0]", float(value), bad)


def _state(printed: Printed, member: str, value: float, bad: int) -> Iterator[str]:
    yield f"{{n}}_init(&c); (void)replay(&c, 2); in = sample(2); c.{member} = {printed.number(value)};"
    yield "told = {n}_step(&c, &in, &out) & {M}_STATE_REFUSED;"
    yield f'require((told != 0u) == {bad}, "the edge of a number of the state differs: {member}");'


def _clock(printed: Printed) -> Iterator[str]:
    """The times between two calls at the edge of a clock's accuracy, and the next ones beyond."""
    contents = printed.contents
    numbers, T, around = contents.real.numbers, contents.sample_time, contents.around
    status = "WRONG_SAMPLE_TIME" if around is None or around.band is None else "JITTER"
    for sign in (-1, 1):
        end = numbers(T) + numbers(sign * CLOCK_TOLERANCE * T)
        for time, told in ((end, "OK"), (_beyond(printed, end, sign * np.inf), status)):
            yield f"{{n}}_init(&c); (void)replay(&c, 2); in = sample(2); in.sample_time = {printed.number(float(time))};"
            yield f'require({{n}}_step(&c, &in, &out) == {{M}}_{told}, "the edge of the clock\'s accuracy differs");'


_WHOLE = """
/* The last number within each limit, and the next one beyond it. */
static void test_edges(void)
{{
    {name}_controller c;
    {name}_input in;
    {name}_output out;
    {name}_log log;
    {real} u[{macro}_INPUTS], expected, limited;
    unsigned told;
    (void)u; (void)expected; (void)limited; (void)log; (void)out;
{tests}}}
"""
