"""The robust MRAC with eq. (14) as the paper prints it, to show what the erratum costs: see ``controllers.robust_mrac``."""

from __future__ import annotations

from dataclasses import dataclass

from barbalat.controllers.parametric_model import State
from barbalat.controllers.robust_mrac import Equations, RobustMrac
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value


@dataclass(frozen=True, eq=False, kw_only=True)
class AsPrinted(Equations):
    """The equations with the sign of W_c0 that the paper prints."""

    def auxiliary_input_argument(self, state: State, x: Value) -> Value:
        estimation = self.estimation(state, x)
        return estimation.epsilon * estimation.m_s_squared - self.c_0 @ state.swapping


@dataclass(frozen=True, eq=False, kw_only=True)
class PrintedSign:
    """A robust MRAC, with the sign as printed."""

    controller: RobustMrac

    @property
    def name(self) -> str:
        return self.controller.name

    def bind(self, known: Known) -> AsPrinted:
        return AsPrinted(**vars(self.controller.bind(known)))
