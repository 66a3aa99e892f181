"""The cells of Table 1: statements with the constants of the case, each an entry with its assumptions (see docs/table-1.md)."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Any

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.entry import GUARANTEED, Assumption, Entry, checked, missing, of_the_design
from barbalat.certificates.quantities import ON_DAMPING, Quantity

PROPERTIES = {
    "stability": "Signals bounded",
    "tracking": "Tracking error",
    "transient": "Transient",
    "estimates": "Estimates",
    "modelling_error": "With modelling error (11)",
    "tuning": "Gain, filter, step",
    "margins": "Linear loop",
}
"""The rows of Table 1; the first four concern the plant without modelling error."""

NONLINEAR = "known for phi(x) = x; if phi grows faster, a normalised law may be too slow to keep x bounded"


@dataclass(frozen=True)
class Column:
    """The column of Table 1 for a controller: its cells by the keys of PROPERTIES."""

    name: str
    scheme: str
    cells: dict[str, Entry]

    def with_design(self, keys: Collection[str]) -> Column:
        """Return a copy in which the cells with these keys are guaranteed for the design only."""
        return replace(self, cells=self.cells | {key: of_the_design(self.cells[key]) for key in keys}) if keys else self

    def given(self, unmet: Iterable[Assumption]) -> Column:
        """Return a copy in which guarantees hold for the design only, because of assumptions that the case does not satisfy."""
        cells = self.cells
        for one in unmet:
            cells = cells | {key: of_the_design(cell, one) for key, cell in cells.items() if cell.kind in GUARANTEED}
        return replace(self, cells=cells)

    def as_json(self) -> dict[str, Any]:
        """The block for a column in the JSON contract; ``text`` is the statement, or the reason why there is none."""
        cells = {key: {"text": cell.text} | cell.as_json() for key, cell in self.cells.items()}
        return {"name": self.name, "scheme": self.scheme, **cells}


def statement(key: str, text: str, *assumptions: Assumption) -> Entry:
    """A statement that holds for this case, or an entry with the reason if the case violates an assumption."""
    found = checked(key, text, assumptions, Quantity(PROPERTIES[key]))
    return found if found.applies else replace(found, value=None)


def nothing(key: str, why: str, *assumptions: Assumption) -> Entry:
    """A cell without a claim for this scheme, with the reason; ``assumptions`` are what a claim would need."""
    return missing(key, why, assumptions, Quantity(PROPERTIES[key]))


def denied(key: str, why: str, *assumptions: Assumption) -> Entry:
    """A cell without a claim because of the scheme; it also names the assumptions that the case breaks."""
    broken = (assumption.broken for assumption in assumptions if assumption.broken)
    return nothing(key, ", ".join(dict.fromkeys((why, *broken))), *assumptions)


def estimate(key: str, text: str) -> Entry:
    """A number without a guarantee."""
    return Entry(key=key, value=text, kind="estimate", quantity=Quantity(PROPERTIES[key]))


def advice(key: str, text: str) -> Entry:
    """A fact for orientation."""
    return Entry(key=key, value=text, kind="advice", quantity=Quantity(PROPERTIES[key]))


COUNTS_ON_DAMPING = (
    "the method is unstable on the imaginary axis, so its limits rely on the damping of the law frozen at theta_hat = theta. "
    "With a different estimate the state obeys A_m - b theta_tilde', which can remove that damping, so runs leave the region of "
    "stability somewhat below the limits"
)


def on_damping(certificate: Certificate) -> Certificate:
    """The certificate, with an explanation of its limits if the method amplifies every undamped oscillation at any step.

    Laws that do not oscillate (laws on the parametric model) have no adaptation frequency, and their limits are on the real axis.
    """
    if certificate.entry("adaptation_frequency") is None:
        return certificate
    entries = tuple(
        replace(entry, quantity=ON_DAMPING[entry.key], assumptions=(*entry.assumptions, COUNTS_ON_DAMPING))
        if entry.key in ON_DAMPING and entry.applies and entry.value is not None
        else entry
        for entry in certificate.entries
    )
    return replace(certificate, entries=entries)


def limits_text(certificate: Certificate) -> str:
    """The numerical limits, if there are any."""
    parts, values = [], certificate.values
    sure = {key: "" if counts_on_damping(certificate, key) else " at least" for key in ON_DAMPING}
    if values.get("gamma_max") is not None:
        beyond = values.get("gamma_max_at_model")
        text = f"the solver at its step tolerates Gamma up to{sure['gamma_max']} {values['gamma_max']:.3g}"
        parts.append(text if beyond is None else f"{text}, and oscillations start near {beyond:.3g}")
    if values.get("step_max") is not None:
        parts.append(f"this gain tolerates a step up to{sure['step_max']} {values['step_max']:.3g} s")
    if not all(sure.values()):
        parts.append("these limits rely on damping that the motion can remove")
    return "; ".join(parts) or "no limit on the step is known"


def counts_on_damping(certificate: Certificate, key: str) -> bool:
    """Whether a limit belongs to a method that amplifies every undamped oscillation."""
    entry = certificate.entry(key)
    return entry is not None and entry.quantity == ON_DAMPING[key]


def margins_cell(certificate: Certificate) -> Entry:
    """Delay margins at the theta of the case and over the known set; exact if all displayed values are exact."""
    parts = []
    margin, over_set, adapting = (
        certificate.entry(key) for key in ("delay_margin", "margins_over_known_set", "delay_margin_adapting")
    )
    if margin is not None and margin.applies:
        value = "unlimited" if margin.value is None else f"{margin.value:.4g} s"
        parts.append(f"delay margin {value} ({margin.of})")
    for loop in () if over_set is None or not over_set.applies else over_set.value:
        over, name = loop.get("over", "the known set"), loop["loop"]
        if "unstable_at" in loop:
            parts.append(f"unstable for part of {over} ({name})")
        elif "delay_margin" in loop:
            parts.append(f"{loop['delay_margin']['value']:.4g} s or more over {over}, as far as found ({name})")
    if adapting is not None and adapting.value is not None:
        parts.append(f"{adapting.value:.3g} s with the law linearised at the largest command")
    each = certificate.entry("delay_margin_each")
    if not parts and each is not None and each.applies:
        delays = ", ".join("unlimited" if value is None else f"{value:.4g} s" for value in each.value)
        text = f"delay margin of each input separately: {delays} ({each.of})"
        return Entry(key="margins", value=text, kind=each.kind, quantity=Quantity(PROPERTIES["margins"]), of=each.of)
    if not parts:
        return nothing("margins", "no linear loop is known")
    only_exact = margin is not None and margin.kind == "exact" and len(parts) == 1
    return Entry(
        key="margins",
        value="; ".join(parts),
        kind="exact" if only_exact else "estimate",
        quantity=Quantity(PROPERTIES["margins"]),
        of=margin.of if only_exact and margin is not None else "",
    )
