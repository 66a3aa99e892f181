"""Certificates as rows of text, for the terminal and for pages: what each value means, and whether it is guaranteed."""

from __future__ import annotations

from typing import Any, NamedTuple

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.entry import Entry
from barbalat.certificates.quantities import QUANTITIES
from barbalat.certificates.rounding import down, up
from barbalat.report.numbers import number_text

KINDS = {"exact": "linear loop", "advice": "", "does not apply": "does not apply"}
"""How a kind is printed, where not by its own name."""
NAMES_OF_BOUNDS = {"r": "of |r|, at all times", "x_m": "of every component of x_m, at all times"}
SMALLEST_SHOWN = 1e-12
"""A value per unit below this is printed as zero: it is rounding."""


class Row(NamedTuple):
    """``kind`` is "guaranteed", "estimate", "does not apply", "linear loop" for what is exact of one, or empty for advice."""

    quantity: str
    value: str
    meaning: str
    kind: str


def rows(certificate: Certificate) -> list[Row]:
    """All entries in order; guaranteed values rounded so that the print is a bound too."""
    return [row for entry in certificate.entries for row in rows_of(entry)]


def rows_of(entry: Entry) -> list[Row]:
    """Those of one entry."""
    key, value, kind = entry.key, entry.value, KINDS.get(entry.kind, entry.kind)
    if not entry.applies:
        return [Row(key, "", entry.why, kind)]
    if value is None:
        return []
    match key:
        case "norms":
            return [
                Row(f"||{n}||_1", f"{down(e['lower'], 10)} ... {up(e['upper'], 10)}", "L1 norm", kind) for n, e in value.items()
            ]
        case "P":
            return [Row(key, number_text(value, "; "), entry.meaning, kind)]
        case "bounds":
            return [Row(f"sup |{name}|", _text(entry, bound), NAMES_OF_BOUNDS[name], kind) for name, bound in value.items()]
        case "condition":
            return [_condition(value, kind)]
        case "margins_over_known_set":
            return [row for loop in value for row in _worst_case(loop)]
        case "linear_equivalent" | "linear_equivalent_limit":
            return [_coefficients(f"{key}, {name}", system, entry.meaning) for name, system in value.items()]
        case "steady_error":
            left = ", ".join(f"{0 if abs(v) < SMALLEST_SHOWN else v:.4g} {name}" for name, v in value.items())
            return [Row(key, left, entry.meaning, kind)]
        case "unlimited":
            return [Row(key, ", ".join(value), entry.meaning, "")]
    unit = f" [{entry.unit}]" if entry.unit else ""
    return [Row(key, value if isinstance(value, str) else _text(entry, value), f"{entry.meaning}{unit}", kind)]


def _text(entry: Entry, value: Any) -> str:
    if not isinstance(value, float):
        return number_text(value)
    if entry.kind == "guaranteed":
        return (down if QUANTITIES[entry.key].below else up)(value, 6)
    return f"{value:.6g}"


def _condition(value: dict[str, Any], kind: str) -> Row:
    quantity = f"||{value.get('of', 'W_b (1 - C)')}||_1 {value.get('times', 'theta_max')}"
    if value["value_upper"] is None:
        return Row(quantity, "infinite", "condition < 1 fails", kind)
    verdict = "< 1: holds" if value["holds"] else "not shown to be below 1"
    return Row(quantity, f"<= {up(value['value_upper'], 6)}", f"condition {verdict}", kind)


def _coefficients(quantity: str, system: dict[str, list[float]], meaning: str) -> Row:
    """A transfer function, highest power first."""
    text = ", ".join(f"{side} = [{number_text(values)}]" for side, values in system.items())
    return Row(quantity, text, meaning, "linear loop")


def _worst_case(loop: dict[str, Any]) -> list[Row]:
    """The margins of one linear loop over the known set."""
    found = [Row("over the known set", loop["of"], f"searched: {loop['searched']}", "")]
    for key, value in loop.items():
        if isinstance(value, dict):
            text = f"{value['value']:.6g} at theta = [{number_text(value['theta'])}]"
            found.append(Row(f"- {key}", text, QUANTITIES[key].meaning, "estimate"))
    if loop["unlimited"]:
        found.append(Row("- unlimited", ", ".join(loop["unlimited"]), "at every theta looked at", ""))
    if "unstable_at" in loop:
        found.append(Row("- unstable at", f"theta = [{number_text(loop['unstable_at'])}]", "", ""))
    return found
