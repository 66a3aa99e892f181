"""Bounds on continuous linear loops for all commands and disturbances of given sizes, attacked by the worst signals of loops
that are written down here, and by runs."""

from __future__ import annotations

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import barbalat_check
from barbalat import (
    Adrc,
    BaselineAlone,
    KnownParameters,
    LinearFeedback,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    TransferFunction,
    certify,
    simulate,
)
from barbalat.certificates.certificates import table_1
from barbalat.certificates.proof import proof
from barbalat.certificates.schemes.bounded_response import OF_CONTINUOUS_LOOPS
from barbalat.plants import Disturbance, KalmanObserver, LqiBaseline, LuenbergerObserver, Noise, PlantInput, Sensor
from barbalat.regressors import Terms
from barbalat.signals import Constant, Sine, Sines, Square, Steps

A_M, B, THETA, K_0 = np.array([[0.0, 1.0], [-2.0, -2.0]]), np.array([0.2, 1.0]), np.array([0.6, -0.4]), 2.0
ACROSS, POLE, GAIN, LAG = np.array([1.0, -0.5]), 20.0, 0.8, 0.02
R, D, D_ACROSS = 0.5, 0.3, 0.2
KNOWN, NOMINAL, C = np.array([0.4, -0.3]), np.array([0.2, 0.1]), np.array([1.0, 0.5])
CONTROLLERS = {
    "known": KnownParameters(theta=KNOWN),
    "linear": LinearFeedback(controller=TransferFunction([2.0, 3.0], [1.0, 5.0]), output=C, nominal=NOMINAL),
    "adrc": Adrc(bandwidth=8.0),
}
SIMULATION = Simulation(t_end=12.0, dt=0.0025)


def problem_of(*, x0=(0.0, 0.0), bare=False, path=None, **fields):
    """A plant with an actuator, a sensor's lag and two disturbances; with ``bare``, without them."""
    beside = {
        "disturbance": Square(amplitude=D, frequency=1.0),
        "unmatched": (Disturbance(ACROSS, Sine(amplitude=D_ACROSS, frequency=2.0)),),
        "sensor": Sensor(lag=LAG),
    }
    actuator = PlantInput() if bare else PlantInput(gain=GAIN, actuator=TransferFunction([POLE], [1.0, POLE]))
    return Problem(
        plant=Plant(A_m=A_M, b=B, theta=THETA, x0=x0, input=path or actuator),
        reference_model=ReferenceModel(k_0=K_0),
        uncertainty=ParameterBox(lower=[-1, -1], upper=[1, 1]),
        **{"reference": Square(amplitude=R, frequency=0.7)} | ({} if bare else beside) | fields,
    )


def certified(problem, controller):
    found = certify(problem, [controller], SIMULATION)
    return found[controller.name], table_1(problem, [controller], found).columns[0]


def written_down(name):
    """(A, B, C of e, x and u, D of u) of the loop with z = (x, x_m, y, v, K's state), where y is the sensor, v the actuator."""
    A, W = np.zeros((8, 8)), np.zeros((8, 3))
    x, m, y, v, k = slice(0, 2), slice(2, 4), slice(4, 6), 6, 7
    A[x, x], A[x, v], W[x, 1], W[x, 2] = A_M + np.outer(B, THETA), B, B, ACROSS
    A[m, m], W[m, 0] = A_M, K_0 * B
    A[y, x], A[y, y] = np.eye(2) / LAG, -np.eye(2) / LAG
    of_u = np.zeros(8)
    A[k, k] = -5.0
    if name == "known":
        of_u[y] = -KNOWN
    else:  # (2 s + 3)/(s + 5) = 2 - 7/(s + 5)
        of_u[y], of_u[m], of_u[k] = -NOMINAL - 2 * C, 2 * C, -7.0
        A[k, m], A[k, y] = C, -C
    A[v], A[v, v], W[v, 0] = POLE * GAIN * of_u, POLE * GAIN * of_u[v] - POLE, POLE * GAIN * K_0
    e, unit = np.zeros((2, 8)), np.eye(8)
    e[:, x], e[:, m] = np.eye(2), -np.eye(2)
    rows = {"error_bound": e, "state_bound": unit[x], "control_bound": of_u[None]}
    return A, W, rows, {"control_bound": np.array([[K_0, 0.0, 0.0]])}


