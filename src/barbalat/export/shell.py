"""The C of a case's shell: which samples are used, how misses are counted, and what acts after too many of them."""

from __future__ import annotations

from textwrap import fill

import numpy as np

from barbalat.export.texts import Printed, comment, indented
from barbalat.loop.around import MOST_COUNTED, ROUNDINGS, Around
from barbalat.lowering import c99

CLOCK_TOLERANCE = 1e-3
"""Relative difference allowed between a measured sample time and that of the export. A crystal is accurate to 100 ppm, and a
clock that counts microseconds measures 1 ms to within 0.1 %. For the law a sample time with an error of 0.1 % is equivalent
to such an error in A and b. A wrong rate differs by far more.
"""


def roundings(printed: Printed) -> float:
    """``ROUNDINGS`` in the target's numbers."""
    return ROUNDINGS * float(np.finfo(printed.contents.real.numbers).eps / np.finfo(float).eps)


def shell(printed: Printed) -> dict[str, str]:
    """The parts of ``controller.h`` and ``controller.c`` for a shell; empty texts without one."""
    around = printed.contents.around
    counts, ends, timed = around is not None and around.counts, _ends(around), around is not None and around.band is not None
    macro, x = printed.macro, printed.measured
    late = ["*measured <= 0 || "] if timed else []
    lost = [f"*status |= {macro}_MEASUREMENT_LOST;", "*measured = 0;"]
    return {
        "shell_macros": _macros(printed),
        "shell_members": indented(_members(around)),
        "shell_functions": _plausible(printed),
        "fall_back": _FALL_BACK[around.fallback].format(**_names(printed), **_of_baseline(printed))
        if _falls(around) and around
        else "",
        "begin_again": _begin_again(printed, timed=timed) if ends else "",
        "refused": indented([f"begin_again(&before, c, in{', measured' * timed});"] if ends else [], 8),
        "result_refused": "it counts as a miss, and u and the state keep their values unless the fallback acts"
        if ends
        else "u and the whole state keep their values",
        "shell_timer": _TIMER.format(**_names(printed)) if timed else "",
        "late": "".join(late),
        "implausible": " || ".join(_implausible(printed)),
        "lost": indented(["if (*measured > 0) {", *(f"    {line}" for line in lost), "}"] if timed else lost, 8),
        "returns": indented(
            [*(_RETURNS.format(**_names(printed)).splitlines() if ends else []), *(["c->outage = 0L;"] if counts else [])], 8
        ),
        "counted": indented(_counted(macro, ends=ends, timed=timed) if counts else [], 8),
        "falls_back": indented([f"fall_back({_before(around)}c);"] if _falls(around) else [], 8),
        "no_outage": indented([*(["c->outage = 0L;"] if counts else []), *_cleared(around)]),
        "repeated": indented(_repeated(printed), 8),
        "clock_test": (_BAND if timed else _CLOCK).format(**_names(printed)),
        "sample": _sample(printed, timed=timed),
        "one": "" if timed else " = 1",
        "uncalled": "*measured == 0 || " if timed else "",
        "untold": indented(_untold(macro, timed=timed), 8),
        "good": "> 0" if timed else "!= 0",
        "fallback_status": indented(_FALLS_BACK.format(macro=macro).splitlines()) if ends else "",
        "shell_statuses": str(31 | (64 | 128 if timed else 0) | (256 if ends else 0)),
        "shell_comment": _comment(around, x),
    }


def usable(printed: Printed) -> list[str]:
    """Tests of the state."""
    around = printed.contents.around
    if around is None:
        return []
    stuck = [f"c->repeats[{k}] >= 0L && c->repeats[{k}] <= {most}L" for k, (_, most) in enumerate(around.repeats)]
    return [*([f"c->outage >= 0L && c->outage <= {MOST_COUNTED}L"] if around.counts else []), *stuck]


