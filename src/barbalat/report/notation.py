"""The notation of terminals as mathematics on a page: letters with accents, sub- and superscripts for theta_hat'Gamma^-1."""

from __future__ import annotations

import re
import unicodedata

from markupsafe import Markup, escape

ACCENTS = {
    "hat": "COMBINING CIRCUMFLEX ACCENT",
    "tilde": "COMBINING TILDE",
    "bar": "COMBINING MACRON",
    "dot": "COMBINING DOT ABOVE",
}
"""Parts of a name that stand above its letter, by their Unicode names."""
LETTERS = (
    "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi rho sigma tau phi psi omega "
    "Gamma Delta Theta Lambda Xi Sigma Phi Psi Omega"
)
"""By their names; pi, the number, is written out nowhere."""
SIGNS = {"<=": "≤", ">=": "≥", "+-": "±", "->": "→"}

_GREEK = {
    name: unicodedata.lookup(
        f"GREEK {'SMALL' if name.islower() else 'CAPITAL'} LETTER {'LAMDA' if name.lower() == 'lambda' else name.upper()}"
    )
    for name in LETTERS.split()
}
_TOKEN = re.compile(
    r"(?P<power>\^(?:-?\w+(?:\.\d+)?|\([^()]*\)))"
    r"|(?P<norm>\|\|(?:_\w+)?)"
    r"|(?P<root>\bsqrt\()"
    rf"|(?P<name>(?<![\w.])(?:{'|'.join(sorted(_GREEK, key=len, reverse=True))}|[A-Za-z](?=_))(?:_[A-Za-z0-9]+)*\d*(?![\w]))"
    r"|(?P<sign><=|>=|\+-|->)"
)


def mathematics(text: str) -> Markup:
    """Text of a page: its names, powers, roots and signs as mathematics, everything else escaped."""
    parts: list[Markup] = []
    end = 0
    for token in _TOKEN.finditer(text):
        parts += [escape(text[end : token.start()]), _typeset(token)]
        end = token.end()
    return Markup().join([*parts, escape(text[end:])])


def _typeset(token: re.Match[str]) -> Markup:
    match token.lastgroup:
        case "power":
            exponent = token[0][1:].removeprefix("(").removesuffix(")").replace("-", "−")
            return Markup("<sup>{}</sup>").format(exponent)
        case "norm":
            return Markup("‖<sub>{}</sub>").format(token[0][3:]) if token[0][2:] else Markup("‖")
        case "root":
            return Markup("√(")
        case "sign":
            return Markup(SIGNS[token[0]])
    return _name(token[0])


def _name(name: str) -> Markup:
    """A letter with its accents and its subscripts."""
    base, *parts = re.sub(rf"({'|'.join(ACCENTS)})(\d+)$", r"\1_\2", name).split("_")
    accents = [unicodedata.lookup(ACCENTS[part]) for part in parts if part in ACCENTS]
    below = [_GREEK.get(part, part) for part in parts if part not in ACCENTS]
    letter = Markup("<var>{}</var>").format("".join((_GREEK.get(base, base), *accents)))
    return letter + (Markup("<sub>{}</sub>").format(", ".join(below)) if below else Markup())
