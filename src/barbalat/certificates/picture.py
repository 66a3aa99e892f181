"""The loops whose margins a certificate gives, and their plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from barbalat.linear.crossings import Crossings, frequency_grid
from barbalat.linear.margins import Margins, margins
from barbalat.linear.rotation import phase_crossings
from barbalat.linear.systems import StateSpace
from barbalat.pictures.palette import COLOURS
from barbalat.pictures.response import Response
from barbalat.validate import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from barbalat.certificates.certificate import Certificate

TITLE = "Loops broken at the plant's input"
LONGEST_NAME = 60
"""Largest number of characters of a certificate's name in a caption."""
POINTS = 1500
"""Frequencies of a plotted response, logarithmically spaced; resonances and crossings are added."""


@dataclass(frozen=True)
class MarginLoop:
    """A linear loop e^(-s delay) L(s), stable when closed, with the name under which its margins are printed."""

    name: str
    system: StateSpace
    delay: float = 0.0

    def at(self, w: Array) -> Array:
        """The response at frequencies (K,) [rad/s]."""
        return np.asarray(self.system.response(w) * np.exp(-1j * w * self.delay))


def figure_of(loops: Sequence[MarginLoop], title: str, *, narrow: bool = False, shown: bool = True) -> Figure:
    """Bode, Nyquist and sensitivity plots of the loops; ``shown`` displays them at once if pyplot is in use."""
    from barbalat.pictures.frequency import draw

    return draw(responses_of(loops), title, narrow=narrow, shown=shown)


def responses_of(loops: Sequence[MarginLoop]) -> list[Response]:
    """The plotted responses of loops, over frequencies that show the margins of all."""
    found = [Marked.of(loop) for loop in loops]
    span = min(one.span[0] for one in found), max(one.span[1] for one in found)
    return [one.response(*span) for one in found]


def distinct(certificates: Mapping[str, Certificate]) -> list[MarginLoop]:
    """The distinct loops of the certificates, each with the names of all certificates that contain it."""
    owners: dict[tuple[StateSpace, float], tuple[list[str], str]] = {}
    for name, certificate in certificates.items():
        short = shorten(name, LONGEST_NAME, placeholder="…")
        for loop in certificate.loops:
            owners.setdefault((loop.system, loop.delay), ([], loop.name))[0].append(short)
    return [
        MarginLoop(f"{'; '.join(dict.fromkeys(names))}: {said}", system, delay)
        for (system, delay), (names, said) in owners.items()
    ]


def grouped(loops: Sequence[MarginLoop]) -> list[Sequence[MarginLoop]]:
    """The loops in groups, each with as many loops as there are colours."""
    return [loops[i : i + len(COLOURS)] for i in range(0, len(loops), len(COLOURS))]


@dataclass(frozen=True, eq=False)
class Marked:
    """A loop, its margins, and the frequencies [rad/s] of the phase and the gain margin; ``None`` for a margin that does not
    exist."""

    loop: MarginLoop
    margins: Margins
    at_phase: float | None
    at_gain: float | None

    @classmethod
    def of(cls, loop: MarginLoop) -> Marked:
        found, crossings = margins(loop.system, loop.delay), Crossings(loop.system)
        crossovers = np.array(found.crossovers)
        real = phase_crossings(crossings, loop.delay, crossovers) if loop.delay > 0 else np.array(crossings.of_real_axis())
        at_phase = float(crossovers[np.abs(np.angle(-loop.at(crossovers))).argmin()]) if len(crossovers) else None
        has_gain = len(real) > 0 and np.isfinite(found.gain_up)
        at_gain = float(real[np.abs(1 + found.gain_up * loop.at(real)).argmin()]) if has_gain else None
        return cls(loop, found, at_phase, at_gain)

    @property
    def marks(self) -> list[float]:
        return [w for w in (self.at_phase, self.at_gain) if w is not None]

    @property
    def span(self) -> tuple[float, float]:
        """A range of some decades around the marked frequencies."""
        if self.marks:
            return min(self.marks) / 300, max(self.marks) * 100
        own = frequency_grid(self.loop.system)
        return float(own.min()), float(own.max())

    def response(self, low: float, high: float) -> Response:
        """The plotted response from ``low`` to ``high`` [rad/s]."""
        own = frequency_grid(self.loop.system)
        within = own[(own > low) & (own < high)]
        w = np.unique(np.concatenate([np.geomspace(low, high, POINTS), within, self.marks]))
        caption = f"{self.loop.name.replace('theta', 'θ')}: {_caption(self.margins)}"
        return Response(w=w, L=self.loop.at(w), caption=caption, at_phase=self.at_phase, at_gain=self.at_gain)


def _caption(found: Margins) -> str:
    up = f"gain margin × {found.gain_up:.4g}" if np.isfinite(found.gain_up) else "gain margin unlimited"
    down = f", down to × {found.gain_down:.4g}" if found.gain_down > 0 else ""
    phase = f"phase margin {np.degrees(found.phase):.4g}°" if np.isfinite(found.phase) else "any phase"
    delay = f"delay margin {found.delay:.4g}\u00a0s" if np.isfinite(found.delay) else "any delay"
    return f"{up}{down}; {phase}; {delay}"
