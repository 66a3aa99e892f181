"""Certificates as rows of text, for the terminal and for pages, with each value's meaning and whether it is guaranteed."""

from __future__ import annotations

from collections.abc import Callable
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from typing import Any, NamedTuple

from barbalat.certificates.entry import GUARANTEED, Entry
from barbalat.certificates.quantities import QUANTITIES, Form
from barbalat.pictures.symbols import number_text


def up(value: float, digits: int = 4) -> str:
    """The smallest decimal with this number of significant digits that is not below the value."""
    return _rounded(value, digits, ROUND_CEILING)


def down(value: float, digits: int = 4) -> str:
    """The largest decimal with this number of significant digits that is not above the value."""
    return _rounded(value, digits, ROUND_FLOOR)


def _rounded(value: float, digits: int, rounding: str) -> str:
    exact = Decimal(value)  # every float is exactly a decimal
    kept = Context(prec=digits, rounding=rounding).create_decimal(exact)
    return f"{kept:.{digits}g}"  # no digits left to round


def radius_text(radius: float) -> str:
    """A spectral radius with four digits or, if it would then look like 1, with its distance from 1."""
    text = f"{radius:.4g}"
    return f"1 {'-' if radius < 1 else '+'} {abs(1 - radius):.2g}" if text == "1" and radius != 1 else text


KINDS = {"exact": "linear loop", "advice": "", "does not apply": "does not apply"}
"""The printed forms of kinds that are not printed by their names."""
NAMES_OF_BOUNDS = {"r": "bound on |r|, at all times", "x_m": "bound on every component of x_m, at all times"}
SMALLEST_SHOWN = 1e-12
"""A value per unit below this is rounding error and is printed as zero."""


class CertificateRow(NamedTuple):
    """``kind`` is an entry's kind, but "linear loop" for values that are exact for a linear loop, and empty for advice."""

    quantity: str
    value: str
    meaning: str
    kind: str


def rows_of(entry: Entry) -> list[CertificateRow]:
    """Return the rows of one entry; a guaranteed value is rounded so that the printed value is a bound too."""
    kind = KINDS.get(entry.kind, entry.kind)
    if not entry.applies:
        theorem = f". What is missing: {entry.theorem}" if entry.theorem else ""
        return [CertificateRow(entry.key, "", f"{entry.why}{theorem}", kind)]
    if entry.value is None:
        return []
    return ROWS_BY_FORM[entry.quantity.form](entry, kind)


def _text(entry: Entry, value: Any) -> str:
    if not isinstance(value, float):
        return number_text(value)
    if entry.kind in GUARANTEED:
        return (down if entry.quantity.below else up)(value, 6)
    return f"{value:.6g}"


def _plain(entry: Entry, kind: str) -> list[CertificateRow]:
    unit, value = f" [{entry.unit}]" if entry.unit else "", entry.value
    rest = "" if entry.rest is None else f", at the equilibrium under {entry.rest.text}"
    meaning = f"{entry.meaning}{unit}{rest}"
    return [CertificateRow(entry.key, value if isinstance(value, str) else _text(entry, value), meaning, kind)]


def _norms(entry: Entry, kind: str) -> list[CertificateRow]:
    ends = {name: f"{down(found['lower'], 10)} ... {up(found['upper'], 10)}" for name, found in entry.value.items()}
    return [CertificateRow(f"||{name}||_1", text, "L1 norm", kind) for name, text in ends.items()]


def _bounds(entry: Entry, kind: str) -> list[CertificateRow]:
    return [
        CertificateRow(f"sup |{name}|", _text(entry, bound), NAMES_OF_BOUNDS[name], kind) for name, bound in entry.value.items()
    ]


def _transfer_functions(entry: Entry, _: str) -> list[CertificateRow]:
    """Coefficients, highest power first."""
    rows = []
    for name, system in entry.value.items():
        text = ", ".join(f"{side} = [{number_text(values)}]" for side, values in system.items())
        rows.append(CertificateRow(f"{entry.key}, {name}", text, entry.meaning, "linear loop"))
    return rows


def _per_unit(entry: Entry, kind: str) -> list[CertificateRow]:
    left = ", ".join(f"{0 if abs(v) < SMALLEST_SHOWN else v:.4g} {name}" for name, v in entry.value.items())
    return [CertificateRow(entry.key, left, entry.meaning, kind)]


def _condition(entry: Entry, kind: str) -> list[CertificateRow]:
    value = entry.value
    quantity = f"||{value.get('of', 'W_b (1 - C)')}||_1 {value.get('times', 'theta_max')}"
    if value["value_upper"] is None:
        return [CertificateRow(quantity, "infinite", "condition < 1 fails", kind)]
    verdict = "< 1: holds" if value["holds"] else "not shown to be below 1"
    return [CertificateRow(quantity, f"<= {up(value['value_upper'], 6)}", f"condition {verdict}", kind)]


def _worst_case(loop: dict[str, Any]) -> list[CertificateRow]:
    """The margins of one linear loop over the known set, or over the ranges of parameters."""
    over = loop.get("over", "the known set")
    found = [CertificateRow(f"over {over}", f"the linear loop {loop['loop']}", f"searched: {loop['searched']}", "")]
    for key, value in loop.items():
        if isinstance(value, dict) and "value" in value:
            text = f"{value['value']:.6g} at {_place(value.get('parameters'), value['theta'], value.get('input_gain'))}"
            found.append(CertificateRow(f"- {key}", text, QUANTITIES[key].meaning, "estimate"))
    if loop["unlimited"]:
        found.append(CertificateRow("- unlimited", ", ".join(loop["unlimited"]), "at every plant checked", ""))
    if "unstable_at" in loop:
        place = _place(loop.get("unstable_at_parameters"), loop["unstable_at"], loop.get("unstable_at_gain"))
        found.append(CertificateRow("- unstable at", place, "", ""))
    return found


def _place(parameters: dict[str, float] | None, theta: list[float], gain: float | None) -> str:
    """The plant at which a margin was found: its parameters, or theta and the input gain."""
    if parameters:
        return said_of(parameters)
    return f"theta = [{number_text(theta)}]{'' if gain is None else f', omega = {number_text(gain)}'}"


def said_of(parameters: dict[str, float]) -> str:
    """Values of parameters in a sentence."""
    return ", ".join(f"{name} = {value:.4g}" for name, value in parameters.items())


ROWS_BY_FORM: dict[Form, Callable[[Entry, str], list[CertificateRow]]] = {
    Form.PLAIN: _plain,
    Form.MATRIX: lambda entry, kind: [CertificateRow(entry.key, number_text(entry.value, "; "), entry.meaning, kind)],
    Form.NAMES: lambda entry, _: [CertificateRow(entry.key, ", ".join(entry.value), entry.meaning, "")],
    Form.NORMS: _norms,
    Form.BOUNDS: _bounds,
    Form.CONDITION: _condition,
    Form.OVER_THE_SET: lambda entry, _: [row for loop in entry.value for row in _worst_case(loop)],
    Form.TRANSFER_FUNCTIONS: _transfer_functions,
    Form.PER_UNIT: _per_unit,
}
"""The display of a value, by its form."""
