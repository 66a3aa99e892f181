"""A small problem with a measured output and its L1-AC; each test changes the part that it examines."""

from barbalat.controllers.output.l1 import L1Output
from barbalat.linear.systems import TransferFunction
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation

TF = TransferFunction
SIMULATION = Simulation(t_end=20.0, dt=2e-3)


def problem(plant=None, m=3.0, **settings):
    plant = plant or OutputPlant(transfer_function=TF([2.0], [1.0, 1.0]))
    model = OutputReferenceModel(transfer_function=TF([m], [1.0, m]))
    return OutputProblem(plant=plant, reference_model=model, **({"reference": Sine(1.0, 1.3)} | settings))


def l1(**settings):
    return L1Output(**({"m": 3.0, "gamma": 1e3, "filter": TF([30.0], [1.0, 30.0]), "sigma_bound": 100.0} | settings))
