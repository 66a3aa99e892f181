"""The screen of an identification."""

from __future__ import annotations

import numpy as np

from barbalat.identify.case_text import point_text
from barbalat.identify.result import CONFIDENCE, Identification
from barbalat.pictures.symbols import number_text
from barbalat.report.terminal.layout import Screen


def rows(found: Identification) -> list[list[str]]:
    """Return rows of state, coefficient, nominal value, confidence interval and known set."""
    told = []
    for row in found.rows:
        for j, name in enumerate(found.coefficient_names):
            interval = "given" if row.interval is None else _interval(*row.interval[j])
            known = "" if row.enclosure is None else _interval(row.enclosure.lower[j], row.enclosure.upper[j])
            told.append([f"{row.state}'", name, number_text(float(row.nominal[j])), interval, known])
    return told


def residual_rows(found: Identification) -> list[list[str]]:
    """Return rows of state, fit, RMS and largest residual."""
    told = []
    for (name, fit), values in zip(found.fit.items(), found.residuals.T, strict=True):
        sizes = (
            ["diverged"] * 3
            if fit is None
            else [f"{100 * fit:.1f} %", f"{np.sqrt(np.mean(values**2)):.3g}", f"{np.abs(values).max():.3g}"]
        )
        told.append([name, *sizes])
    return told


def sentence(found: Identification) -> str:
    """Return a sentence on how well the nominal plant fits the validation samples."""
    fits = ", ".join(f"{name} {'diverged' if fit is None else f'{100 * fit:.1f} %'}" for name, fit in found.fit.items())
    apart = found.trained < len(found.recording.times)
    where = "the validation samples" if apart else "the same samples, since there are no validation samples"
    if found.horizon is None:
        return f"Simulated over {where}, the nominal plant fits {fits}."
    held = ", ".join(f"{name} {100 * fit:.1f} %" for name, fit in (found.held_fit or {}).items())
    return (
        f"Over {where}, the nominal plant predicts up to {found.horizon:.3g} s ahead and fits {fits}; holding the measured "
        f"state constant for as long fits {held}. The plant is unstable: a longer simulation would amplify the error of its "
        f"initial state."
    )


def equation(found: Identification) -> str:
    """Return the equation of the printed coefficients. With an offset, its constants apply at the means of the samples."""
    return "x' = A x + B u" if found.reference is None else "x' = A (x - mean) + B (u - mean) + constant"


def operating(found: Identification) -> str:
    """Return sentences on the dead time, the means and the operating point, or an empty text if there are none."""
    said = [f"The inputs arrive after a dead time of {found.delay:g} s."] if found.delay else []
    if found.means is not None:
        said.append(f"The means are {point_text(found.means)}.")
        point = found.operating_point
        said.append(
            "The plant has a constant drift and no equilibrium."
            if point is None
            else f"The plant describes deviations from the operating point {point_text(point)}."
        )
    return " ".join(said)


def caption(found: Identification) -> str:
    """Return a sentence on how the simulation in the picture begins, and when it restarts from the measurement."""
    if found.horizon is None:
        return "The simulation begins at the state that fits these samples best and is not corrected by them later."
    every = "every sample" if found.restarted == 1 else f"every {found.restarted} samples ({found.horizon:.3g} s)"
    return f"The simulation restarts from the measured state {every}."


def _interval(low: float, high: float) -> str:
    return f"{low:.6g} to {high:.6g}" if np.isfinite([low, high]).all() else "not bounded"


def show(screen: Screen, found: Identification) -> None:
    """Print the table, the evidence and the findings."""
    count = len(found.recording.times)
    screen.title(f"{equation(found)} from {found.trained} of {count} samples")
    known = [] if found.noise is None else ["known set"]
    width = 4 + len(known)
    headings = ["row of", "coefficient", "nominal", f"{100 * CONFIDENCE:.0f} % interval", *known]
    screen.table(headings, [row[:width] for row in rows(found)], leads=2)
    if found.guaranteed:
        screen.line("The known set contains every plant that explains these samples within the stated noise and slope.")
    if said := operating(found):
        screen.line(said)
    screen.line(sentence(found))
    for said in found.findings:
        screen.line(f"{said[0].upper()}{said[1:]}.", start="- ")
