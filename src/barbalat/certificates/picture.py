"""The loops whose margins a certificate gives, and their picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barbalat.linear.crossings import Crossings, frequency_grid
from barbalat.linear.margins import Margins, margins
from barbalat.linear.rotation import phase_crossings
from barbalat.linear.systems import StateSpace
from barbalat.validate import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from barbalat.pictures.frequency import Response

POINTS = 1500
"""Frequencies of a drawn response, evenly apart in logarithm; resonances and crossings are added."""


@dataclass(frozen=True)
class MarginLoop:
    """A linear loop e^(-s delay) L(s), stable when closed, with the name under which its margins are printed."""

    name: str
    system: StateSpace
    delay: float = 0.0


def figure_of(loops: Sequence[MarginLoop], title: str, *, narrow: bool = False) -> Figure:
    """Bode, Nyquist and sensitivity pictures of the loops."""
    from barbalat.pictures.frequency import draw

    return draw([response(loop) for loop in loops], title, narrow=narrow, shown=True)


def response(loop: MarginLoop) -> Response:
    """What is drawn of one loop: around its crossings, some decades to either side."""
    from barbalat.pictures.frequency import Response

    found, crossings = margins(loop.system, loop.delay), Crossings(loop.system)
    crossovers = np.array(found.crossovers)
    real = phase_crossings(crossings, loop.delay, crossovers) if loop.delay > 0 else np.array(crossings.of_real_axis())

    def at(w: Array) -> Array:
        return np.asarray(loop.system.response(w) * np.exp(-1j * w * loop.delay))

    at_phase = float(crossovers[np.abs(np.angle(-at(crossovers))).argmin()]) if len(crossovers) else None
    at_gain = float(real[np.abs(1 + found.gain_up * at(real)).argmin()]) if len(real) and np.isfinite(found.gain_up) else None
    marked = [w for w in (at_phase, at_gain) if w is not None]
    own = frequency_grid(loop.system)
    low, high = (min(marked) / 300, max(marked) * 100) if marked else (own.min(), own.max())
    within = own[(own > low) & (own < high)]
    w = np.unique(np.concatenate([np.geomspace(low, high, POINTS), within, marked]))
    return Response(w=w, L=at(w), caption=f"{loop.name}: {_caption(found)}", at_phase=at_phase, at_gain=at_gain)


def _caption(found: Margins) -> str:
    up = f"gain margin × {found.gain_up:.4g}" if np.isfinite(found.gain_up) else "no gain that is too high"
    down = f", down to × {found.gain_down:.4g}" if found.gain_down > 0 else ""
    phase = f"phase margin {np.degrees(found.phase):.4g}°" if np.isfinite(found.phase) else "any phase"
    delay = f"delay margin {found.delay:.4g} s" if np.isfinite(found.delay) else "any delay"
    return f"{up}{down}; {phase}; {delay}"
