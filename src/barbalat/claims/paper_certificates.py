"""The certificates of Section V, with and without its modelling error."""

from __future__ import annotations

from barbalat.certificates.certify import certify_where_possible
from barbalat.certificates.overview import Certified, certified_case
from barbalat.claims.section_v import Runs


def certified_paper(runs: Runs) -> Certified:
    """The schemes as in the figures: one column of Table 1 for each, and L1-AC at the finer step besides."""
    shown = [runs.coarse[name] for name in ("MRAC", "Robust MRAC, no auxiliary input", "L1", "Robust MRAC")]
    problem, simulation = shown[0].problem, shown[0].simulation
    coarse = certified_case(problem, [result.controller for result in shown], simulation)
    certificates = {f"{name}, h = {simulation.dt:g} s": found for name, found in coarse.certificates.items()}
    for name in ("L1, gamma 1e4", "L1, gamma 1e6"):
        fine = runs.fine[name]
        (found,) = certify_where_possible(problem, [fine.controller], fine.simulation).values()
        certificates[f"{name}, h = {fine.simulation.dt:g} s"] = found
    return Certified(certificates, coarse.table)
