"""Cases that use many keys together, which the separate tests of single keys do not cover."""

from __future__ import annotations

import numpy as np

from barbalat.cases.load import parse_case
from barbalat.run.engine.simulate import simulate

EVERYTHING = """
name = "everything"
[plant]
A = [[0.0, 1.0, 0.0], [2.0, -1.0, 1.0], [0.0, 0.0, -3.0]]
b = [0.0, 1.0, 0.5]
x0 = [0.2, 0.0, 0.0]
[plant.input]
delay = 0.01
quantization = 0.001
saturation = [-30.0, 30.0]
rate_limit = 300.0
gain = 0.9
actuator = { num = [2500.0], den = [1.0, 100.0, 2500.0] }
[plant.disturbance]
kind = "sine"
amplitude = 0.1
frequency = 3.0
[[plant.unmatched]]
direction = [0.0, 0.0, 0.1]
signal = { kind = "step", amplitude = 1.0, start = 3.0 }
[sensor]
lag = 0.002
noise = { std = [0.001, 0.002, 0.001], sample_time = 0.005, seed = 7 }
[reference_model]
poles = [[-2.0, 1.0], -4.0]
k_0 = 3.0
[reference]
kind = "square"
amplitude = 1.0
frequency = 0.4
[uncertainty]
lower = [-20.0, -20.0, -20.0]
upper = [20.0, 20.0, 20.0]
[simulation]
t_end = 10.0
dt = 1e-3
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = [5.0, 10.0, 5.0]
modified_error = { mu = 1.0, margin = 0.1 }
[[controller]]
name = "L1 sampled"
scheme = "l1"
gamma = 1e5
filter = { kappa = 0.05 }
saturated_predictor = true
sample_time = 0.005
[[controller]]
name = "LS with resetting"
scheme = "robust-mrac"
tau = 0.3
law = { kind = "least-squares-resetting", rho_0 = 50.0, rho_1 = 0.1 }
normalization = { alpha_0 = 0.1, delta_0 = 0.5 }
[[controller]]
name = "PI"
scheme = "linear"
design = "pi"
unmodelled_delay = 0.02
"""

OUTPUT = """
name = "output"
[plant]
transfer_function = { num = [2.0], den = [1.0, 1.0] }
nonlinear = "0.3*sin(y)"
input = { delay = 0.01, saturation = [-20.0, 20.0], actuator = { num = [2500.0], den = [1.0, 100.0, 2500.0] } }
[plant.disturbance]
kind = "step"
amplitude = 0.5
start = 3.0
[sensor]
lag = 0.002
noise = { std = 0.001, sample_time = 0.005 }
[reference_model]
transfer_function = { num = [3.0], den = [1.0, 3.0] }
[reference]
kind = "square"
amplitude = 1.0
frequency = 0.5
[simulation]
t_end = 10.0
dt = 1e-3
[[controller]]
name = "MRAC"
scheme = "mrac-output"
order = 1
relative_degree = 1
sign = 1
law = { kind = "lyapunov", gamma = 1.0, sigma = 0.1 }
sample_time = 0.005
discretization = "euler"
[[controller]]
name = "L1"
scheme = "l1-output"
m = 3.0
gamma = 1e3
filter = { num = [30.0], den = [1.0, 30.0] }
sigma_bound = 20.0
lipschitz = 0.3
[[controller]]
name = "PI"
scheme = "linear"
design = "pi"
unmodelled_delay = 0.03
"""


def test_every_key_of_a_state_feedback_case_at_once():
    case = parse_case(EVERYTHING)
    for name, run in simulate(case.problem, case.controllers, case.simulation).items():
        assert run.diverged_at is None, name
        assert np.isfinite(run.x).all()
        passed = np.array([run.loop.unpack(s).input[0].limited[0] for s in run.states])
        assert np.abs(passed).max() <= 30.0
    assert case.controllers[1].sample_time == 0.005


def test_every_key_of_an_output_feedback_case_at_once():
    case = parse_case(OUTPUT)
    for name, run in simulate(case.problem, case.controllers, case.simulation).items():
        assert run.diverged_at is None, name
        assert run.figures["tail_max_abs_e"][0] < 1.5
