"""The cost per state of a step of an output-feedback loop, compared with a similar state-feedback loop in one run."""

from __future__ import annotations

from barbalat.adaptation.laws import LeastSquares
from barbalat.adaptation.lyapunov import LyapunovLaw
from barbalat.controllers import L1Adaptive, Mrac, RobustMrac
from barbalat.controllers.output import L1Output, MracOutput
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.problem.plant import Plant
from barbalat.problem.state_feedback import Problem
from barbalat.signals import Sine
from benchmarks.inputs import STEPS, advance
from benchmarks.race import Contestant, race
from benchmarks.table import Row

COMMAND = Sine(amplitude=1.0, frequency=1.0)
FIRST_ORDER = Problem(
    plant=Plant(A_m=[[-3.0]], b=[2.0], theta=[1.0]), reference=COMMAND, uncertainty=ParameterBox(lower=[-3.0], upper=[3.0])
)
THIRD_ORDER = Problem(
    plant=Plant(A_m=[[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-6.0, -11.0, -6.0]], b=[0.0, 0.0, 1.0], theta=[1.0, -0.5, 0.3]),
    reference=COMMAND,
    uncertainty=ParameterBox(lower=[-3.0] * 3, upper=[3.0] * 3),
)


def _output(num: list[float], den: list[float], model: list[float]) -> OutputProblem:
    return OutputProblem(
        plant=OutputPlant(transfer_function=TransferFunction(num, den)),
        reference_model=OutputReferenceModel(transfer_function=TransferFunction([model[-1]], model)),
        reference=COMMAND,
    )


FIRST, THIRD = _output([2.0], [1.0, 1.0], [1.0, 3.0]), _output([1.5], [1.0, 2.0, 2.0, 0.5], [1.0, 3.0, 3.5, 1.5])
L1 = L1Output(m=3.0, gamma=1e3, filter=TransferFunction([30.0], [1.0, 30.0]), sigma_bound=100.0)
LAW = LeastSquares(covariance0=50.0)
CLASSICAL = MracOutput(order=1, relative_degree=1, sign=1, law=LyapunovLaw(gamma=1.0))
ROBUST = MracOutput(order=3, relative_degree=3, sign=1, law=LAW, tau=0.5, c_0_min=0.1)
PAIRS = {
    "L1-AC": ((FIRST, L1), (FIRST_ORDER, L1Adaptive(gamma=1e3, filter=input_filter(1 / 30)))),
    "MRAC": ((FIRST, CLASSICAL), (FIRST_ORDER, Mrac(gamma=10.0))),
    "robust MRAC, n = 3": ((THIRD, ROBUST), (THIRD_ORDER, RobustMrac(tau=0.5, law=LAW))),
}


def per_state(members: int, *, quick: bool) -> tuple[list[Row], list[str]]:
    """One row for each scheme, with the nanoseconds per step and state relative to the state-feedback loop."""
    rows = []
    for name, pair in PAIRS.items():
        (ours, n_ours), (theirs, n_theirs) = (advance(problem, controller, members) for problem, controller in pair)
        times = race([Contestant("output", STEPS, ours), Contestant("state", STEPS, theirs)], members, 3 if quick else 9)
        each = [times["output"].best / n_ours, times["state"].best / n_theirs]
        output, state = (f"{times[which].best:.3g} ns, {n} states" for which, n in (("output", n_ours), ("state", n_theirs)))
        rows.append(Row(f"{name}, {members} at once", output, state, each[0] / each[1], at_most=1.0))
    return rows, []