def members(around: Around | None) -> list[str]:
    """Names of the integers that a shell adds to the state."""
    return [] if around is None or not around.counts else ["outage"]


def _implausible(printed: Printed) -> list[str]:
    """Tests for an invalid measurement; ranges of all channels imply the range of every number."""
    around, contents = printed.contents.around, printed.contents
    no_number = f"!in_range(in->{printed.measured}, {printed.macro}_MEASURED)"
    if not _checked(around) or around is None:
        return [no_number]
    within = (np.abs([around.low, around.high]) <= contents.range).all()  # an infinite one does not
    return ["is_plausible(c, in) == 0"] if within else [no_number, "is_plausible(c, in) == 0"]


def counters(around: Around | None) -> list[str]:
    """The counters of channels that may be stuck."""
    return [] if around is None else [f"repeats[{k}]" for k in range(len(around.repeats))]


def _members(around: Around | None) -> list[str]:
    found = ["long outage; /* samples in a row without a good measurement */"] if around is not None and around.counts else []
    if around is not None and around.repeats:
        found.append(
            f"long repeats[{len(around.repeats)}]; /* consecutive good samples equal to the previous one, of channels that "
            f"may be stuck */"
        )
    return found


def _cleared(around: Around | None) -> list[str]:
    return [] if around is None else [f"c->repeats[{k}] = 0L;" for k in range(len(around.repeats))]


def _repeated(printed: Printed) -> list[str]:
    """For a good sample: the counters of channels that may be stuck, compared with the last good one."""
    around, layout = printed.contents.around, printed.contents.layout
    if around is None:
        return []
    begun = f"before.{layout.started.name}[0] > 0"
    x, last = f"in->{printed.measured}", f"before.{layout.measured.name}"
    return [
        f"c->repeats[{k}] = ({begun} && {x}[{i}] == {last}[{i}]) ? c->repeats[{k}] + 1L : 0L;"
        for k, (i, _) in enumerate(around.repeats)
    ]


def _ends(around: Around | None) -> bool:
    return around is not None and around.longest is not None


def _falls(around: Around | None) -> bool:
    return around is not None and around.longest is not None and around.fallback in _FALL_BACK


def _before(around: Around | None) -> str:
    """The argument of a fallback that needs the state before the sample."""
    return "&before, " if around is not None and around.baseline is not None else ""


def _checked(around: Around | None) -> bool:
    return around is not None and bool(around.ranged or around.rated or around.repeats)


def _names(printed: Printed) -> dict[str, str]:
    layout = printed.contents.layout
    return {
        "name": printed.name, "macro": printed.macro, "real": printed.real, "x": printed.measured, "u": layout.u.name,
        "zero": f"0.0{printed.contents.real.suffix}", "last_r": layout.r.name, "last": layout.measured.name,
        "clock": c99.constant(CLOCK_TOLERANCE * printed.contents.sample_time, printed.contents.real),
        "more": f"1.5{printed.contents.real.suffix}", "half": f"0.5{printed.contents.real.suffix}",
        "started": layout.started.name, "one": f"1.0{printed.contents.real.suffix}",
        "rounding": c99.constant(roundings(printed), printed.contents.real),
    }  # fmt: skip


def _macros(printed: Printed) -> str:
    around, macro = printed.contents.around, printed.macro
    lines = []
    if around is not None and around.longest is not None:
        lines += [
            f"#define {macro}_LONGEST_OUTAGE {around.longest:.0f}L /* consecutive misses; after them follows: "
            f"{around.fallback} */",
            f"#define {macro}_FADE {around.fade:.0f}L /* samples over which the bump of a return fades out */",
            f"#define {macro}_FALLBACK 256u /* status: the outage is longer than LONGEST_OUTAGE, and u comes from the "
            f"fallback */",
        ]
    if around is not None and around.band is not None:
        lines += [
            f"#define {macro}_BAND {printed.number(around.band)} /* [s] allowed error of the time between two calls */",
            f"#define {macro}_JITTER 64u /* status: this time differs by more than 0.1 %, within the band; the nominal time "
            f"was used */",
            f"#define {macro}_MISSED_CALLS 128u /* status: this time is a larger whole number of sample times; each missed "
            f"call counts as a miss */",
        ]
    return "".join(f"{line}\n" for line in lines)


