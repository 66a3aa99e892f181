"""Converts names in plots to symbols and powers of ten in plain text, such as γ and 10⁶ for gamma 1e6, and keeps text on one
line."""

from __future__ import annotations

import re

HELD_BLANK = "\N{NO-BREAK SPACE}"
"""A non-breaking space."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
GREEK = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "epsilon": "ε",
    "zeta": "ζ",
    "eta": "η",
    "theta": "θ",
    "kappa": "κ",
    "lambda": "λ",
    "mu": "μ",
    "nu": "ν",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "phi": "φ",
    "omega": "ω",
    "Gamma": "Γ",
    "Delta": "Δ",
    "Theta": "Θ",
    "Lambda": "Λ",
}
SUBSCRIPTS = str.maketrans("0123456789xr", "₀₁₂₃₄₅₆₇₈₉ₓᵣ", ",")
HAT = "\N{COMBINING CIRCUMFLEX ACCENT}"
_VALUE = re.compile(rf"\b({'|'.join(GREEK)})(?= (?:= )?[\d.])|(?<![\w.])(-?\d+(?:\.\d+)?)e([+-]?\d+)(?![\w.])")


def held(text: str) -> str:
    """Return the text with non-breaking spaces."""
    return text.replace(" ", HELD_BLANK)


def in_symbols(text: str) -> str:
    """Return a name in which the name of a Greek letter before a value is replaced by its symbol, and numbers are in plain
    notation."""

    def symbol(found: re.Match[str]) -> str:
        letter, mantissa, exponent = found.groups()
        return GREEK[letter] if letter else times_power(mantissa, int(exponent))

    return _VALUE.sub(symbol, text)


def estimated(name: str) -> str:
    """Return the name of an estimate, such as "theta_1" or "k_x,1", with its hat: θ̂₁, k̂ₓ₁."""
    symbol, _, index = name.partition("_")
    return f"{GREEK.get(symbol, symbol)}{HAT}{index.translate(SUBSCRIPTS)}"


_BELOW = str.maketrans("0123456789aehijklmnoprstuvx", "₀₁₂₃₄₅₆₇₈₉ₐₑₕᵢⱼₖₗₘₙₒₚᵣₛₜᵤᵥₓ", ",")
_MATHTEXT = re.compile(r"\\hat\{\\?(?P<hat>\w+)\}|\\(?P<name>[a-zA-Z]+)|_\{(?P<index>[^}]*)\}|_(?P<letter>\w)")


def without_mathtext(text: str) -> str:
    """Return a picture's text with its formulas as plain text: x₁ and θ̂₁ instead of Matplotlib's math markup."""

    def plain(found: re.Match[str]) -> str:
        if found["hat"]:
            return f"{GREEK.get(found['hat'], found['hat'])}{HAT}"
        if found["name"]:
            return GREEK.get(found["name"], found["name"])
        index = found["index"] or found["letter"]
        below = index.translate(_BELOW)
        return f"_{index}" if re.search(r"[A-Za-z]", below) else below

    parts = re.split(r"(?<!\\)\$", text.removeprefix("\u200b"))
    return "".join(
        _MATHTEXT.sub(plain, part).replace("-", "−") if i % 2 else part.replace(r"\$", "$") for i, part in enumerate(parts)
    )


def times_power(mantissa: str, exponent: int) -> str:
    """Format a number as 4.3·10⁶, or as 10⁶ if its mantissa is 1."""
    power = "10" + str(exponent).translate(SUPERSCRIPTS)
    return power if mantissa == "1" else f"{mantissa}·{power}"


def number_text(value: float | list[float] | None, separator: str = ", ") -> str:
    """Format a number for display, with four digits and a separator between components."""
    if isinstance(value, list):
        return separator.join(number_text(v) for v in value) or "-"
    return "-" if value is None else f"{value + 0.0:.4g}"  # avoids a minus sign before zero
