"""What the self-test of a shell with a longest outage looks at: outages with their fallback, its whole fade, and the return."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from barbalat.export.contents import Contents
from barbalat.export.evidence import digests_of
from barbalat.export.shell import counters
from barbalat.export.shell_selftest import alone_of, fallen
from barbalat.export.texts import Printed, indented
from barbalat.loop.around import Around, Kept, Taken
from barbalat.loop.packing import flatten, map_arrays, unflatten
from barbalat.run.kernel.sampled_controller import initial_acting
from barbalat.validate import Array

GOOD, MISS = 0, 1
STAYS = -1
"""In place of a count that a step of the script does not set."""
OTHER_FADE = 5
"""Samples by which the length of an earlier fade differs from the shell's, as after a start or a parameter that was set."""


def outage_tests(printed: Printed) -> str:
    """The text of ``test_outages``; empty without a longest outage."""
    contents = printed.contents
    around = contents.around
    if around is None or around.longest is None:
        return ""
    script = list(_script(around))
    rows, outages = _run(contents, around, script)
    steps = [
        (kind, at, outage, left, after)
        for (kind, outage, left), at, after in zip(script, _places(contents, script), outages, strict=True)
    ]
    repeats = counters(around)
    own = [f"c.{name}" for name in ("outage", "fade_left", *repeats)]
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
        refused=indented(_refused(printed, around)),
    )


def _script(around: Around) -> Iterator[tuple[int, int, int]]:
    """Whether each sample is good, and the outage and the rest of the fade that are set before it: long ones are cut short."""
    assert around.longest is not None
    longest, fade = int(around.longest), int(around.fade)
    yield GOOD, STAYS, STAYS
    yield GOOD, STAYS, STAYS
    for _ in range(2):  # the second begins with what the first left behind
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
        if longest:  # a return from as many misses as are tolerated is none
            yield MISS, longest - 1, STAYS
            yield GOOD, STAYS, STAYS
            yield MISS, STAYS, STAYS
        yield GOOD, STAYS, STAYS
        yield GOOD, STAYS, min(fade, 1)


def _places(contents: Contents, script: list[tuple[int, int, int]]) -> list[int]:
    """The sample of the simulation for each step: one after another, or only at good ones where it has few."""
    steps = [1] * len(script) if len(script) <= len(contents.vectors.states) else [int(kind == GOOD) for kind, _, _ in script]
    return [int(one) - 1 for one in np.cumsum(steps)]


def _run(contents: Contents, around: Around, script: list[tuple[int, int, int]]) -> tuple[Array, list[int]]:
    """(K, n) what is kept after each step, by the list and the simulation's shell, and the outages."""
    layout, state, rows, outages = contents.layout, contents.initial, [], []
    kept: Kept = around.initial(np.zeros(contents.sizes[0]), contents.sizes[2])
    last_y = list(layout.measured.rows)
    for (kind, outage, left), at in zip(script, _places(contents, script), strict=True):
        kept = kept if outage == STAYS else kept._replace(outage=np.array([float(outage)]))
        kept = kept if left == STAYS else kept._replace(fade_left=np.array([float(left)]))
        lost = kind == MISS
        y = state[last_y] if lost else contents.vectors.measured[at]
        after = contents.evaluated(state, y, contents.vectors.commands[at], contents.lost if lost else 0.0)
        state, kept = surrounded(contents, around, (state, after, y), kept, lost=lost)
        u = state[list(layout.u.rows)]
        rows.append([*state[layout.rows], *u, *kept.bump, *kept.outage, *kept.fade_left, *kept.repeats])
        outages.append(int(kept.outage[0]))
    return np.array(rows, dtype=float), outages


def surrounded(
    contents: Contents, around: Around, flat: tuple[Array, Array, Array], kept: Any, *, lost: bool
) -> tuple[Array, Any]:
    """The shell's transition for a sample, from one flat state to another with a measurement, and the values that it keeps."""
    numbers, template = contents.real.numbers, initial_acting(contents.loop)
    before, now = (unflatten(template, state.astype(numbers), 0)[0] for state in flat[:2])
    before = before._replace(held=before.held._replace(around=map_arrays(lambda part: part.astype(numbers), kept)))
    zero, one = np.zeros((), numbers), np.ones((), numbers)
    rest: Any = {"offered": kept.offered, "lost": kept.lost, "late": kept.late, "timer": kept.timer}
    taken = Taken(y=flat[2].astype(numbers), r=None, freeze=one if lost else zero, begun=one, due=one, wrong_time=zero, **rest)
    with np.errstate(divide="ignore", invalid="ignore"):  # for entries that are not selected
        acted = around.put_out(taken, before, now)
    return np.asarray(flatten(acted._replace(held=acted.held._replace(around=()))), dtype=float), acted.held.around


