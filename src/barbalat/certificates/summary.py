"""A certificate in five lines: the condition, the bound, the margin, the largest gain and step, and the assumptions."""

from __future__ import annotations

from typing import Any, NamedTuple

from barbalat.certificates.assumptions import THE_CASE_S
from barbalat.certificates.cells import Column
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.entry import GUARANTEED, MOST_SHOWN, OF_THE_DESIGN, Entry, speaks_of_the_motion
from barbalat.certificates.linear_loops.margin_values import UNSTABLE_WITH_LAW
from barbalat.certificates.rows import said_of, up
from barbalat.certificates.theorems import DISTURBED_SET
from barbalat.pictures.symbols import held


class Line(NamedTuple):
    """One of the five lines of a certificate: its subject, its text and its kind."""

    label: str
    text: str
    kind: str


def lines(column: Column, certificate: Certificate, dt: float | None) -> tuple[Line, ...]:
    """The five lines, preceded by lines on requested simulations: the measured margins and the run."""
    gain, simulated = certificate.values.get("gamma_float32"), certificate.simulated
    leading = [] if simulated is None else [
        Line("measured", simulated.margins, "estimate"), Line("simulated", simulated.run, "estimate")
    ]  # fmt: skip
    last = [] if gain is None else [Line("32 bits", f"deviate from the case's run above {held(f'gain {gain:.3g}')}", "estimate")]
    return (*leading, *five(column, certificate, dt), *last)


def five(column: Column, certificate: Certificate, dt: float | None) -> tuple[Line, ...]:
    """The five lines: condition, bound, margin, the largest gain and step, and the assumptions, with those that fail."""
    if certificate.failure:
        why = f"not known: {certificate.failure}"
        rest = [Line(label, "not known", "does not apply") for label in ("bound of e", "margin", "gain, step", "assumed")]
        return Line("condition", why, "does not apply"), *rest
    return (
        _condition(column.cells.get("stability"), certificate.entry("condition")),
        _bound(certificate),
        _margin(certificate),
        _limits(certificate, dt),
        _assumed(column, certificate),
    )


def _condition(stability: Entry | None, condition: Entry | None) -> Line:
    if condition is not None and condition.value is not None:
        value = condition.value
        of = f"||{value.get('of', 'W_b (1 - C)')}||_1 {value.get('times', 'theta_max')}"
        size = "is infinite" if value["value_upper"] is None else f"<= {up(value['value_upper'])}"
        if value["holds"] and stability is not None and not stability.applies:
            return Line("condition", f"{of} {size}; not enough: {stability.why}", "does not apply")
        if value["holds"]:
            apart = stability is not None and stability.kind == OF_THE_DESIGN
            said = f"; the following is {OF_THE_DESIGN}" if apart else ""
            return Line("condition", f"holds: {of} {size} < 1{said}", OF_THE_DESIGN if apart else condition.kind)
        if stability is not None and speaks_of_the_motion(stability):  # without the condition, for fewer plants
            return Line("condition", f"not shown: {of} {size} is not below 1; bounded: {stability.text}", stability.kind)
        return Line("condition", f"not shown: {of} {size} is not below 1", "does not apply")
    if stability is None or not stability.applies:
        return Line("condition", f"not shown: {'' if stability is None else stability.why}", "does not apply")
    bounded = f"bounded, {OF_THE_DESIGN}" if stability.kind == OF_THE_DESIGN else "bounded"
    return Line("condition", f"none needed; {bounded}: {stability.text}", stability.kind)