def worst(name, key, x0, t_end, dt=5e-4):
    """The largest |output| at t_end of a simulation in which every signal has the sign of its impulse response, in both signs."""
    A, W, rows, passes = written_down(name)
    of_step = expm(np.block([[A, W], [np.zeros((3, 11))]]) * dt)
    step, push = of_step[:8, :8], of_step[:8, 8:]
    C_, found, sizes, steps = rows[key], [], np.array([R, D, D_ACROSS]), round(t_end / dt)
    start = np.concatenate([x0, x0, x0, [0.0, 0.0]])
    for i, row in enumerate(C_):
        seen = [row]  # row step^k
        for _ in range(steps - 1):
            seen.append(seen[-1] @ step)
        signs = np.sign(np.array(seen) @ push)[::-1]
        for sign in (-1.0, 1.0):
            z = start.copy()
            for w in sign * signs * sizes:
                z = step @ z + push @ w
            out = row @ z + passes.get(key, np.zeros((2, 3)))[i] @ (sizes * sign * [1.0, 0.0, 0.0])
            found.append(abs(out))
    return max(found)


@pytest.mark.parametrize("key", OF_CONTINUOUS_LOOPS)
@pytest.mark.parametrize("name", ["known", "linear"])
def test_the_worst_signals_attain_them_and_none_exceeds_them(name, key):
    found, column = certified(problem_of(), CONTROLLERS[name])
    bound = found.values[key]
    assert {*OF_CONTINUOUS_LOOPS} <= found.guaranteed and "theta and the input gain are those given in the case" in found.entry(
        key
    ).assumptions
    assert 1 <= bound / worst(name, key, np.zeros(2), 15.0) < 1.002
    assert column.cells["transient"].kind == "guaranteed" and "|e| <=" in column.cells["transient"].text
    x0 = np.array([0.4, -0.6])
    from_x0, _ = certified(problem_of(x0=x0), CONTROLLERS[name])
    reached = max(worst(name, key, x0, t_end) for t_end in (0.05, 0.3, 0.6, 1.0, 1.6, 2.5, 4.0))
    assert reached <= from_x0.values[key] < 1.5 * reached


def drawn_steps(random, size):
    times = np.cumsum(random.uniform(0.01, random.choice([0.1, 2.0]), 400))
    return Steps(times=tuple(times), values=tuple(size * random.choice([-1.0, 1.0], 400)), initial=size * random.choice([-1, 1]))


PLANTS = {
    "an actuator": {},
    "an observer": {"observer": LuenbergerObserver(poles=[-6.0, -7.0], measured=[[1.0, 0.0]]), "sensor": None},
    "a Kalman observer": {"observer": KalmanObserver(Q=[0.0, 1.0], R=1e-3, measured=[[1.0, 0.0]])},
    "limits": {"path": PlantInput(saturation=[-9.0, 9.0])},
}


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(kept=lambda name, plant: (name, plant) in (("adrc", "an actuator"), ("known", "an observer")))
def test_no_run_exceeds_them(name, plant, sample):
    random = np.random.default_rng([len(name), len(plant)])
    for _ in range(sample(2, 6)):
        problem = problem_of(
            x0=random.normal(size=2) * random.choice([0.0, 0.5]),
            **{"reference": drawn_steps(random, R), "disturbance": drawn_steps(random, D)} | PLANTS[plant],
        )
        found, _ = certified(problem, CONTROLLERS[name])
        assert {*OF_CONTINUOUS_LOOPS} <= found.guaranteed
        (run,) = simulate(problem, [CONTROLLERS[name]], SIMULATION).values()
        seen = max(run.figures["max_abs_e"]), np.abs(run.x).max(), run.figures["max_abs_u"]
        for key, one in zip(OF_CONTINUOUS_LOOPS, seen, strict=True):
            assert 0.1 * found.values[key] < one <= found.values[key] * (1 + 1e-6), key


def with_a_baseline(**fields):
    plant = Plant(
        A=[[0.0, 1.0], [1.0, -0.8]],
        b=[0.0, 2.0],
        nominal_A=[[0.0, 1.0], [0.5, -1.0]],
        baseline=LqiBaseline(Q=[1.0, 0.1, 4.0], R=1.0, output=[1.0, 0.0]),
        input=PlantInput(actuator=TransferFunction([30.0], [1.0, 30.0])),
    )
    beside = {"disturbance": Square(amplitude=D, frequency=1.0), "unmatched": (Disturbance([0.3, 0.1], Constant(0.2)),)}
    return Problem(plant=plant, reference=Square(amplitude=R, frequency=0.2), **beside | fields)


