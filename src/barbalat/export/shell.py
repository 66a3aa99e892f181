"""The C code of the shell of a case: the acceptance of samples, the counting of misses, and the fallback after too many of
them."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import fill

import numpy as np

from barbalat.export.contents import Contents
from barbalat.export.layout import StatePart
from barbalat.export.texts import Printed, comment, indented, readable
from barbalat.loop.around import MOST_COUNTED, ROUNDINGS, Around
from barbalat.lowering import c99
from barbalat.validate import Array, counted

REFUSALS = 10
"""Number of good samples in a row with a result out of range after which the learnt values are discarded. They last longer than
the usual burst of bad samples and, at the sample times of flight computers, shorter than the time that a vehicle tolerates
without control."""
CLOCK_TOLERANCE = 1e-3
"""Relative difference allowed between a measured sample time and that of the export. A crystal is accurate to 100 ppm, and a
clock that counts microseconds measures 1 ms to within 0.1 %. For the law, an error of 0.1 % in the sample time is equivalent to
such an error in A and b. A wrong rate differs by far more.
"""


def roundings(printed: Printed) -> float:
    """``ROUNDINGS`` in the target's number type."""
    return ROUNDINGS * float(np.finfo(printed.contents.real.numbers).eps / np.finfo(float).eps)


def shell(printed: Printed) -> dict[str, str]:
    """The parts of ``controller.h`` and ``controller.c`` for a shell; they are empty without a shell."""
    around = printed.contents.around
    ends, timed = _ends(around), around is not None and around.band is not None
    commanded = around is not None and bool(around.command_rated)
    macro, x = printed.macro, printed.measured
    told = f"*status |= {macro}_MEASUREMENT_LOST;"
    lost = ["if (*measured != 0) {", f"    {told}", "}"] if timed else [told]
    return {
        "shell_macros": _macros(printed),
        "shell_members": indented(_members(around)),
        "shell_functions": _plausible(printed) + _plausible_command(printed),
        "kept_const": "" if commanded else "const ",
        "commanded": ", int commanded" if commanded else "",
        "commanded_taken": "int *commanded, " if commanded else "",
        "commanded_given": ", commanded" if commanded else "",
        "commanded_place": "&commanded, " if commanded else "",
        "commanded_before": "    int commanded = 1;\n" if commanded else "",
        "command_lost": " || ".join(_command_lost(printed)),
        "fall_back": _fall_back(printed),
        "refuse": _refuse(printed, timed=timed),
        "result_refused": "it counts as a miss; u and the state keep their values unless the fallback acts"
        if ends
        else "u is held, and after the first such sample the controller begins again",
        "restart_fade": f"{macro}_FADE" if ends else "0L",
        "shell_timer": _timer(printed) if timed else "",
        "uncalled": "*measured == 0 || " if timed else "",
        "implausible": " || ".join(_implausible(printed)),
        "lost": indented(lost, 8),
        "come_back": _returns(printed) if ends else "",
        "returns": indented([f"if (c->outage > {macro}_LONGEST_OUTAGE) {{", "    come_back(c);", "}"] if ends else [], 8),
        "accepted": indented(_accepted(printed)),
        "counted": indented(_one_more("outage") if ends else [], 8),
        "falls_back": indented([f"fall_back({_before(around)}c);"] * _falls(around) + ["bumped = 1;"] * bool(_before(around)), 8),
        "no_outage": indented(_no_outage(printed, age=str(MOST_COUNTED))),
        "no_outage_at_start": indented(_no_outage(printed, age="0" if printed.contents.measures_state else str(MOST_COUNTED))),
        "limit": _limit(printed),
        "start_control": indented(_started(printed)),
        **_without_state(printed),
        "distrusted": indented(_distrusted(printed), 8),
        "first_misses": ", up to LONGEST_OUTAGE misses" if ends else "",
        **(_timed(printed) if timed else _untimed(printed)),
        "untold": indented(_untold(macro, timed=timed, rated=commanded), 8),
        "command_good": indented(_one_more("command_outage") if commanded else []),
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
    counts = [f"c->{name} >= 0L && c->{name} <= {most}L" for name, most in members(around).items()]
    return [*counts, *stuck, *_held_in_range(printed)]


def _held_in_range(printed: Printed) -> list[str]:
    """Tests of the last good measurement and command: a corrupted one would be used in place of a lost one, and where a rate is
    limited every good value would count as too fast."""
    around, layout, checked = printed.contents.around, printed.contents.layout, held_in_range(printed.contents)
    assert around is not None
    found = []
    for part, rated, count, low, high in (
        (layout.measured, around.rated, "age", around.low, around.high),
        (layout.r, around.command_rated, "command_outage", around.command_low, around.command_high),
    ):
        tests = _ranges(printed, f"c->{part.name}", checked[part.name], low, high)
        if part.name in in_own_range(printed.contents) or not rated:
            found += tests
        elif tests:
            found.append(f"(c->{count} >= {MOST_COUNTED}L || ({(chr(10) + 12 * ' ' + '&& ').join(tests)}))")
    return found


def held_in_range(contents: Contents) -> dict[str, tuple[int, ...]]:
    """By the names of the last good measurement and command, those of their entries that are checked against the ranges of their
    channels: the entries that are within these ranges even before the first good value. Where a rate is limited, the age of the
    last good value shows whether there is one, and all entries with a range are checked."""
    found = {}
    for part, rated, ranged, within, _ in _held(contents):
        set_later = [row in contents.starts for row in part.rows]
        found[part.name] = tuple(i for i in ranged if rated or (within[i] and not set_later[i]))
    return found


def in_own_range(contents: Contents) -> set[str]:
    """The names of those of the last good measurement and command of which every entry is always within its channel's range, even
    before the first good value."""
    checked = held_in_range(contents)
    every = [(part, within, limits) for part, _, _, within, limits in _held(contents) if len(checked[part.name]) == part.size]
    return {part.name for part, within, limits in every if within.all() and (np.abs(limits) <= contents.range).all()}


def _held(contents: Contents) -> Iterator[tuple[StatePart, tuple[int, ...], tuple[int, ...], Array, Array]]:
    """The last good measurement and command, each with the entries whose rate and range are limited, whether each initial entry
    is within its range, and the limits (2, entries); nothing without a shell."""
    around, layout = contents.around, contents.layout
    if around is None:
        return
    rest, of_x = contents.at_start
    for part, rated, ranged, low, high in (
        (layout.measured, around.rated, around.ranged, around.low, around.high),
        (layout.r, around.command_rated, around.command_ranged, around.command_low, around.command_high),
    ):
        rows = list(part.rows)
        initial = [contents.initial[rows], np.where(of_x[rows].any(axis=1), low, rest[rows])]  # a start copies a good measurement
        within = np.all([(low <= values) & (values <= high) for values in initial], axis=0)
        yield part, rated, ranged, within, np.array([low, high])


def members(around: Around | None) -> dict[str, int]:
    """The integers that a shell adds to the state of every export, with their largest values."""
    if around is None:
        return {}
    timed = around.band is not None
    found = dict.fromkeys(counted_misses(around), MOST_COUNTED)
    found |= {"advanced": int(around.longest or 0)} if timed else {}
    return found | ({"paused": MOST_COUNTED} if timed and around.baseline is not None else {})


def counted_misses(around: Around | None) -> list[str]:
    """The counters of misses, each of which stops at its largest value."""
    if around is None:
        return []
    found = {"outage": _ends(around), "age": bool(around.rated), "command_outage": bool(around.command_rated)}
    return [name for name, there in found.items() if there]


def _implausible(printed: Printed) -> list[str]:
    """Tests for an invalid measurement; ranges of all channels imply the range of every number."""
    around, contents = printed.contents.around, printed.contents
    no_number = f"!in_range(in->{printed.measured}, {printed.macro}_MEASURED)"
    if not _checked(around) or around is None:
        return [no_number]
    within = (np.abs([around.low, around.high]) <= contents.range).all()  # an infinite range implies nothing
    return ["is_plausible(c, in) == 0"] if within else [no_number, "is_plausible(c, in) == 0"]


def _command_lost(printed: Printed) -> list[str]:
    """Tests for an invalid command; ranges of all of them imply the range of every number."""
    around, contents = printed.contents.around, printed.contents
    no_number = f"!in_range(in->r, {printed.macro}_COMMANDS)"
    if around is None or not around.checks_commands:
        return [no_number]
    within = (np.abs([around.command_low, around.command_high]) <= contents.range).all()
    return ["command_is_plausible(c, in) == 0"] if within else [no_number, "command_is_plausible(c, in) == 0"]


def counters(around: Around | None) -> list[str]:
    """The counters of channels that may be stuck."""
    return [] if around is None else [f"repeats[{k}]" for k in range(len(around.repeats))]


def _members(around: Around | None) -> list[str]:
    meanings = {
        "outage": "misses in a row",
        "age": f"samples since the last good measurement; {MOST_COUNTED}: there is none",
        "command_outage": f"samples in a row without a good command; {MOST_COUNTED}: there was none",
        "advanced": "number of misses that wrong times added to the outage",
        "paused": "fade_left when the baseline began to act",
    }
    found = [f"long {name}; /* {meanings[name]} */" for name in members(around)]
    if around is not None and around.repeats:
        found.append(
            f"long repeats[{len(around.repeats)}]; /* consecutive good samples equal to the previous one, of channels that "
            f"may be stuck */"
        )
    return found


def _no_outage(printed: Printed, *, age: str) -> list[str]:
    """C text that sets the counters to their start: nothing has been missed, the last good measurement (if any) has this age, and
    there was no command."""
    around = printed.contents.around
    values = {"age": age, "command_outage": str(MOST_COUNTED)}
    counts = [f"c->{name} = {values.get(name, '0')}L;" for name in members(around)]
    return ["c->refused = 0;", *counts, *(f"c->{name} = 0L;" for name in counters(around))]


def _without_state(printed: Printed) -> dict[str, str]:
    """C text for a state out of range, after which the controller restarts. Before that, it may wait for a measurement or for
    valid parameters."""
    around, contents = printed.contents.around, printed.contents
    if around is None or not _waits(printed):
        return {"wait": "", "outage_before": "", "begins": "(void)", "begun": ";", "told_fallback": ""}
    timed, names = around.band is not None, _names(printed)
    falls = _ZERO if around.baseline is not None else "fall_back(&as);\n" if _falls(around) else ""
    still = " || !state_is_usable(c)" if contents.parameters else ""  # a bad parameter remains
    back = "            c->outage = outage;\n" if contents.parameters else ""
    miss = _MISS_OF_WAIT.format(**names, most=MOST_COUNTED, falls=falls.format(**names)).splitlines()
    each = ["do {", *(f"    {line}" for line in miss), "    --left;", "} while (left >= 0L);"]
    return {
        "wait": _WAIT.format(
            **names,
            most=MOST_COUNTED,
            each=", as is each missed call" if timed else "",
            missed=", long missed" if timed else "",
            declared="    long left = missed;\n" if timed else "",
            at_once=_AT_ONCE.format(**names) if timed else "",
            misses=indented(each if timed else miss),
        ),
        "outage_before": "        const long outage = c->outage;\n" if contents.parameters else "",
        "begins": "if (",
        "begun": f" != {printed.macro}_OK{still}) {{\n{back}            wait(c{', missed' if timed else ''});\n        }}",
        "told_fallback": indented(_FALLS_BACK.format(macro=printed.macro).splitlines(), 8),
    }


def _distrusted(printed: Printed) -> list[str]:
    """C text for a state out of range: its last good values are not compared with the next ones, even if it can't restart."""
    there = members(printed.contents.around) if printed.contents.measures_state else {}
    return [f"c->{name} = {MOST_COUNTED}L;" for name in ("age", "command_outage") if name in there]


def _waits(printed: Printed) -> bool:
    """Whether a controller with a longest outage may have to wait before it restarts."""
    return _ends(printed.contents.around) and bool(printed.contents.measures_state or printed.contents.parameters)


def _seen(printed: Printed) -> list[str]:
    """C text that updates, at each sample, the counters of channels that may be stuck, with a good measurement at a right or
    wrong time."""
    around, layout = printed.contents.around, printed.contents.layout
    if around is None or not around.repeats:
        return []
    begun = f"before.{layout.started.name}[0] > 0"
    x, last = f"in->{printed.measured}", f"before.{layout.measured.name}"
    good = [
        f"c->repeats[{k}] = ({begun} && {x}[{i}] == {last}[{i}]) ? c->repeats[{k}] + 1L : 0L;"
        for k, (i, _) in enumerate(around.repeats)
    ]
    return ["if (measured != 0) {", *(f"    {line}" for line in good), "}"]


def _accepted(printed: Printed) -> list[str]:
    """The counts after a sample whose result is in range."""
    around = printed.contents.around
    timed, rated = around is not None and around.band is not None, around is not None and bool(around.rated)
    ended = ["c->refused = 0;"] + ["c->outage = 0L;"] * _ends(around) + ["c->age = 0L;"] * rated + ["c->advanced = 0L;"] * timed
    lines = [*_seen(printed), f"if (measured {'> 0' if timed else '!= 0'}) {{", *(f"    {line}" for line in ended), "}"]
    if rated:
        at_a_wrong_time = [" else if (measured != 0) {", "    c->age = 0L;", "}"] if timed else [""]
        lines[-1] += at_a_wrong_time[0]
        lines += at_a_wrong_time[1:]
        lines[-1] += " else {"
        lines += [*(f"    {line}" for line in _one_more("age")), "}"]
    if around is not None and around.command_rated:
        lines.append(_COMMANDED)
    return lines


def _returns(printed: Printed) -> str:
    """The C function for the first good sample after the fallback."""
    around = printed.contents.around
    timed = around is not None and around.band is not None
    limited = indented([_limits_of(printed, "last_u")]) if printed.limits() else ""
    earlier = "paused" if around is not None and around.baseline is not None else "fade_left"
    most = f"{MOST_COUNTED}L"  # the fade of a start may be longer
    kept = indented([f"const long earlier = c->{earlier} < {most} ? c->{earlier} : {most};"]) if timed else ""
    begins = indented((_SHORT_FADE if timed else _WHOLE_FADE).format(**_names(printed)).splitlines())
    return _RETURNS.format(**_names(printed), earlier=kept, limited=limited, begins=begins)


def _started(printed: Printed) -> list[str]:
    """The last control and the bump of a start, within the actuator limits."""
    copied = "c->{0}[i] = {1}[i];".format
    loop = f"for (i = 0; i < {printed.macro}_INPUTS; ++i) {{"
    if not printed.limits():
        return [loop, f"    {copied('bump', 'u_now')}", f"    {copied('last_u', 'u_now')}", "}"]
    first, then = ([loop, f"    {copied(*pair)}", "}"] for pair in (("last_u", "u_now"), ("bump", "c->last_u")))
    return [*first, _limits_of(printed, "last_u"), *then]


def _limits_of(printed: Printed, member: str) -> str:
    """C that brings a control of the state within the actuator limits; empty without limits."""
    return f"limit({'c, ' if limits_vary(printed) else ''}c->{member});" if printed.limits() else ""


def limits_vary(printed: Printed) -> bool:
    """Whether an actuator's limit is a parameter that can be set."""
    return any("c->" in printed.limit(i, side) for i, side in printed.limits())


def _limit(printed: Printed) -> str:
    """The C function ``limit``; empty without limits."""
    lines = [
        line
        for i, side in printed.limits()
        for line in (f"if (u[{i}] {'<>'[side]} {printed.limit(i, side)}) {{", f"    u[{i}] = {printed.limit(i, side)};", "}")
    ]
    given, told = f"{printed.real} *u", "Brings a control within the actuator's limits."
    if limits_vary(printed):
        given, told = f"const {printed.name}_controller *c, {given}", f"{told[:-1]}, unless these are corrupted."
        lines = ["if (parameters_are_usable(c->parameter) != 0) {", *(f"    {line}" for line in lines), "}"]
    return f"/* {told} */\nstatic void limit({given})\n{{\n{indented(lines)}}}\n\n" if lines else ""


def _ends(around: Around | None) -> bool:
    return around is not None and around.longest is not None


def _falls(around: Around | None) -> bool:
    return around is not None and around.longest is not None and around.fallback in _FALL_BACK


def _fall_back(printed: Printed) -> str:
    """The function of the fallback; empty if u is held."""
    around = printed.contents.around
    if around is None or not _falls(around):
        return ""
    limited, longest = _limits_of(printed, "last_u"), f"{printed.macro}_LONGEST_OUTAGE"
    begins = [f"if (c->outage == {longest} + 1L) {{", f"    {limited}", "}"] if limited else []
    names = {**_names(printed), **_of_baseline(printed), "begins": indented(begins)}
    names["limited"] = indented([limited], 8) if limited else ""
    names["pauses"] = indented(["c->paused = left;"], 8) if around.band is not None else ""
    return _FALL_BACK[around.fallback].format(**names)


def _before(around: Around | None) -> str:
    """The argument of a fallback that needs the state before the sample."""
    return "&before, " if around is not None and around.baseline is not None else ""


def _checked(around: Around | None) -> bool:
    """Whether measurements are checked."""
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
            f"#define {macro}_LONGEST_OUTAGE {around.longest:.0f}L /* consecutive misses, after which the fallback acts: "
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
    """C expressions for the terms of the baseline, computed from the members of ``c->``, with the products in the order of
    ``Around``."""
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
    """Tests in C for whether the entries of the array ``values`` are in the ranges of their measured channels."""
    around = printed.contents.around
    return [] if around is None else _ranges(printed, values, around.ranged, around.low, around.high)


def _command_ranges(printed: Printed, values: str) -> list[str]:
    """Tests in C for whether the entries of a command are in their ranges."""
    around = printed.contents.around
    return [] if around is None else _ranges(printed, values, around.command_ranged, around.command_low, around.command_high)


def _ranges(printed: Printed, values: str, places: tuple[int, ...], low: Array, high: Array) -> list[str]:
    sides = ((i, test, end[i]) for i in places for test, end in ((">=", low), ("<=", high)))
    return [f"{values}[{i}] {test} {printed.number(end)}" for i, test, end in sides]


def _slow(printed: Printed, values: str, last: str, places: tuple[int, ...], rate: Array) -> list[str]:
    """Tests for whether entries have changed no faster than accepted, over this number of ``samples``."""
    found = []
    for i in places:
        moved, most = f"{values}[{i}] - {last}[{i}]", f"{printed.number(rate[i])} * samples"
        found += [f"{moved} <= {most}", f"-({moved}) <= {most}"]
    return found


def _refuse(printed: Printed, *, timed: bool) -> str:
    """The function for a sample whose result is out of range."""
    around, state = printed.contents.around, printed.contents.measures_state
    ends, macro, good = _ends(around), printed.macro, "measured > 0" if timed else "measured != 0"
    beyond = "/* a control beyond its limits may be the cause */"
    limited = [f"{_limits_of(printed, printed.contents.layout.u.name)} {beyond}"] if printed.limits() else []
    rated, commanded = around is not None and bool(around.rated), around is not None and bool(around.command_rated)
    measured = [] if state else _STORES.format(**_names(printed)).splitlines()
    measured += ["c->age = measured != 0 ? 0L : c->age;"] * rated + [_COMMANDED] * commanded
    falls_back = [f"fall_back({_before(around)}c);" if _falls(around) else "hold(c);"]
    counted = [f"if ({good}) {{", *(f"    {line}" for line in _one_more("outage")), "}"] * ends + _one_more("age") * rated
    kept = ["paused"] if "paused" in members(around) else []
    own = printed.contents.layout.part("held.baseline") if _before(around) else None
    at_rest = []
    if own is not None:
        at_rest = [f"for (i = 0; i < {own.size} && c->refused >= {macro}_REFUSALS; ++i) {{"]
        at_rest += [f"    before.{own.name}[i] = c->{own.name}[i]; /* the baseline's state may be the cause */", "}"]
    return _REFUSE.format(
        at_rest=indented(at_rest, 8),
        limited=indented(limited, 8),
        **_names(printed),
        about=_REFUSED_ENDS if ends else _REFUSED,
        counted=indented(counted),
        commanded=", int commanded" if commanded else "",
        measured=indented(measured, 8),
        good=good,
        when=f"c->outage > {macro}_LONGEST_OUTAGE" if ends else f"{good} && c->refused > 1",
        before=f"    {printed.name}_controller before;\n" if _goes_back(printed) else "",
        stored="    before = *c;\n" if _goes_back(printed) else "",
        undone=_UNDONE.format(macro=macro, kept=indented([f"before.{name} = c->{name};" for name in kept], 12))
        if _goes_back(printed)
        else "",
        given=f"in->{printed.measured}, " if state else "",
        falls_back=indented(falls_back if ends else [*falls_back, "c->fade_left = 0L;", "c->matching = 0;"], 8),
    )


def _goes_back(printed: Printed) -> bool:
    """Whether the result may be out of range even after a restart, because of a fallback or a measurement in range."""
    if _ends(printed.contents.around):
        return True
    rest, of_x = printed.contents.at_start
    sizes = np.abs(of_x).sum(axis=1)
    return bool(printed.contents.opened is not None or (sizes > 1).any() or (np.asarray(rest)[sizes > 0] != 0).any())


def _plausible(printed: Printed) -> str:
    """The function that checks a measurement; empty if measurements are not checked."""
    around = printed.contents.around
    if around is None or not _checked(around):
        return ""
    names, x, last = printed.contents.problem.handed_names, f"in->{printed.measured}", printed.contents.layout.measured.name
    slow = _slow(printed, x, f"c->{last}", around.rated, around.rate)
    stuck = [f"!({x}[{i}] == c->{last}[{i}] && c->repeats[{k}] >= {most}L)" for k, (i, most) in enumerate(around.repeats)]
    looked_at = {*around.ranged, *around.rated, *(i for i, _ in around.repeats)}
    about = ", ".join(name for i, name in enumerate(names) if i in looked_at)
    told = f"Whether this measurement is plausible: {comment(about)}: in range, not too fast, not stuck."
    least = min(around.rate[list(around.rated)], default=0.0)
    return _check(printed, "is_plausible", told, [*in_ranges(printed, x), *stuck], slow, "age", least)


def _plausible_command(printed: Printed) -> str:
    """The function that checks a command; empty if commands are not checked."""
    around = printed.contents.around
    if around is None or not around.checks_commands:
        return ""
    tests = _command_ranges(printed, "in->r")
    slow = _slow(printed, "in->r", f"c->{printed.contents.layout.r.name}", around.command_rated, around.command_rate)
    told = "Whether this command is plausible: in range, not too fast."
    least = min(around.command_rate[list(around.command_rated)], default=0.0)
    return _check(printed, "command_is_plausible", told, tests, slow, "command_outage", least)


def _check(printed: Printed, function: str, told: str, tests: list[str], slow: list[str], count: str, least: float) -> str:
    """A C function that returns whether an input passes the ``tests`` and, if there is a last good value, the tests of its rate.

    Without a last good value, the ``count`` of samples is so large that every change passes, unless the ``least`` rate is tiny.
    """
    used, first = [*tests], [] if any("c->" in test for test in tests) else ["(void)c;"]
    if slow:
        none = f"c->{count} >= {MOST_COUNTED}L"
        needed = least * MOST_COUNTED < 3 * printed.contents.range
        used += [f"({none} || ({(chr(10) + 12 * ' ' + '&& ').join(slow)}))"] if needed else slow
        first = [f"const long count = c->{count} + 1L;", f"const {printed.real} samples = ({printed.real})count;"]
    join = "\n        && "
    body = indented([*first, f"return {join.join(used)};"])
    given = f"const {printed.name}_controller *c, const {printed.name}_input *in"
    return f"/* {told} */\nstatic int {function}({given})\n{{\n{body}}}\n\n"


def shell_readme(printed: Printed) -> str:
    """The section of README.md on a shell, which follows the section on outages; empty without a shell."""
    around, macro, T = printed.contents.around, printed.macro, printed.contents.sample_time
    if around is None:
        return ""
    told = []
    if _checked(around):
        names, labels = printed.contents.problem.handed_names, printed.contents.problem.measured_labels
        units = ["" if labels is None else readable(labels.unit(i)[1:-1]) for i in range(len(names))]
        limits = [f"{readable(names[i])} from {around.low[i]:g} to {around.high[i]:g} {units[i]}".rstrip() for i in around.ranged]
        rates = [
            f"{readable(names[i])} changes by at most {around.rate[i] / T:g} {units[i]}".rstrip() + " per second"
            for i in around.rated
        ]
        same = [f"{readable(names[i])} repeats its value for at most {counted(most, 'sample')}" for i, most in around.repeats]
        told.append(f"*Plausible measurements*: {', '.join([*limits, *rates, *same])}; any other measurement counts as lost.")
    if around.checks_commands:
        names = printed.contents.problem.command_names
        limits = [f"{names[i]} from {around.command_low[i]:g} to {around.command_high[i]:g}" for i in around.command_ranged]
        rates = [f"{names[i]} changes by at most {around.command_rate[i] / T:g} per second" for i in around.command_rated]
        told.append(
            f"*Plausible commands*: {', '.join([*limits, *rates])}; the last good command replaces any other, and the status has "
            f"{macro}_COMMAND_LOST."
        )
    if around.longest is not None:
        acts = {
            "hold": "u stays",
            "zero": "u is zero",
            "fade": f"u fades to zero over {counted(round(around.fade), 'sample')}",
            "baseline": "only the baseline acts, on the last good measurement and with its states held; u changes to its control "
            f"over {counted(round(around.fade), 'sample')}",
        }[around.fallback]
        rested = " and the baseline's initial states" if printed.contents.layout.part("held.baseline") and _before(around) else ""
        told.append(
            f"*The longest outage*: after {around.longest:.0f} consecutive misses {acts}, and the status has {macro}_FALLBACK. "
            f"The next good sample begins with the u applied at that time; the difference from the u that the controller "
            f"computes fades out over {counted(round(around.fade), 'sample')}. "
            f"A sample that would lead out of range ({macro}_RESULT_REFUSED) is a miss, too. If it comes after the longest "
            f"outage, the controller also restarts at it, so that the next good sample can end the outage. This restart keeps "
            f"the estimates and keeps u within its limits. From the {REFUSALS}th such good sample in a row on, the restart uses "
            f"the initial estimates{rested}, and the fallback continues from a u of zero."
        )
    if around.band is not None:
        told.append(
            f"*The time between two calls* is checked. A time within {around.band:g} s of the nominal time is replaced by the "
            f"nominal time ({macro}_JITTER). If the time is a larger whole number of sample times, the missed calls are "
            f"processed as misses ({macro}_MISSED_CALLS): a call after m missed ones computes m + 1 samples, at most "
            f"{(around.longest or 0) + 1:.0f}, and takes correspondingly longer. Any other time, and a time beyond the longest "
            f"outage, is a miss after which the fallback acts at once ({macro}_WRONG_SAMPLE_TIME)."
        )
    return "".join(f"\n{fill(one, 128, initial_indent='- ', subsequent_indent='  ')}" for one in told)


def _timed(printed: Printed) -> dict[str, str]:
    """The parts of one sample and the function of a call, for a shell with a timer, which determines the samples of a call."""
    longest, around = f"{printed.macro}_LONGEST_OUTAGE", printed.contents.around
    wrong = [
        f"if (c->outage < {longest}) {{",
        f"    c->advanced += {longest} - c->outage;",
        f"    c->outage = {longest}; /* the fallback acts at once */",
        "}",
        "if (missed < -2L) {",
        "    c->advanced = c->advanced > -missed - 2L ? c->advanced + missed + 2L : 0L;",
        "}",
    ]
    counts = ("age", around is not None and around.rated), ("command_outage", around is not None and around.command_rated)
    for name in (name for name, there in counts if there):
        wrong.append(f"c->{name} = c->{name} - missed < {MOST_COUNTED}L ? c->{name} - missed - 1L : {MOST_COUNTED}L;")
    return {
        "step": _ONE_SAMPLE.format(name=printed.name),
        "clock_test": "",
        "wrong_call": indented(["if (missed < 0L) {", *(f"    {line}" for line in wrong), "}"]),
        "missed_call": indented(_TIMED.format(freeze=f"{printed.contents.lost:g}").splitlines()),
        "timed_step": _STEP.format(**_names(printed)),
    }


def _untimed(printed: Printed) -> dict[str, str]:
    """The parts without a timer: each call is a sample, and a wrong time is only reported."""
    return {
        "step": _ONE_CALL.format(name=printed.name),
        "clock_test": _CLOCK.format(**_names(printed)),
        **dict.fromkeys(("wrong_call", "missed_call", "timed_step"), ""),
    }


def _timer(printed: Printed) -> str:
    """The functions for the time between two calls."""
    most = c99.constant(float(MOST_COUNTED), printed.contents.real)
    return _TIMER.format(**_names(printed), most=most, MOST=MOST_COUNTED)


def _untold(macro: str, *, timed: bool, rated: bool) -> list[str]:
    """C text for a lost command; a missing call is not reported."""
    told = f"*status |= {macro}_COMMAND_LOST;"
    more = ["*commanded = 0;"] if rated else []
    return [*(["if (*measured != 0) {", f"    {told}", "}"] if timed else [told]), *more]


def _one_more(counter: str) -> list[str]:
    return [f"if (c->{counter} < {MOST_COUNTED}L) {{", f"    ++c->{counter};", "}"]


def _comment(around: Around | None, x: str) -> str:
    if around is None:
        return ""
    told = []
    if _checked(around):
        told.append(
            f"An entry of {x} outside its range, or farther from its last good value than its rate allows, counts as lost."
        )
    if around.checks_commands:
        told.append("So does an entry of r.")
    if around.rated or around.command_rated:
        told += [
            "A rejected result leaves the last good values unchanged; the change that their rates allow grows with each sample.",
            "After a rejected state the next values are not compared with earlier ones.",
        ]
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
_TIMER = """\
/* Minus the number of samples that have begun in this time, at least one. */
static long begun({real} time)
{{
    if (!(time >= {macro}_SAMPLE_TIME)) {{
        return -1L;
    }}
    if (time >= {most} * {macro}_SAMPLE_TIME) {{
        return -{MOST}L;
    }}
    return -(long)(time / {macro}_SAMPLE_TIME) - 1L;
}}

/* Missed calls since the last one; below 0 if the time is not a multiple of the sample time, or too long:
 * minus the number of samples that have begun in it. */
static long missed_calls(const {name}_input *in)
{{
    const {real} time = in->sample_time;
    const {real} band = {macro}_BAND + {rounding} * time; /* the edge belongs to the band, however the time was rounded */
    {real} off;
    long whole;
    if (!(time >= {half} * {macro}_SAMPLE_TIME
            && time <= (({real}){macro}_LONGEST_OUTAGE + {more}) * {macro}_SAMPLE_TIME)) {{
        return begun(time);
    }}
    off = time - {macro}_SAMPLE_TIME;
    if (off <= band && -off <= band) {{
        return 0L;
    }}
    off = time / {macro}_SAMPLE_TIME + {half};
    whole = (long)off;
    off = time - ({real})whole * {macro}_SAMPLE_TIME;
    return (off <= band && -off <= band) ? whole - 1L : begun(time);
}}

"""
_ONE_CALL = "unsigned {name}_step({name}_controller *c, const {name}_input *in, {name}_output *out)"
_ONE_SAMPLE = """\
/* One sample. missed: 0 for a measured one, above 0 for a missed call, below 0 at a wrong time, see missed_calls. */
static unsigned sample({name}_controller *c, const {name}_input *in, {name}_output *out, long missed)"""
_TIMED = """\
if (missed != 0L) {{
    measured = 0;
    taken.freeze = {freeze};
    if (missed < 0L) {{
        measured = -1; /* a measurement is held, but the law needs the right time */
    }}
}}
"""
_STEP = """\
/* A call at another time than the nominal one: first the missed calls, if there are any, then this one. */
static unsigned at_another_time({name}_controller *c, const {name}_input *in, {name}_output *out)
{{
    long missed = missed_calls(in);
    unsigned told = {macro}_JITTER;
    unsigned status;
    if (missed > 0L) {{
        told = {macro}_MISSED_CALLS;
    }}
    if (missed < 0L) {{
        told = {macro}_WRONG_SAMPLE_TIME;
    }}
    do {{
        status = sample(c, in, out, missed);
        told |= status & {macro}_RESULT_REFUSED;
        --missed;
    }} while (missed >= 0L && (status & {macro}_STATE_REFUSED) == 0u);
    out->status = status | told;
    return out->status;
}}

unsigned {name}_step({name}_controller *c, const {name}_input *in, {name}_output *out)
{{
    if (!(in->sample_time <= {macro}_SAMPLE_TIME + {clock})) {{
        return at_another_time(c, in, out);
    }}
    if (!(in->sample_time >= {macro}_SAMPLE_TIME - {clock})) {{
        return at_another_time(c, in, out);
    }}
    return sample(c, in, out, 0L);
}}

"""
_RETURNS = """\
/* The first good sample after the fallback: u begins at the last control, and the difference fades out. */
static void come_back({name}_controller *c)
{{
    int i;
{earlier}{limited}    for (i = 0; i < {macro}_INPUTS; ++i) {{
        c->bump[i] = c->last_u[i];
    }}
{begins}    c->matching = 1;
}}

"""
_WHOLE_FADE = """\
c->fade = {macro}_FADE;
c->fade_left = {macro}_FADE;
"""
_SHORT_FADE = """\
c->fade = {macro}_FADE;
c->fade_left = {macro}_FADE;
if (c->outage - c->advanced <= {macro}_LONGEST_OUTAGE) {{ /* wrong times, for a short while: an earlier fade goes on */
    const long missed = c->outage - c->advanced;
    c->fade = missed < {macro}_FADE ? missed : {macro}_FADE;
    c->fade = earlier >= c->fade ? earlier + 1L : c->fade;
    c->fade_left = c->fade - 1L;
}}
"""
_WAIT = """\
/* A bad state from which the controller cannot begin again: a miss{each}. */
static void wait({name}_controller *c{missed})
{{
    {name}_controller as;
{declared}    int i;
    if (!(c->outage >= 0L && c->outage <= {most}L)) {{
        c->outage = 0L;
    }}
{at_once}{misses}}}

"""
_MISS_OF_WAIT = """\
if (c->outage < {most}L) {{
    ++c->outage;
}}
as = *c; /* only u changes in it */
hold(&as);
{falls}for (i = 0; i < {macro}_INPUTS; ++i) {{
    c->last_u[i] = as.{u}[i];
}}
"""
_AT_ONCE = """\
    if (missed < 0L && c->outage < {macro}_LONGEST_OUTAGE) {{
        c->outage = {macro}_LONGEST_OUTAGE; /* the fallback acts at once */
    }}
"""
_ZERO = """\
for (i = 0; i < {macro}_INPUTS && c->outage > {macro}_LONGEST_OUTAGE; ++i) {{
    as.{u}[i] = {zero}; /* the baseline would need a state that can't be trusted */
}}
"""
_COMMANDED = "c->command_outage = commanded != 0 ? 0L : c->command_outage;"
_REFUSED = """\
/* After a sample whose result is out of range: u and the state keep their values. From the second in a row with a good
 * measurement on, the controller begins again at this sample with its estimates kept, since the state itself may be the cause.
 * After REFUSALS of them it begins again without what was learnt, and with u at zero. */
"""
_REFUSED_ENDS = """\
/* After a sample whose result is out of range, which is a miss. Beyond the longest outage the fallback acts, and the controller
 * begins again at this sample with its estimates kept, since the state itself may be the cause. After REFUSALS of them in
 * a row with a good measurement it begins again without what was learnt, and with u at zero before the fallback. */
"""
_REFUSE = """\
{about}static void refuse({name}_controller *c, const {name}_input *in, int measured{commanded})
{{
{before}{counted}    if ({good} && c->refused < {macro}_REFUSALS) {{
        ++c->refused;
    }}
{stored}    if ({when}) {{
        int i;
        begin(c, {given}c->refused < {macro}_REFUSALS);
{measured}        for (i = 0; i < {macro}_COMMANDS; ++i) {{
            c->{last_r}[i] = in->r[i];
        }}
        c->{started}[0] = {one}; /* as after a first sample */
        for (i = 0; i < {macro}_INPUTS && c->refused >= {macro}_REFUSALS; ++i) {{
            c->last_u[i] = {zero};
        }}
{at_rest}{falls_back}{limited}{undone}        for (i = 0; i < {macro}_INPUTS; ++i) {{
            c->last_u[i] = c->{u}[i];
        }}
    }}
}}

"""
_STORES = """\
for (i = 0; i < {macro}_MEASURED; ++i) {{
    c->{last}[i] = in->{x}[i];
}}
"""
_UNDONE = """\
        if (!result_is_usable(c) || !in_range(c->bump, {macro}_INPUTS)) {{
{kept}            *c = before;
            return;
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
{rested}{alone}    if (c->outage == {macro}_LONGEST_OUTAGE + 1L) {{
{pauses}        c->fade = {macro}_FADE;
        left = {macro}_FADE;
{limited}        for (i = 0; i < {macro}_INPUTS; ++i) {{
            c->bump[i] = c->last_u[i] - alone[i];
        }}
    }}
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
    int i;
{begins}    for (i = 0; i < {macro}_INPUTS && c->outage > {macro}_LONGEST_OUTAGE; ++i) {{
        c->{u}[i] = left > 0L ? c->last_u[i] * ({one} - {one} / ({real})left) : {zero};
    }}
}}

""",
}
"""A fallback that holds the control needs no operation."""