def _bound(certificate: Certificate) -> Line:
    bound, worst = certificate.entry("error_bound"), certificate.entry("error_bound_worst")
    if bound is None or not bound.applies or bound.value is None:
        theorem = "" if bound is None or not bound.theorem else f". What is missing: {bound.theorem}"
        why = "not known for this scheme" if bound is None else bound.why
        return Line("bound of e", f"none: {why}{theorem}{_root_mean_square(certificate)}", "does not apply")
    over_set = worst.value if worst is not None and worst.applies else None
    of_set = worst is not None and over_set is not None and worst.kind == bound.kind and over_set <= bound.value
    text = f"{held(bound.kind)}: {up(min(bound.value, over_set) if of_set else bound.value)}{_of_unit(bound.unit)}"
    if of_set:  # a bound for any theta is one for the case's too
        text += " for any theta of the known set"
    text += _of_the_case(bound, certificate)
    if worst is not None and worst.theorem == DISTURBED_SET:
        text += ", for the case's theta only"
    if worst is not None and over_set is not None and not of_set:
        kind = "" if worst.kind == bound.kind else f"{held(worst.kind)}: "
        text += f"; {kind}{up(worst.value)} for any theta of the known set"
    command = certificate.entry("error_bound_command")
    if command is not None and command.applies and command.value is not None:
        kind = "" if command.kind == bound.kind else f"{held(command.kind)}: "
        text += f"; {kind}{up(command.value)} under the case's command, for any theta of the known set"
    return Line("bound of e", text, bound.kind)


def _of_the_case(bound: Entry, certificate: Certificate) -> str:
    """The restriction of a bound to the plant of the case, and whether other plants make the loop unstable."""
    if THE_CASE_S not in bound.rests_on:
        return ""
    loops = certificate.values.get("margins_over_known_set") or ()
    over = dict.fromkeys(one.get("over", "the known set") for one in loops if "unstable_at" in one)
    unstable = f"; the loop is unstable for part of {' and of '.join(over)}" if over else ""
    return f", for the case's theta and input gain only{unstable}"


def _root_mean_square(certificate: Certificate) -> str:
    """The bound that remains under Gaussian noise."""
    found = certificate.entry("error_rms_bound")
    if found is None or found.kind not in GUARANTEED:
        return ""
    over = "of every component, over all realisations of the noise"
    said = f"{up(found.value)}{_of_unit(found.unit)}{_of_the_case(found, certificate)}"
    return f". The root mean square {over}, is {held(found.kind)}: {said}"


def _of_unit(unit: str) -> str:
    """The unit of a bound on every component, or the units of the components."""
    return f", each component in its own unit ({unit})" if ", " in unit else f" {unit}" if unit else ""


LINEAR = "linear, without limits"
"""The note for a margin of a linear loop."""


def _margin(certificate: Certificate) -> Line:
    margin, adapting = certificate.entry("delay_margin"), certificate.entry("delay_margin_adapting")
    parts = []
    searched = certificate.entry("margins_over_known_set")
    loops = [] if searched is None or not searched.applies else searched.value
    for over, these in (
        ("set", [one for one in loops if "over" not in one]),
        ("ranges", [one for one in loops if "over" in one]),
    ):
        parts += _over(over, these)
    if adapting is not None and adapting.applies:
        same = margin is not None and margin.applies and margin.rest == adapting.rest
        parts.append(f"{_delay(adapting.value)} adapting{'' if same else _at_rest(adapting)}")
    elif adapting is not None and margin is not None and margin.applies:
        lost = adapting.why.startswith(UNSTABLE_WITH_LAW)
        parts.append(f"adapting: none, since {UNSTABLE_WITH_LAW}" if lost else "adapting: not known")
    if margin is not None and margin.applies:  # with a single margin, no distinction is needed
        at_theta = " at theta" if parts and margin.rest is None else ""
        frozen = " with frozen estimates" if adapting is not None and margin.rest is not None else ""
        parts.insert(0, f"{_delay(margin.value)}{frozen}{at_theta}{_at_rest(margin)}")
    each = certificate.entry("delay_margin_each")
    if not parts and each is not None and each.applies:
        delays = ", ".join(_delay(value) for value in each.value)
        said = f"{delays}: for each input, with no delay in the others{_at_rest(each)}"
        return Line("margin", f"{said}; {LINEAR}", each.kind)
    if not parts:
        why = margin.why if margin is not None and margin.why else "no stable linear loop describes it"
        return Line("margin", f"none: {why}", "does not apply")
    text = ", ".join(parts)
    return Line("margin", f"{text}; {LINEAR}", margin.kind if margin is not None and len(parts) == 1 else "estimate")


