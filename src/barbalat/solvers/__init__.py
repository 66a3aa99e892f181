"""The registry of fixed-step solvers, by the name that case files use. The contract tests run over it."""

from barbalat.solvers.tableau import EULER, HEUN, RK4, Tableau

SOLVERS = {tableau.name: tableau for tableau in (EULER, HEUN, RK4)}

__all__ = ["EULER", "HEUN", "RK4", "SOLVERS", "Tableau"]