def baseline_terms(printed: Printed, state: str) -> list[str]:
    """C text of the baseline's entries, product by product as in ``Around``, from the members of the state ``c->``."""
    around, layout = printed.contents.around, printed.contents.layout
    if around is None or around.baseline is None:
        return []
    fixed, own = around.baseline, layout.part("held.baseline")
    handed = [f"{state}{layout.measured.name}[{i}]" for i in range(layout.measured.size)]
    handed += [] if own is None else [f"{state}{own.name}[{i}]" for i in range(own.size)]
    found = []
    for j in range(len(fixed.K)):
        of_r, of_z = ([i for row, i in places if row == j] for places in around.gains)
        command = " + ".join(f"{printed.number(fixed.k_r[j, i])} * {state}{layout.r.name}[{i}]" for i in of_r)
        products = [f"{printed.number(fixed.K[j, i])} * {handed[i]}" for i in of_z]
        if not command and products:
            command, products = f"-({products[0]})", products[1:]
        found.append(" - ".join([command or f"0.0{printed.contents.real.suffix}", *products]))
    return found


def _of_baseline(printed: Printed) -> dict[str, str]:
    """The parts of a fallback that is the baseline."""
    own = printed.contents.layout.part("held.baseline")
    rested = [] if own is None else [f"c->{own.name}[{i}] = before->{own.name}[{i}];" for i in range(own.size)]
    return {
        "rested": indented(rested),
        "alone": indented(f"alone[{i}] = {text};" for i, text in enumerate(baseline_terms(printed, "c->"))),
    }


def in_ranges(printed: Printed, values: str) -> list[str]:
    """Tests in C for whether the entries of the array ``values`` are in the ranges of their channels."""
    around, tests = printed.contents.around, list[str]()
    if around is None:
        return tests
    for i in around.ranged:
        low, high = (printed.number(side[i]) for side in (around.low, around.high))
        tests += [f"{values}[{i}] >= {low}", f"{values}[{i}] <= {high}"]
    return tests


def _begin_again(printed: Printed, *, timed: bool) -> str:
    """The function for a sample whose result is out of range, if an outage has a limit."""
    around, state = printed.contents.around, printed.contents.measures_state
    limited = []
    for i, side in printed.limits():
        u, end = f"c->{printed.contents.layout.u.name}[{i}]", printed.limit(i, side)
        limited += [
            f"if ({u} {'<>'[side]} {end}) {{ /* beyond its limits it may be what leads out of range */",
            f"    {u} = {end};",
            "}",
        ]
    return _BEGIN_AGAIN.format(
        limited=indented(limited, 8),
        **_names(printed),
        how=", int measured" if timed else "",
        counted=indented(_counted(printed.macro, ends=True, timed=timed)),
        given=f"in->{printed.measured}, " if state else "",
        falls_back=indented([f"fall_back({'before, ' * bool(_before(around))}c);" if _falls(around) else "hold(c);"], 8),
    )