def _over(what: str, loops: list[dict[str, Any]]) -> list[str]:
    """The smallest margin found over the known set, or over the ranges of parameters with the parameters at which it occurs."""
    unstable = [loop.get("unstable_at_parameters") for loop in loops if "unstable_at" in loop]
    least = min((one["delay_margin"] for one in loops if "delay_margin" in one), key=lambda one: one["value"], default=None)
    if not unstable and least is None:
        return []
    found, at = ("unstable", unstable[0]) if least is None or unstable else (_delay(least["value"]), least.get("parameters"))
    return [f"{found} in the {what}{f', at {said_of(at)}' if at and len(at) <= MOST_SHOWN else ''}"]


def _at_rest(entry: Entry) -> str:
    """The equilibrium at which a margin was computed."""
    return "" if entry.rest is None else f" (at {entry.rest.text})"


def _delay(value: float | None) -> str:
    return held("any delay" if value is None else f"{value:.3g} s")


def _limits(certificate: Certificate, dt: float | None) -> Line:
    gain, step = (_span(certificate, key) for key in ("gamma_max", "step_max"))
    parts = [f"gain {_text_of(gain)}"] if gain else []
    parts += [f"step {_text_of(step)} s"] if step else []
    if not parts:
        return Line("gain, step", "no limit is known", "does not apply")
    judged = ""
    if step and dt is not None:
        word = "below" if dt <= step[0] else "too long" if dt > step[-1] else "between"
        judged = f" ({held(f'dt {word}')})"
    return Line("gain, step", f"{', '.join(map(held, parts))}{judged}", "estimate")


def _span(certificate: Certificate, key: str) -> list[float]:
    """The smallest tolerated value, and the value beyond which oscillations are expected, as far as known."""
    values = (certificate.values.get(name) for name in (key, f"{key}_at_model"))
    return [value for value in values if value is not None]


def _text_of(span: list[float]) -> str:
    """The text of a value; the second number, above which oscillations are expected, is less accurate."""
    return " to ".join(f"{value:.{digits}g}" for value, digits in zip(span, (3, 2), strict=False))


NOT_THE_PLANT = "the simulated plant differs from the design's; see the notes"
"""The note on a guarantee that holds only for the design."""


def _assumed(column: Column, certificate: Certificate) -> Line:
    """Return the line on the assumptions of the values and of the cells of Table 1; for a scheme without a bound, the assumptions
    are in the cells. Assumptions of guarantees hold; those that fail are the reason why further values are missing."""
    stated = [*certificate.entries, *column.cells.values()]
    claimed = {sentence for entry in stated if entry.kind == "guaranteed" for sentence in entry.assumptions}
    asked = (assumption for entry in stated if not entry.applies for assumption in entry.rests_on)
    apart = [
        broken
        for entry in stated
        if entry.kind == OF_THE_DESIGN
        for broken in [one.broken for one in entry.rests_on if one.broken] or [NOT_THE_PLANT]
    ]
    broken = ", ".join(dict.fromkeys(filter(None, [*(assumption.broken for assumption in asked), *apart])))
    guaranteed = any(speaks_of_the_motion(entry) and not entry.quantity.timeless for entry in stated)
    if broken and not guaranteed:
        return Line("assumed", f"fails here: {broken}", "does not apply")
    if not claimed:
        return Line("assumed", "nothing, since nothing is guaranteed", "")
    kept = "one assumption, which holds" if len(claimed) == 1 else f"{len(claimed)} assumptions, all of which hold"
    missing = f"; further values are not guaranteed, because their assumptions fail: {broken}" if broken else ""
    return Line("assumed", f"{kept} on this case{missing}", "guaranteed")