def two_inputs(**fields):
    plant = Plant(
        A_m=[[-1.0, 0.3], [0.0, -2.0]],
        b=[[1.0, 0.0], [0.2, 1.5]],
        theta=[[0.3, -0.2], [0.4, 0.1]],
        x0=[0.2, 0.1],
        input=[PlantInput(gain=0.9), PlantInput(actuator=TransferFunction([25.0], [1.0, 25.0]))],
    )
    commands = Square(amplitude=0.5, frequency=0.5), Sine(amplitude=0.4, frequency=1.1)
    unmatched = (Disturbance([0.5, 0.2], Sine(amplitude=0.3, frequency=0.4)),)
    model = ReferenceModel(k_0=[[1.0, 0.1], [0.0, 1.2]])
    return Problem(plant=plant, reference_model=model, reference=commands, unmatched=unmatched, **fields)


WIDER = {
    "a baseline with states": (with_a_baseline(), BaselineAlone()),
    "two inputs": (two_inputs(), KnownParameters(theta=[0.2, -0.1, 0.3, 0.1])),
}


@pytest.mark.parametrize("name", WIDER)
def test_a_baseline_with_states_and_two_inputs_have_them_too(name):
    problem, controller = WIDER[name]
    found, _ = certified(problem, controller)
    (run,) = simulate(problem, [controller], SIMULATION).values()
    assert {*OF_CONTINUOUS_LOOPS} <= found.guaranteed
    assert 0.2 * found.values["error_bound"] < max(run.figures["max_abs_e"]) < found.values["error_bound"]
    assert np.abs(run.u).max() < found.values["control_bound"]
    document = document_of(problem, controller)
    said, _ = barbalat_check.check(document)
    assert all(f"{key} = " in said[1] for key in OF_CONTINUOUS_LOOPS)


@pytest.mark.parametrize(
    ("fields", "why", "theorem"),
    [
        ({"path": PlantInput(delay=0.01)}, "a delay of 0.01 s", "the L1 norms of a continuous linear loop with a delay"),
        ({"path": PlantInput(rate_limit=50.0)}, "a rate limit", "a limited input"),
        ({"path": PlantInput(quantization=0.01)}, "a converter", "a limited input"),
        ({"path": PlantInput(saturation=[-0.5, 9.0])}, "beyond its limits", "an invariant set of the linear loop"),
        ({"sensor": Sensor(noise=Noise(std=0.01, sample_time=0.01))}, "Gaussian measurement", "Gaussian noise has no bound"),
        (
            {"sensor": Sensor(noise=Noise(std=0.01, sample_time=0.01, bound=0.02))},
            "only controllers with a sample_time",
            "the linear loop with its actuator, sensor",
        ),
    ],
)
def test_they_vanish_with_their_reason(fields, why, theorem):
    found, column = certified(problem_of(**fields), CONTROLLERS["linear"])
    assert not found.guaranteed & {*OF_CONTINUOUS_LOOPS}
    for key in OF_CONTINUOUS_LOOPS:
        assert why in found.entry(key).why and theorem in found.entry(key).theorem
    assert not column.cells["transient"].applies and not column.cells["stability"].applies


class Growing:
    """A signal that states no bound."""

    def __call__(self, t):
        return 0.1 * t

    before = __call__


def test_an_unstable_loop_and_signals_without_a_bound_have_none():
    unstable, _ = certified(problem_of(), KnownParameters(theta=[-9.0, -9.0]))
    unbounded, _ = certified(problem_of(disturbance=Growing()), CONTROLLERS["known"])
    for found, why in ((unstable, "unstable with the case's theta"), (unbounded, "Growing has no known bound")):
        assert not found.guaranteed and why in found.entry("error_bound").why and found.entry("error_bound").theorem


def test_a_bound_over_the_whole_known_set_is_kept():
    """Without anything else the small gain bounds e for every theta of the set, at least as large as the bound for the case's."""
    problem = problem_of(bare=True)
    found, _ = certified(problem, CONTROLLERS["adrc"])
    alone, _ = certified(replace(problem, uncertainty=None), CONTROLLERS["adrc"])
    assert "theta lies in the known set" in found.entry("error_bound").assumptions
    assert "theta and the input gain are those given in the case" in alone.entry("error_bound").assumptions
    assert alone.values["error_bound"] < found.values["error_bound"]
    assert found.values["state_bound"] == alone.values["state_bound"]


