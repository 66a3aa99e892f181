"""The self-test of a shell with a longest outage: outages with the fallback, its whole fade, and the return."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.export.contents import Contents
from barbalat.export.evidence import digests_of
from barbalat.export.shell import counters
from barbalat.export.shell_selftest import wrong_time
from barbalat.export.texts import Printed, indented
from barbalat.loop.around import Around, Kept, Taken
from barbalat.loop.packing import flatten, map_arrays, unflatten
from barbalat.lowering import c99
from barbalat.run.kernel.sampled_controller import initial_acting
from barbalat.validate import Array

GOOD, MISS, WRONG = 0, 1, 2
"""A good sample, a lost one, and a good one at a wrong time."""
STAYS = -1
"""The value for a count that a step of the script does not set."""
OTHER_FADE = 5
"""Number of samples by which the length of an earlier fade, due to a start or a changed parameter, differs from that of the
shell."""


def outage_tests(printed: Printed) -> str:
    """The text of ``test_outages``; empty without a longest outage."""
    contents = printed.contents
    around = contents.around
    if around is None or around.longest is None:
        return ""
    script = list(_script(around))
    time, begun = (0.0, 1) if around.band is None else wrong_time(printed, 2)
    rows, outages = _run(contents, around, script, begun)
    steps = [
        (kind, at, outage, left, after)
        for (kind, outage, left), at, after in zip(script, _places(contents, script), outages, strict=True)
    ]
    repeats = counters(around)
    timed = ["advanced", "fade", *(["paused"] if around.baseline is not None else [])] if around.band is not None else []
    own = [f"c.{name}" for name in ("outage", "fade_left", *repeats, *(["age"] if around.rated else []), *timed)]
    return _WHOLE.format(
        name=printed.name,
        macro=printed.macro,
        real=printed.real,
        x=printed.measured,
        script=indented(f"{{ {', '.join(f'{one}L' for one in step)} }}," for step in steps),
        digests=digests_of(printed, rows),
        counts=", ".join(f"({printed.real}){text}" for text in own),
        number=len(own),
        other=OTHER_FADE,
        wrong=c99.constant(time, contents.real),
    )


def _script(around: Around) -> Iterator[tuple[int, int, int]]:
    """For each sample whether it is good, and the outage and the remaining fade that are set before it, so that long ones are
    shortened."""
    assert around.longest is not None
    longest, fade = int(around.longest), int(around.fade)
    yield GOOD, STAYS, STAYS
    yield GOOD, STAYS, STAYS
    for _ in range(2):  # the second outage begins with the state after the first
        if longest > 1:
            yield MISS, longest - 2, STAYS
        for _ in range(4):  # the last tolerated miss, and three beyond
            yield MISS, STAYS, STAYS
        if around.baseline is not None and fade:
            yield MISS, STAYS, 1
        yield MISS, longest + max(fade - 1, 3), STAYS
        yield MISS, STAYS, STAYS
        yield MISS, STAYS, 0
        yield GOOD, STAYS, STAYS
        if longest:  # if no more samples are missed than are tolerated, there is no return
            yield MISS, longest - 1, STAYS
            yield GOOD, STAYS, STAYS
            yield MISS, STAYS, STAYS
        yield GOOD, STAYS, STAYS
        yield GOOD, STAYS, min(fade, 1)
    if around.band is not None:
        for kinds in ((WRONG, GOOD), (WRONG, GOOD, GOOD), (WRONG, WRONG, GOOD), (MISS, WRONG, MISS, GOOD), (WRONG, MISS, GOOD)):
            for kind in (*kinds, *kinds):
                yield kind, STAYS, STAYS
        yield GOOD, STAYS, 0
        yield GOOD, STAYS, min(fade, 3)
        yield WRONG, STAYS, STAYS
        yield GOOD, STAYS, STAYS


def _places(contents: Contents, script: list[tuple[int, int, int]]) -> list[int]:
    """The sample of the simulation for each step: successive samples or, if there are few, a new sample only at good samples."""
    steps = [1] * len(script) if len(script) <= len(contents.vectors.states) else [int(kind == GOOD) for kind, _, _ in script]
    return [int(one) - 1 for one in np.cumsum(steps)]


def _run(contents: Contents, around: Around, script: list[tuple[int, int, int]], begun: int) -> tuple[Array, list[int]]:
    """(K, n) the kept values after each step, computed by the list and the simulation's shell, and the outages; by the time of a
    wrong call, this number of samples has ``begun``."""
    layout, state, rows, outages = contents.layout, contents.initial, [], []
    kept: Kept = around.initial(np.zeros(contents.sizes[0]), contents.sizes[2])
    last_y = list(layout.measured.rows)
    for (kind, outage, left), at in zip(script, _places(contents, script), strict=True):
        kept = kept if outage == STAYS else kept._replace(outage=np.array([float(outage)]))
        if left != STAYS:
            whole = kept.fade if left else np.full(len(kept.fade), around.fade + OTHER_FADE)
            kept = kept._replace(fade_left=np.array([float(left)]), fade=whole)
        y = state[last_y] if kind == MISS else contents.vectors.measured[at]
        after = contents.evaluated(state, y, contents.vectors.commands[at], 0.0 if kind == GOOD else contents.lost)
        state, kept = surrounded(contents, around, (state, after, y), kept, kind, begun if kind == WRONG else 1)
        u, more = state[list(layout.u.rows)], (*kept.repeats, *kept.age, *kept.advanced, *kept.fade, *kept.paused)
        rows.append([*state[layout.rows], *u, *kept.bump, *kept.outage, *kept.fade_left, *more])
        outages.append(int(kept.outage[0]))
    return np.array(rows, dtype=float), outages


def surrounded(
    contents: Contents, around: Around, flat: tuple[Array, Array, Array], kept: Any, kind: int, elapsed: int = 1
) -> tuple[Array, Any]:
    """The shell's transition for a sample with a measurement, from one flat state to the next, and the values that the shell
    keeps; ``elapsed`` samples have begun since the last call."""
    numbers, template = contents.real.numbers, initial_acting(contents.loop)
    if (fixed := around.baseline) is not None:  # a gain in 64 bits would make the product one of 64 bits
        around = replace(around, baseline=replace(fixed, K=fixed.K.astype(numbers), k_r=fixed.k_r.astype(numbers)))
    around = replace(around, u_low=around.u_low.astype(numbers), u_high=around.u_high.astype(numbers))
    before, now = (unflatten(template, state.astype(numbers), 0)[0] for state in flat[:2])
    before = before._replace(held=before.held._replace(around=map_arrays(lambda part: part.astype(numbers), kept)))
    zero, one = np.zeros((), numbers), np.ones((), numbers)
    rest: Any = {name: getattr(kept, name) for name in ("offered", "lost", "late", "command_outage", "commanded", "timer")}
    begun = one if before.held.started > 0 or kind == GOOD else zero
    wrong = one if kind == WRONG else zero
    taken = Taken(
        y=flat[2].astype(numbers), r=now.held.r, freeze=zero if kind == GOOD else one, begun=begun,
        fresh=zero if kind == MISS else one, elapsed=elapsed * one, due=one, wrong_time=wrong, **rest,
    )  # fmt: skip
    with np.errstate(divide="ignore", invalid="ignore"):  # for unselected entries
        acted = around.put_out(taken, before, now)
    return np.asarray(flatten(acted._replace(held=acted.held._replace(around=()))), dtype=float), acted.held.around


_WHOLE = """
/* Two outages, each with its fallback and a return (the long middle parts of both fades are left out), and calls at wrong times,
 * if they are checked: for each sample whether it is good (0), lost (1) or at a wrong time (2), which of the simulation's it is,
 * the outage and the rest of a fade that are set before it (-1: none), and the outage afterwards. */
