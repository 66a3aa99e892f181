"""For every scheme, the guarantee has a caveat if a run violates its certificate because of the step."""

import numpy as np
import pytest

from barbalat import (
    KnownParameters,
    LinearFeedback,
    LinearOutput,
    MracClosedLoop,
    MracOutput,
    OutputPlant,
    OutputProblem,
    OutputReferenceModel,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    TransferFunction,
    simulate,
)
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.laws import LyapunovLaw
from barbalat.plants import PlantInput
from barbalat.regressors import Terms
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation

COARSE, FINE = Simulation(t_end=2.0, dt=0.02), Simulation(t_end=2.0, dt=1e-7)
BOX = ParameterBox([-3.0, -3.0], [3.0, 3.0])


def problem(*, phi=None, A_m=((0.0, 1.0), (-2.0, -2.0)), b=(0.0, 1.0), path=None):
    regressor = {} if phi is None else {"regressor": Terms(terms=phi)}
    plant = Plant(A_m=A_m, b=b, theta=[1.5, -1.0], input=path, **regressor)
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Sine(1.3, 0.9), uncertainty=BOX)


OUTPUT = OutputProblem(
    plant=OutputPlant(transfer_function=TransferFunction([2.0], [1.0, 1.0])),
    reference_model=OutputReferenceModel(transfer_function=TransferFunction([3.0], [1.0, 3.0])),
    reference=Sine(1.3, 0.9),
)
FAST = problem(A_m=((-200.0, 0.0), (0.0, -1.0)), b=(1.0, 1.0))
LEAVING = {
    "no limit known": (problem(phi=("sin(x1)", "x2")), MracClosedLoop(1e6, model_feedback=-np.eye(2)), True),
    "fast linear loop": (OUTPUT, LinearOutput(loop=TransferFunction([2000.0], [1.0, 200.0])), False),
    "cells alone": (FAST, KnownParameters(theta=[1.5, -1.0]), False),
    "for every bounded r": (OUTPUT, MracOutput(order=1, relative_degree=1, sign=1, law=LyapunovLaw(gamma=1e5)), False),
}


def guaranteed_and_notes(given, controller, simulation):
    certificates = certify(given, controller, simulation)
    (certificate,) = certificates.values()
    (column,) = table_1(given, (controller,), certificates).columns
    cells = [key for key, cell in column.cells.items() if cell.kind == "guaranteed"]
    return certificate.guaranteed, cells, [note for note in certificate.notes if "a run" in note and "may deviate" in note]


@pytest.mark.parametrize("name", LEAVING)
def test_a_run_that_leaves_what_is_guaranteed_has_the_caveat(name):
    """Each run exceeds its bound or diverges at this step. At a step within the solver's limit there is no caveat."""
    given, controller, unknown = LEAVING[name]
    (run,) = simulate(given, controller, COARSE).values()
    entries, cells, notes = guaranteed_and_notes(given, controller, COARSE)
    assert cells or entries
    assert len(notes) == 1
    bound = certify(given, controller, COARSE)[controller.name].values.get("error_bound")
    assert run.diverged_at is not None or np.abs(run.e).max() > bound
    assert ("no limit on the step is known" in notes[0]) == unknown
    assert bool(guaranteed_and_notes(given, controller, FINE)[2]) == unknown


def test_norms_alone_need_no_caveat():
    """A linear controller without a bound on e guarantees norms, which no run contradicts. The step of its run nevertheless has a
    limit."""
    controller = LinearFeedback(TransferFunction([50.0], [1.0, 500.0]), output=[1.0, 1.0])
    given = problem(path=PlantInput(delay=0.02))
    entries, cells, notes = guaranteed_and_notes(given, controller, COARSE)
    assert "norms" in entries and not cells and not notes
    limit = certify(given, controller, COARSE)[controller.name].values["step_max"]
    assert limit == pytest.approx(2.7852935634 / 500, rel=0.01)  # RK4's limit on the real axis, for the controller's pole