def test_known_parameters_of_the_plant_leave_no_error_whatever_phi_is():
    given = problem_of(bare=True)
    problem = replace(given, plant=replace(given.plant, regressor=Terms(terms=("sin(x1)", "x2"))))
    exact, other = KnownParameters(theta=THETA), KnownParameters(theta=KNOWN)
    assert certified(problem, exact)[0].values["error_bound"] == 0 and "error_bound" in certified(problem, exact)[0].guaranteed
    assert certified(given, exact)[0].values["error_bound"] < 1e-9
    entry = certified(problem, other)[0].entry("error_bound")
    other_parameters = "parameters other than the plant's"
    assert not entry.applies and other_parameters in entry.why and other_parameters in entry.theorem
    document = document_of(problem, exact)
    assert "error_bound = 0.0" in barbalat_check.check(document)[0][1]
    (facts,) = (one["facts"] for one in document["controllers"].values())
    facts["theta"] = KNOWN.tolist()
    refused(document, "must be the plant's")


def document_of(problem, controller):
    found = certify(problem, [controller], SIMULATION)
    return json.loads(json.dumps(proof("a case", problem, [controller], SIMULATION, found), allow_nan=False))


def refused(document, sentence):
    with pytest.raises(barbalat_check.Refused, match=sentence):
        barbalat_check.check(document)


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(kept=lambda name: name == "linear")
def test_the_checker_accepts_them_and_refuses_what_does_not_follow(name):
    true = document_of(problem_of(x0=[0.1, -0.2]), CONTROLLERS[name])
    said, assumed = barbalat_check.check(true)
    assert all(f"{key} = " in said[1] for key in OF_CONTINUOUS_LOOPS) and "not in the proof" not in "".join(said)
    assert any("parts of controller, actuator and sensor" in sentence for sentence in assumed)

    def changed(path, value):
        document = copy.deepcopy(true)
        ((_, controller),) = document["controllers"].items()
        at = {"plant": document["plant"], **controller, "lines": {line["key"]: line for line in controller["lines"]}}
        *way, last = path
        for key in way:
            at = at[key]
        at[last] = value(at[last]) if callable(value) else value
        return document

    for key in OF_CONTINUOUS_LOOPS:
        refused(changed(("lines", key, "value"), lambda value: value * (1 - 1e-6)), f"{key}: .*must be at least")
    response = "lines", "linear response", "witness"
    for key in (*OF_CONTINUOUS_LOOPS, "free error_bound"):
        refused(changed((*response, key, "rate"), "9p9"), "linear response: A'P")
        refused(changed((*response, key, "steps"), lambda steps: [[] for _ in steps]), "must be at least")
    path = true["plant"]["inputs"][0]
    for change, sentence in (
        ({"delay": 0.01}, "a delay"),
        ({"rate_limit": "1.0"}, "rate_limit"),
        ({"quantization": "0.1"}, "quantization"),
        ({"saturation": [-0.01, 9.0]}, "u may reach its limits"),
    ):
        refused(changed(("plant", "inputs"), [path | change]), f"linear response: .*{sentence}")
    refused(changed(("plant", "noise"), "Noise"), "without noise")
    refused(changed(("plant", "sensor", "quantization"), lambda steps: [0.1] * len(steps)), "without noise and quantisation")
    refused(changed(("plant", "unmatched"), []), "linear response")
    for key, factor in (("theta", 3.0), ("b", 1.1), ("A_m", 1.3), ("k_0", 3.0), ("x0", 20.0)):
        refused(changed(("plant", key), lambda value, f=factor: (np.array(value) * f).tolist()), "must be at least|A'P")
    facts = "facts", "linear loop"
    refused(
        changed((*facts, "x"), true["controllers"][CONTROLLERS[name].name]["facts"]["linear loop"]["x_m"]), "rows of their own"
    )
    refused(changed((*facts, "states"), 1), "every state of the plant")
    refused(changed(("facts", "sample_time"), 0.01), "must act continuously")
    refused(changed((*facts, "A"), lambda rows: (np.array(rows) * 1.05).tolist()), "must be at least|A'P")


def test_the_size_of_a_sum_of_sines_is_that_of_the_checker():
    problem = problem_of(reference=Sines(amplitudes=[0.1, 0.2, 0.3], frequencies=[1.0, 2.0, 3.0]))
    barbalat_check.check(document_of(problem, CONTROLLERS["known"]))