static const long outages[][5] = {{
{script}}};
static const uint64_t outage_digests[] = {{
    {digests} }};

static void test_outages(void)
{{
    {name}_controller c;
    {name}_input in;
    {name}_output out;
    const unsigned statuses[] = {{ {macro}_OK, {macro}_MEASUREMENT_LOST, {macro}_WRONG_SAMPLE_TIME }};
    const {real} nothing = 0;
    int k;
    {name}_init(&c);
    for (k = 0; k < (int)(sizeof outages / sizeof *outages); ++k) {{
        const unsigned told = outages[k][4] > {macro}_LONGEST_OUTAGE ? {macro}_FALLBACK : {macro}_OK;
        in = sample((int)outages[k][1]);
        if (outages[k][0] == 1L) {{
            in.{x}[{macro}_MEASURED - 1] = nothing / nothing;
        }} else if (outages[k][0] == 2L) {{
            in.sample_time = {wrong} * {macro}_SAMPLE_TIME;
        }}
        c.outage = outages[k][2] >= 0L ? outages[k][2] : c.outage;
        if (outages[k][3] >= 0L) {{ /* a fade of another length has ended, or the end of this one is near */
            c.fade = outages[k][3] > 0L ? c.fade : {macro}_FADE + {other}L;
            c.fade_left = outages[k][3];
        }}
        require({name}_step(&c, &in, &out) == (statuses[outages[k][0]] | told),
            "a sample of an outage has another status");
        {{
            const {real} counts[] = {{ {counts} }};
            const uint64_t found = mixed(mixed(digest_of(&c), c.last_u, {macro}_INPUTS), c.bump, {macro}_INPUTS);
            require(mixed(found, counts, {number}) == outage_digests[k] && c.matching == 0, "an outage differs");
        }}
        require(same(out.u, c.last_u, {macro}_INPUTS) && is_limited(&out), "the output differs during an outage");
    }}
}}
"""