def _refused(printed: Printed, around: Around) -> list[str]:
    """A state that leads out of range beyond the longest outage: the fallback acts, the controller begins again and returns."""
    contents, layout = printed.contents, printed.contents.layout
    spared = (layout.theta_hat, layout.started, layout.measured, layout.part("held.baseline"))
    poked = [part for part in layout.parts if part not in spared]
    state = contents.vectors.states[3].copy()
    for part in poked:
        state[part.rows] = contents.range
    with np.errstate(all="ignore"):
        after = contents.evaluated(state, contents.vectors.measured[4], contents.vectors.commands[4])
        held = contents.evaluated(state, state[layout.measured.rows], state[layout.r.rows], contents.lost)
    held[layout.u.rows] = 0.0
    timed = around.band is not None and bool((np.abs(held[layout.rows]) > contents.range).any())
    if (np.abs(after[layout.rows]) <= contents.range).all():
        return []  # nothing here leads out of range
    given = "in." + printed.measured + ", " if contents.measures_state else ""
    others = [part for part in layout.parts if part not in (layout.u, layout.part("held.baseline"))]
    same = "\n        && ".join(f"same(c.{part.name}, other.{part.name}, {part.size})" for part in others)
    lines = [
        "{n}_init(&c); (void)replay(&c, 4); in = sample(4);",
        *(f"for (i = 0; i < {part.size}; ++i) {{{{ c.{part.name}[i] = {{M}}_RANGE; }}}}" for part in poked),
        *(["before = c; before.outage = 1L;"] if around.longest else []),
        *(
            [
                "require({n}_step(&c, &in, &out) == {M}_RESULT_REFUSED && same_state(&c, &before),",
                '    "a result out of range is not a miss");',
                "c.outage = {M}_LONGEST_OUTAGE - 1L; before.outage = {M}_LONGEST_OUTAGE;",
                "require({n}_step(&c, &in, &out) == {M}_RESULT_REFUSED && same_state(&c, &before),",
                '    "the controller begins again too early");',
            ]
            if around.longest
            else []
        ),
        "c.outage = {M}_LONGEST_OUTAGE; other = c; before = c;",
        "memcpy(u, c.last_u, sizeof u);",
        "(void){n}_start(&other, " + given + "c.last_u, 0L, 1); (void){n}_step(&other, &in, &out);",
        "require({n}_step(&c, &in, &out) == ({M}_RESULT_REFUSED | {M}_FALLBACK) && c.outage == {M}_LONGEST_OUTAGE + 1L,",
        '    "the fallback does not act after results out of range");',
        f"require({same},",
        '    "the controller does not begin again after results out of range");',
        _fallen(printed),
        "require(same(out.u, u, {M}_INPUTS) && same(c.last_u, u, {M}_INPUTS),",
        '    "the fallback differs after results out of range");',
        *(_AT_WRONG_TIME if timed else []),
        "in = sample(5);",
        "require({n}_step(&c, &in, &out) == {M}_OK && c.outage == 0L,",
        '    "the controller does not return after results out of range");',
        f'require({int(around.fade > 0)} == 0 || close_to(out.u, u, {{M}}_INPUTS), "this return causes a bump");',
    ]
    return [line.format(n=printed.name, M=printed.macro) for line in lines]


def _fallen(printed: Printed) -> str:
    """C that makes ``u``, the last control, the fallback's first one, within its limits."""
    alone = alone_of(printed).replace("{", "{{").replace("}", "}}")
    inside = "u[i] = u[i] < limits[i][0] ? limits[i][0] : u[i] > limits[i][1] ? limits[i][1] : u[i];"
    return f"{alone} for (i = 0; i < {{M}}_INPUTS; ++i) {{{{ u[i] = {fallen(printed, 'u')}; {inside} }}}}"


_AT_WRONG_TIME = [
    "other = before; other.outage = 0L; in.sample_time = 0;",
    "require({n}_step(&other, &in, &out) == ({M}_RESULT_REFUSED | {M}_WRONG_SAMPLE_TIME | {M}_FALLBACK),",
    '    "a result out of range at a wrong time is not followed by the fallback at once");',
]
_WHOLE = """
/* Two outages, each with its fallback and a return, through both fades, whose long middle is left out: for each sample whether it
 * is a miss, which of the simulation's it is, the outage and the rest of a fade that are set before it (-1: none), and the outage
 * afterwards. */
static const long outages[][5] = {{
{script}}};
static const uint64_t outage_digests[] = {{
    {digests} }};

static void test_outages(void)
{{
    {name}_controller c, other, before;
    {name}_input in;
    {name}_output out;
    {real} u[{macro}_INPUTS];
    const {real} nothing = 0;
    int i, k;
    (void)other; (void)before; (void)u; (void)i;
    {name}_init(&c);
    for (k = 0; k < (int)(sizeof outages / sizeof *outages); ++k) {{
        const unsigned told = outages[k][4] > {macro}_LONGEST_OUTAGE ? {macro}_FALLBACK : {macro}_OK;
        in = sample((int)outages[k][1]);
        if (outages[k][0] != 0L) {{
            in.{x}[{macro}_MEASURED - 1] = nothing / nothing;
        }}
        c.outage = outages[k][2] >= 0L ? outages[k][2] : c.outage;
        if (outages[k][3] >= 0L) {{ /* a fade of another length has ended, or the end of this one is near */
            c.fade = outages[k][3] > 0L ? c.fade : {macro}_FADE + {other}L;
            c.fade_left = outages[k][3];
        }}
        require({name}_step(&c, &in, &out) == ((outages[k][0] != 0L ? {macro}_MEASUREMENT_LOST : {macro}_OK) | told),
            "a sample of an outage has another status");
        {{
            const {real} counts[] = {{ {counts} }};
            const uint64_t found = mixed(mixed(digest_of(&c), c.last_u, {macro}_INPUTS), c.bump, {macro}_INPUTS);
            require(mixed(found, counts, {number}) == outage_digests[k] && c.matching == 0, "an outage differs");
        }}
        require(same(out.u, c.last_u, {macro}_INPUTS) && is_limited(&out), "the output differs during an outage");
    }}
{refused}}}
"""