def _plausible(printed: Printed) -> str:
    around = printed.contents.around
    if around is None or not _checked(around):
        return ""
    names, x, slow = printed.contents.problem.handed_names, printed.measured, []
    tests = in_ranges(printed, f"in->{x}")
    last = printed.contents.layout.measured.name
    for i in around.rated:
        most = f"{printed.number(around.rate[i])} * samples"
        moved = f"in->{x}[{i}] - c->{last}[{i}]"
        slow += [f"{moved} <= {most}", f"-({moved}) <= {most}"]
    slow += [f"!(in->{x}[{i}] == c->{last}[{i}] && c->repeats[{k}] >= {most}L)" for k, (i, most) in enumerate(around.repeats)]
    if slow:
        tests.append(f"(!(c->{printed.contents.layout.started.name}[0] > 0) || ({(chr(10) + 12 * ' ' + '&& ').join(slow)}))")
    join = "\n        && "
    counts = ["const long count = c->outage + 1L;", f"const {printed.real} samples = ({printed.real})count;"]
    counted = counts if around.rated else [] if slow else ["(void)c;"]
    body = indented([*counted, f"return {join.join(tests)};"])
    looked_at = {*around.ranged, *around.rated, *(i for i, _ in around.repeats)}
    about = ", ".join(name for i, name in enumerate(names) if i in looked_at)
    return (
        f"/* Whether this measurement is plausible: {comment(about)}: in range, not too fast, not stuck. */\n"
        f"static int is_plausible(const {printed.name}_controller *c, const {printed.name}_input *in)\n{{\n{body}}}\n\n"
    )


def shell_readme(printed: Printed) -> str:
    """The section of README.md on a shell, after that on outages; empty without one."""
    around, macro, T = printed.contents.around, printed.macro, printed.contents.sample_time
    if around is None:
        return ""
    told = []
    if _checked(around):
        names, labels = printed.contents.problem.handed_names, printed.contents.problem.measured_labels
        units = ["" if labels is None else comment(labels.unit(i)[1:-1]) for i in range(len(names))]
        limits = [f"{comment(names[i])} from {around.low[i]:g} to {around.high[i]:g} {units[i]}".rstrip() for i in around.ranged]
        rates = [f"{comment(names[i])} by {around.rate[i] / T:g} {units[i]}".rstrip() + " per second" for i in around.rated]
        same = [f"{comment(names[i])} equal to the previous one for {most} samples" for i, most in around.repeats]
        told.append(f"*Plausible measurements*: {', '.join([*limits, *rates, *same])}; any other measurement counts as lost.")
    if around.longest is not None:
        acts = {
            "hold": "u stays",
            "zero": "u is zero",
            "fade": f"u fades to zero over {around.fade:.0f} samples",
            "baseline": "only the baseline acts, on the last good measurement and with its states held; u changes to its control "
            f"over {around.fade:.0f} samples",
        }[around.fallback]
        told.append(
            f"*The longest outage*: after {around.longest:.0f} consecutive misses {acts}, and the status has {macro}_FALLBACK. "
            f"The next good sample begins with the u applied at that time; the difference to the controller's own u fades "
            f"out over {around.fade:.0f} samples. "
            f"A sample that would lead out of range ({macro}_RESULT_REFUSED) is a miss, too. If it is beyond the longest outage, "
            "the controller also begins again at it, as by a start that keeps the estimates and with u within its limits, so "
            "that the next good sample can end the outage."
        )
    if around.band is not None:
        told.append(
            f"*The time between two calls* is checked: within {around.band:g} s of the nominal time, the nominal time is used "
            f"({macro}_JITTER); if it is a larger whole number of sample times, the missed calls are processed as misses "
            f"({macro}_MISSED_CALLS), so that a call after m missed ones computes m + 1 "
            f"samples, at most {(around.longest or 0) + 1:.0f}, and takes correspondingly longer; any other time, and a time "
            f"beyond the longest outage, is a miss after which the fallback acts at once ({macro}_WRONG_SAMPLE_TIME)."
        )
    return "".join(f"\n{fill(one, 128, initial_indent='- ', subsequent_indent='  ')}" for one in told)


def _sample(printed: Printed, *, timed: bool) -> str:
    """Accepting a sample; with a timer, missing calls are counted too."""
    unbegun = f" | {printed.macro}_WRONG_SAMPLE_TIME" if timed else ""
    lines = _SAMPLE.format(**_names(printed), unbegun=unbegun).splitlines()
    return _CALLS.format(**_names(printed), sample=indented(lines, 8)) if timed else indented(lines)


