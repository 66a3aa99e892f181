"""The certificates of Section V, with and without its modelling error."""

from __future__ import annotations

from barbalat.certificates.certify import Certified, certified_case, certify_where_possible
from barbalat.papers.jafari_2013 import section_v
from barbalat.solvers.simulation import Simulation


def certified_paper() -> Certified:
    """The schemes as in the figures: one column of Table 1 for each, and L1-AC at the finer step besides."""
    problem = section_v.problem()
    coarse, fine = (Simulation(t_end=section_v.T_END, dt=dt) for dt in (section_v.COARSE_STEP, section_v.FINE_STEP))
    named = {controller.name: controller for controller in section_v.coarse_controllers() + section_v.fine_controllers()}
    shown = [named[name] for name in ("MRAC", "Robust MRAC, no auxiliary input", "L1", "Robust MRAC")]
    found = certified_case(problem, shown, coarse)
    certificates = {f"{name}, h = {coarse.dt:g} s": certificate for name, certificate in found.certificates.items()}
    at_fine = certify_where_possible(problem, [named[name] for name in ("L1, gamma 1e4", "L1, gamma 1e6")], fine)
    return Certified(certificates | {f"{name}, h = {fine.dt:g} s": one for name, one in at_fine.items()}, found.table)
