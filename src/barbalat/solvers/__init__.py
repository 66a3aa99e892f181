"""The registry of fixed-step solvers, by the name that case files use. The contract tests run over it."""

from barbalat.solvers.tableau import EULER as EULER
from barbalat.solvers.tableau import HEUN as HEUN
from barbalat.solvers.tableau import RK4 as RK4
from barbalat.solvers.tableau import Tableau as Tableau

SOLVERS = {tableau.name: tableau for tableau in (EULER, HEUN, RK4)}