def _untold(macro: str, *, timed: bool) -> list[str]:
    """For a lost command; a missing call is not reported."""
    told = f"*status |= {macro}_COMMAND_LOST;"
    return ["if (*measured != 0) {", f"    {told}", "}"] if timed else [told]


def _counted(macro: str, *, ends: bool, timed: bool) -> list[str]:
    """For a miss: one more consecutive miss, and at a wrong time as many as the fallback waits for."""
    lines = [f"if (c->outage < {MOST_COUNTED}L) {{", "    ++c->outage;", "}"]
    if ends and timed:
        longest = f"{macro}_LONGEST_OUTAGE"
        lines = [f"if (measured < 0 && c->outage < {longest}) {{", f"    c->outage = {longest};", "}", *lines]
    return lines


def _comment(around: Around | None, x: str) -> str:
    if around is None:
        return ""
    told = []
    if _checked(around):
        told.append(
            f"An entry of {x} outside its range, or farther from its last good value than its rate allows, counts as lost."
        )
    if around.longest is not None:
        told.append(
            "After LONGEST_OUTAGE consecutive misses the fallback acts; u returns from it without a bump, over FADE samples."
        )
    if around.band is not None:
        told.append(
            "The time since the last call is checked: see JITTER, MISSED_CALLS, and WRONG_SAMPLE_TIME, which triggers the "
            "fallback."
        )
    return "".join(f" * {one}\n" for one in told)


