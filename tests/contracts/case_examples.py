"""A case file's table for each registered signal, regressor and law. A registered class without a table fails its contract."""

from adaptation.examples import LAW_EXAMPLES

SIGNALS = {
    "constant": {"amplitude": 3.0},
    "step": {"amplitude": 1.0, "start": 5.0, "constant": 0.5},
    "steps": {"times": [1.0, 2.0], "values": [3.0, 4.0], "initial": 1.0},
    "sine": {"amplitude": 50.0, "frequency": 0.5, "phase": 0.1, "constant": 2.0},
    "sines": {"amplitudes": [1.0, 2.0], "frequencies": [0.5, 3.0], "phases": [0.1, 0.2], "constant": 0.5},
    "square": {"amplitude": 1.0, "frequency": 2.0, "phase": 0.1, "constant": 0.5},
    "chirp": {"amplitude": 1.0, "frequency_start": 0.1, "frequency_end": 5.0, "duration": 10.0, "constant": 0.5},
    "csv": {"file": "r.csv"},
    "mat": {"file": "r.mat"},
}
CSV = "t,r\n0,2\n1,3\n"
"""The contents of that file."""

REGRESSORS = {
    "polynomial": {"degree": 1, "constant": False},
    "gaussian": {"centers": [[0.0, 1.0], [1.0, 0.0]], "width": 2.0},
    "terms": {"terms": ["x1", "abs(x1)*x2"]},
}
"""Regressors, each with two components for two states."""

LAWS = {"lyapunov": {"gamma": 2.0}} | {name: example.numbers for name, example in LAW_EXAMPLES.items()}
LAWS |= {"gradient": {"gamma": [1.0, 2.0]}, "integral-cost": {"gamma": [[2.0, 1.0], [1.0, 2.0]], "forgetting": 0.4}}
"""Laws, some of them with a diagonal or a matrix as gain."""
