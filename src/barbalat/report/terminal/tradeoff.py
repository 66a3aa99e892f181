"""What ``barbalat tradeoff`` shows: the delays borne at equal error."""

from __future__ import annotations

from barbalat.comparison.tradeoff.tradeoff import TradeOff
from barbalat.pictures.symbols import held
from barbalat.report import tradeoff
from barbalat.report.terminal.layout import Screen


def show(screen: Screen, found: TradeOff) -> None:
    """A table, the order of the schemes, and what was left out."""
    schemes = [cloud.scheme for cloud in found.clouds]
    screen.line(f"{found.problem.name}: the delay [s] that the plant's input bears", "bold")
    screen.line(
        "Each scheme's best tuning with a relative error, RMS |e| / RMS |x_m|, of at most ...: until the loop begins to "
        "oscillate (onset), and until it is lost (loss)."
    )
    headings = ("error", *(f"{criterion}:\n{scheme}" for criterion in ("onset", "loss") for scheme in schemes))
    screen.table(headings, tradeoff.at_equal_error(found, "plant"))
    head, parts = tradeoff.orders(found, "plant")
    screen.title(head, "")
    for part in parts:
        for scheme in schemes:
            part = part.replace(scheme, held(scheme))  # noqa: PLW2901
        screen.line(part, indent="    ", start="  ")
    for sentence in found.notes:
        screen.line(f"Note: {sentence}.", "yellow", "  ")