_CLOCK = """\
    if (!(in->sample_time <= {macro}_SAMPLE_TIME + {clock} && in->sample_time >= {macro}_SAMPLE_TIME - {clock})) {{
        status |= {macro}_WRONG_SAMPLE_TIME;
    }}
"""
_BAND = """\
    const {real} off = in->sample_time - {macro}_SAMPLE_TIME;
    long missed = 0L;
    if (!(off <= {clock} && -off <= {clock})) {{
        missed = missed_calls(in);
        if (missed < 0L) {{
            status |= {macro}_WRONG_SAMPLE_TIME;
        }} else if (missed > 0L) {{
            status |= {macro}_MISSED_CALLS;
            missed = c->{started}[0] > 0 ? missed : 0L; /* nothing advances before the first sample */
        }} else {{
            status |= {macro}_JITTER;
        }}
    }}
"""
_TIMER = """\
/* Missed calls since the last one; -1 if the time is not a multiple of the sample time, or too long. */
static long missed_calls(const {name}_input *in)
{{
    const {real} time = in->sample_time;
    const {real} band = {macro}_BAND + {rounding} * time; /* its edge belongs to it, however the time was rounded */
    {real} off;
    long whole;
    off = time - {macro}_SAMPLE_TIME;
    if (off <= band && -off <= band) {{
        return 0L;
    }}
    if (!(time >= {half} * {macro}_SAMPLE_TIME
            && time <= (({real}){macro}_LONGEST_OUTAGE + {more}) * {macro}_SAMPLE_TIME)) {{
        return -1L;
    }}
    off = time / {macro}_SAMPLE_TIME + {half};
    whole = (long)off;
    off = time - ({real})whole * {macro}_SAMPLE_TIME;
    return (off <= band && -off <= band) ? whole - 1L : -1L;
}}

"""
_SAMPLE = """\
taken = *in;
take(c, &taken, &measured, &status);
if ((status & ({macro}_MEASUREMENT_LOST | {macro}_COMMAND_LOST{unbegun})) != 0u && !(c->{started}[0] > 0)) {{
    give(c, out, status); /* nothing has begun, and no earlier value can replace the lost one */
    return out->status;
}}
if (go_on(c, &taken, measured) == 0) {{
    status |= {macro}_RESULT_REFUSED;
}}
"""
_CALLS = """\
    do {{
        measured = 1;
        if (missed > 0L) {{
            measured = 0; /* a missed call is processed */
        }}
        if (missed < 0L) {{
            measured = -1;
        }}
{sample}        --missed;
    }} while (missed >= 0L);
"""
_RETURNS = """\
if (c->outage > {macro}_LONGEST_OUTAGE) {{
    for (i = 0; i < {macro}_INPUTS; ++i) {{
        c->bump[i] = c->last_u[i];
    }}
    c->fade = {macro}_FADE;
    c->fade_left = {macro}_FADE;
    c->matching = 1;
}}
"""
_BEGIN_AGAIN = """\
/* After a sample whose result is out of range, which is a miss. Beyond the longest outage the fallback acts, and the controller
 * begins again at this sample with its estimates kept: the state itself may be what leads out of range. */
static void begin_again(const {name}_controller *before, {name}_controller *c, const {name}_input *in{how})
{{
{counted}    if (c->outage > {macro}_LONGEST_OUTAGE) {{
        const long outage = c->outage;
        int i;
        begin(c, {given}1);
        for (i = 0; i < {macro}_MEASURED; ++i) {{
            c->{last}[i] = in->{x}[i];
        }}
        for (i = 0; i < {macro}_COMMANDS; ++i) {{
            c->{last_r}[i] = in->r[i];
        }}
        c->{started}[0] = {one}; /* as after a first sample */
{falls_back}{limited}        if (!result_is_usable(c)) {{
            *c = *before;
            c->outage = outage;
            return;
        }}
        for (i = 0; i < {macro}_INPUTS; ++i) {{
            c->last_u[i] = c->{u}[i];
        }}
    }}
}}

"""
_FALLS_BACK = """\
if (c->outage > {macro}_LONGEST_OUTAGE) {{
    status |= {macro}_FALLBACK;
}}
"""
_FALL_BACK = {
    "baseline": """\
/* After the longest outage: only the baseline, on the last good measurement, with its states held. */
static void fall_back(const {name}_controller *before, {name}_controller *c)
{{
    {real} alone[{macro}_INPUTS];
    long left = before->fade_left;
    int i;
    if (c->outage <= {macro}_LONGEST_OUTAGE) {{
        return;
    }}
{rested}{alone}    if (before->outage <= {macro}_LONGEST_OUTAGE) {{
        c->fade = {macro}_FADE;
        left = {macro}_FADE;
        c->matching = 1;
    }}
    for (i = 0; i < {macro}_INPUTS && c->matching != 0; ++i) {{ /* also where a number has been set since the last sample */
        c->bump[i] = c->last_u[i] - alone[i];
    }}
    c->matching = 0;
    for (i = 0; i < {macro}_INPUTS; ++i) {{
        c->{u}[i] = alone[i];
        if (left > 0L && c->fade > 0L) {{
            c->{u}[i] = alone[i] + c->bump[i] * (({real})left / ({real})c->fade);
        }}
    }}
    c->fade_left = left > 0L ? left - 1L : 0L;
}}

""",
    "zero": """\
/* After the longest outage: no control. */
static void fall_back({name}_controller *c)
{{
    int i;
    for (i = 0; i < {macro}_INPUTS && c->outage > {macro}_LONGEST_OUTAGE; ++i) {{
        c->{u}[i] = {zero};
    }}
}}

""",
    "fade": """\
/* After the longest outage: the last control fades out. */
static void fall_back({name}_controller *c)
{{
    const long left = c->outage > {macro}_LONGEST_OUTAGE ? {macro}_FADE + {macro}_LONGEST_OUTAGE + 1L - c->outage : 0L;
    const long less = left - 1L;
    int i;
    for (i = 0; i < {macro}_INPUTS && c->outage > {macro}_LONGEST_OUTAGE; ++i) {{
        c->{u}[i] = left > 0L ? c->last_u[i] * (({real})less / ({real})left) : {zero};
    }}
}}

""",
}
"""A held control needs no operation."""
