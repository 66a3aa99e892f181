"""Bounds on sampled linear loops for all commands and disturbances of given sizes, attacked by simulations of the worst commands
and disturbances."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import barbalat_check
from barbalat import (
    Adrc,
    KnownParameters,
    L1PiecewiseConstant,
    LinearFeedback,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    TransferFunction,
    certify,
    input_filter,
    simulate,
)
from barbalat.cases.load import load_case
from barbalat.certificates.linear_loops.sampled_response import Sizes, response
from barbalat.certificates.proof import proof
from barbalat.certificates.schemes.bounded_response import KEYS, OF_NOISE
from barbalat.plants import DerivativeObserver, Disturbance, KalmanObserver, LuenbergerObserver, Noise, PlantInput, Sensor
from barbalat.signals import Constant, Sine, Square, Steps

T, DT, T_END = 0.05, 0.0025, 12.0
PATHS = {
    "nothing": PlantInput(),
    "delay": PlantInput(delay=0.03),
    "actuator and two samples": PlantInput(delay=0.11, actuator=TransferFunction([20.0], [1.0, 20.0])),
    "a gain": PlantInput(gain=0.8, delay=0.05),
}
CONTROLLERS = {
    "adrc": Sampled(Adrc(bandwidth=8.0), T),
    "adrc, euler": Sampled(Adrc(bandwidth=4.0), T, discretization="euler"),
    "linear": Sampled(
        LinearFeedback(controller=TransferFunction([2.0, 3.0], [1.0, 5.0]), output=[1.0, 0.5], nominal=[0.2, 0.1]), T
    ),
    "known": Sampled(KnownParameters(theta=[0.4, -0.3]), T, discretization="euler"),
    "piecewise": L1PiecewiseConstant(sample_time=T, filter=input_filter(0.3)),
}


def problem_of(path, **fields):
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.2, 1.0], theta=[0.6, -0.4], x0=[0.1, -0.2], input=PATHS[path]),
        reference_model=ReferenceModel(k_0=2.0),
        uncertainty=ParameterBox(lower=[-1, -1], upper=[1, 1]),
        **fields,
    )


def drawn_steps(random, size):
    """A random command that jumps between its ends at any samples."""
    times = np.cumsum(random.integers(1, random.integers(2, 60), 200)) * T
    return Steps(times=tuple(times), values=tuple(size * random.choice([-1.0, 1.0], 200)), initial=size * random.choice([-1, 1]))


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(kept=lambda name, path: (name, path) in (("adrc", "delay"), ("piecewise", "actuator and two samples")))
def test_no_command_and_no_disturbance_exceeds_them(name, path, sample):
    random = np.random.default_rng([len(name), len(path)])
    controller = CONTROLLERS[name]
    for _ in range(sample(3, 8)):
        sizes = random.uniform(0.2, 2.0, 3)
        problem = problem_of(
            path,
            reference=drawn_steps(random, sizes[0]),
            disturbance=drawn_steps(random, sizes[1]),
            unmatched=(Disturbance([1.0, -0.5], Sine(amplitude=sizes[2], frequency=random.uniform(0.3, 5.0))),),
            sensor=Sensor(lag=0.02) if random.random() < 0.5 else None,
        )
        (found,) = certify(problem, [controller], Simulation(t_end=T_END, dt=DT), keys=KEYS).values()
        if found.values["spectral_radius"] >= 1:
            continue
        assert {"error_bound", "state_bound", "control_bound"} <= found.guaranteed
        (run,) = simulate(problem, [controller], Simulation(t_end=T_END, dt=DT)).values()
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"] * (1 + 1e-6)
        assert run.figures["max_abs_u"] <= found.values["control_bound"] * (1 + 1e-6)
        assert np.abs(run.x).max() <= found.values["state_bound"] * (1 + 1e-6)


@pytest.mark.parametrize("name", ["adrc", "piecewise"])
def test_the_worst_command_comes_close(name):
    """The signs of the command come from the impulse response of a run, reversed in time, so the arithmetic of the bound is not
    used."""
    controller, count = CONTROLLERS[name], 160
    still = replace(problem_of("delay"), plant=replace(problem_of("delay").plant, x0=[0.0, 0.0]))
    pulse = replace(still, reference=Steps(times=(0.0, T), values=(1.0, 0.0)))
    simulation = Simulation(t_end=count * T, dt=DT)
    (run,) = simulate(pulse, [controller], simulation).values()
    bound = response(still, controller, Sizes(np.array([1.0]), np.zeros(0), np.zeros(2)))
    at_samples = np.abs(run.t[:, None] - np.arange(1, count) * T).argmin(axis=0)
    signs = np.sign(run.x[at_samples][::-1])
    reached = []
    for i in range(2):
        worst = Steps(times=tuple(np.arange(count - 1) * T), values=tuple(signs[:, i]))
        (run,) = simulate(replace(still, reference=worst), [controller], simulation).values()
        reached.append(np.abs(run.x[:, i]).max())
    assert 0.9 * bound.x <= max(reached) <= bound.x


OBSERVERS = {
    "luenberger": LuenbergerObserver(poles=[-6.0, -7.0], measured=[[1.0, 0.0]]),
    "kalman": KalmanObserver(Q=[0.0, 1.0], R=1e-3, measured=[[1.0, 0.0]]),
    "derivative": DerivativeObserver(cutoff=10.0, measured=[[1.0, 0.0]]),
}


@pytest.mark.parametrize("observer", OBSERVERS)
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(kept=lambda name, observer: (name, observer) in (("adrc", "kalman"), ("known", "derivative")))
def test_no_command_disturbance_or_noise_exceeds_them_with_an_observer(name, observer, sample):
    random, spoken = np.random.default_rng([len(name), len(observer)]), 0
    for _ in range(sample(2, 5)):
        sizes = random.uniform(0.2, 2.0, 2)
        problem = problem_of(
            "delay",
            reference=drawn_steps(random, sizes[0]),
            disturbance=drawn_steps(random, sizes[1]),
            observer=OBSERVERS[observer],
        )
        (found,) = certify(problem, [CONTROLLERS[name]], Simulation(t_end=T_END, dt=DT), keys=KEYS).values()
        if found.values["spectral_radius"] >= 1:
            continue
        spoken += 1
        (run,) = simulate(problem, [CONTROLLERS[name]], Simulation(t_end=T_END, dt=DT)).values()
        assert {"error_bound", "state_bound", "control_bound"} <= found.guaranteed
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"]
        assert np.abs(run.x).max() <= found.values["state_bound"]
        assert np.abs(run.u).max() <= found.values["control_bound"]
    assert spoken or name == "piecewise"
    noise = Sensor(noise=Noise(std=0.01, sample_time=T))
    still = problem_of("delay", reference=Constant(0.0), sensor=noise, observer=OBSERVERS[observer])
    still, long = replace(still, plant=replace(still.plant, x0=[0.0, 0.0])), Simulation(t_end=1500.0, dt=DT, record_points=30_000)
    (found,) = certify(still, [CONTROLLERS[name]], long, keys=OF_NOISE).values()
    if found.values["spectral_radius"] < 0.99:
        (run,) = simulate(still, [CONTROLLERS[name]], long).values()
        np.testing.assert_array_less(run.x.std(axis=0), 1.1 * np.array(found.values["error_noise_rms"]))
        np.testing.assert_array_less(0.75 * np.array(found.values["error_noise_rms"]), run.x.std(axis=0))


def refused(document, sentence):
    with pytest.raises(barbalat_check.Refused, match=sentence):
        barbalat_check.check(document)


@pytest.mark.parametrize("path", ["nothing", "actuator and two samples", "a gain"])
@pytest.mark.parametrize("name", ["adrc", "known", "piecewise"])
@pytest.mark.parametrize(("disturbance", "refused_below"), [(None, 0.998), (Sine(amplitude=0.3, frequency=2.0), 0.985)])
@pytest.mark.short(kept=lambda name, path, **_: (name, path) == ("known", "actuator and two samples"))
@pytest.mark.dear
def test_the_checker_accepts_them_and_refuses_what_does_not_follow(name, path, disturbance, refused_below):
    """The checker computes the sums again from the matrices alone and in a different arithmetic. The package's sums are within
    two thousandths of them. Its bound on the effect of a disturbance within a sample is cruder than the checker's."""
    problem = problem_of(path, reference=Square(amplitude=0.5, frequency=0.7), disturbance=disturbance)
    controller, simulation = CONTROLLERS[name], Simulation(t_end=T_END, dt=DT)
    found = certify(problem, [controller], simulation)
    document = json.loads(json.dumps(proof("a case", problem, [controller], simulation, found)))
    (of_controller,) = document["controllers"].values()
    lines = {line["key"]: line for line in of_controller["lines"]}
    said, _ = barbalat_check.check(document)
    accepted = [one.split(" = ")[0] for one in said[1].split("accepted: ")[1].split(", ")]
    assert {"error_bound_held", "state_bound", "control_bound", "error_bound"} <= set(accepted)
    assert {one.split(":")[0] for one in of_controller["not in the proof"]} <= {
        "reference_distance",
        "reference_distance_between",
    }
    for key in ("error_bound_held", "state_bound", "control_bound", "error_bound"):
        right = lines[key]["value"]
        lines[key]["value"] = right * refused_below
        refused(document, key)
        lines[key]["value"] = right
    witness, path_before = lines["sampled response"]["witness"], document["plant"]["inputs"][0]
    right = dict(witness)
    for change in (
        {"bends": 0},
        {"samples": 3},
        {"share": min(0.9999, 4 * right["share"])},
        {"P": (-np.array(right["P"])).tolist()},
    ):
        witness.update(change)
        refused(document, "sampled response|error_bound|state_bound|control_bound")
        witness.update(right)
    for change in ({"saturation": [-0.01, 0.01]}, {"rate_limit": 1.0}, {"quantization": 0.1}):
        before = dict(path_before)
        path_before.update(change)
        refused(document, "sampled response")
        path_before.update(before)
    for change in (
        {"noise": "Noise"},
        {"sensor": {"lag": 0.0, "reads": [[1.0, 0.0], [0.0, 1.0]], "quantization": [0.1, 0.1]}},
        {"reference": [{"kind": "unbounded"}]},
        {"disturbance": {"kind": "unbounded"}},
    ):
        refused(document | {"plant": document["plant"] | change}, "sampled response|_bound")


@pytest.mark.parametrize("name", ["adrc", "known", "piecewise"])
@pytest.mark.short(kept=lambda name: name == "adrc")
def test_the_matrices_of_a_sampled_loop_must_be_those_of_the_case(name):
    """The checker compares them with the plant, the delay, the disturbance and the model in the same file."""
    problem = problem_of("a gain", reference=Square(amplitude=0.5, frequency=0.7), disturbance=Sine(amplitude=0.3, frequency=2.0))
    controller, simulation = CONTROLLERS[name], Simulation(t_end=T_END, dt=DT)
    document = json.loads(
        json.dumps(proof("a case", problem, [controller], simulation, certify(problem, [controller], simulation)))
    )
    barbalat_check.check(document)
    plant, (facts,) = document["plant"], (one["facts"] for one in document["controllers"].values())
    twice = {key: (2 * np.array(plant[key])).tolist() for key in ("theta", "b", "gain", "k_0", "A_m")}
    (path,) = plant["inputs"]
    for key, change in {
        **twice,
        "x0": [0.5, 0.0],
        "inputs": [path | {"delay": path["delay"] + 0.7}],
        "unmatched": [{"direction": [1.0, 0.0], "signal": plant["disturbance"]}],
    }.items():
        refused(document | {"plant": plant | {key: change}}, "the case|the delay|a column for each disturbance")
    rows = facts["sampled"]["rows"]
    for change in ({"x": rows["x_m"]}, {"x": rows["x"][::-1]}, {"x_m": rows["x"]}):
        facts["sampled"]["rows"] = rows | change
        refused(document, "rows of their own|agree with the case")


@pytest.mark.dear
def test_a_proof_follows_as_many_samples_as_its_bounds_need():
    """The observer is fast and the loop slow, so the remainder of a sum is far above what the slowest eigenvalue suggests."""
    plant = Plant(A_m=[[0.0, 1.0], [-0.3, -1.0]], b=[0.0, 1.0], theta=[4.0, -3.0], x0=[1.0, 1.0])
    problem = Problem(
        plant=plant, reference_model=ReferenceModel(k_0=4.0), reference=Sine(amplitude=5.0, frequency=0.5), uncertainty=None
    )
    controller, simulation = Sampled(Adrc(bandwidth=50.0), 0.01), Simulation(t_end=1.0, dt=1e-3)
    document = proof("a case", problem, [controller], simulation, certify(problem, [controller], simulation))
    said, _ = barbalat_check.check(json.loads(json.dumps(document)))
    assert all(f"{key} = " in said[1] for key in KEYS)


def moved_by(errors, of_the_converter, lag):
    """x at 40 instants of each sample and u at each sample, for the loop of ``rounded`` from rest, by a matrix exponential."""
    n, fine, delay = 2, 40, 24
    A, b = np.array([[0.2 * 0.6, 1.0 - 0.2 * 0.4], [-1.4, -2.4]]), np.array([0.2, 1.0])
    whole = A if not lag else np.block([[A, np.zeros((n, n))], [np.eye(n) / lag, -np.eye(n) / lag]])
    size = len(whole)
    grown = np.zeros((size + 1, size + 1))
    grown[:size, :size], grown[:n, size] = whole, b
    step = expm(grown * T / fine)
    z, waiting, x, u = np.zeros(size), [0.0] * delay, [], []
    for error, rounding in zip(errors, of_the_converter, strict=True):
        u.append(-np.array([0.9, -0.1]) @ (z[-n:] + error))
        for _ in range(fine):
            waiting.append(u[-1] + rounding)
            z = step[:size, :size] @ z + step[:size, size] * waiting.pop(0)
            x.append(z[:n])
    return np.array(x), np.array(u)


def rounded(steps, bound, converter, lag):
    noise = None if bound is None else Noise(std=0.02, sample_time=T, bound=bound)
    problem = problem_of("nothing", reference=Constant(0.0), sensor=Sensor(lag=lag, quantization=steps, noise=noise))
    path = PlantInput(delay=0.03, quantization=converter)
    return replace(problem, plant=replace(problem.plant, x0=[0.0, 0.0], input=path))


@pytest.mark.parametrize("lag", [0.0, 0.02])
@pytest.mark.parametrize(
    ("steps", "bound", "converter", "close"),
    [([0.1, 0.02], None, None, 1.001), ([0.1, 0.02], [0.03, 0.05], None, 1.001), ([0.04, 0.04], None, 0.3, 1.12)],
)
def test_the_worst_errors_of_sensor_and_converter_come_close(lag, steps, bound, converter, close):
    """Every error is at its limit, with the sign that the impulse response of a simulation of our own has at that age."""
    problem, count = rounded(steps, bound, converter, lag), 240
    controller = Sampled(KnownParameters(theta=[0.9, -0.1]), T, discretization="euler")
    (found,) = certify(problem, [controller], Simulation(t_end=1.0, dt=DT), keys=KEYS).values()
    assert set(KEYS) <= found.guaranteed
    sizes = np.array([*(np.array(steps) / 2 + (0.0 if bound is None else np.array(bound))), (converter or 0.0) / 2])
    pulses = [np.outer(np.arange(count) == 0, size * unit) for size, unit in zip(sizes, np.eye(3), strict=True)]
    answers = [moved_by(pulse[:, :2], pulse[:, 2], lag) for pulse in pulses]
    rows = [[x[late::40, i] for x, _ in answers] for late in range(0, 40, 8) for i in range(2)] + [[u for _, u in answers]]
    reached = np.zeros(2)
    for row in rows:
        worst = sizes * np.sign(np.array(row)[:, ::-1]).T
        reached = np.maximum(reached, [np.abs(one).max() for one in moved_by(worst[:, :2], worst[:, 2], lag)])
    bounds = np.array([found.values["state_bound"], found.values["control_bound"]])
    assert (reached <= bounds).all() and (bounds <= close * reached).all()


@pytest.mark.parametrize("observer", [None, "luenberger"])
@pytest.mark.parametrize("lag", [0.0, 0.02])
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(
    kept=lambda name, lag, observer: (name, lag, observer) in (("adrc", 0.0, None), ("piecewise", 0.02, "luenberger"))
)
def test_bounds_hold_with_a_quantised_sensor_and_bounded_noise_and_the_checker_derives_them(name, lag, observer):
    noise = Noise(std=0.02, sample_time=T, bound=0.03)
    problem = problem_of(
        "delay",
        reference=Square(amplitude=0.5, frequency=0.7),
        disturbance=Sine(amplitude=0.3, frequency=2.0),
        sensor=Sensor(lag=lag, quantization=0.05, noise=noise),
        **({} if observer is None else {"observer": OBSERVERS[observer]}),
    )
    problem = replace(problem, plant=replace(problem.plant, input=PlantInput(delay=0.03, quantization=0.1)))
    controller, simulation = CONTROLLERS[name], Simulation(t_end=T_END, dt=DT)
    found = certify(problem, [controller], simulation)
    ((values, guaranteed),) = ((one.values, one.guaranteed) for one in found.values())
    (run,) = simulate(problem, [controller], simulation).values()
    assert {*KEYS, "error_rms_bound"} <= guaranteed
    assert values["error_rms_bound"] < values["error_bound"] + max(values["error_noise_rms"])
    assert max(run.figures["max_abs_e"]) <= values["error_bound"]
    assert np.abs(run.x).max() <= values["state_bound"] and np.abs(run.u).max() <= values["control_bound"]
    document = json.loads(json.dumps(proof("a case", problem, [controller], simulation, found)))
    said, _ = barbalat_check.check(document)
    assert all(f"{key} = " in said[1] for key in KEYS)
    plant, (facts,) = document["plant"], (one["facts"]["sampled"] for one in document["controllers"].values())
    sensor, (path,) = plant["sensor"], plant["inputs"]
    for change in (
        {"noise": "Noise"},
        {"noise": [0.5] * len(plant["noise"])},  # well beyond the reserve of the package's bounds
        {"noise": [0.03]} if observer is None else {"noise": [0.03, 0.03]},
        {"sensor": sensor | {"quantization": [0.8] * len(sensor["quantization"])}},
        {"sensor": sensor | {"lag": lag + 0.01}},
        {"sensor": sensor | {"reads": (1.1 * np.array(sensor["reads"])).tolist()}} if lag == 0 else {"sensor": None},
        {"inputs": [path | {"quantization": 2.0}]},
        {"inputs": [path | {"quantization": None}]},
    ):
        refused(document | {"plant": plant | change}, "sampled response|_bound")
    for key in ("W", "B"):
        right, facts[key] = facts[key], (0.9 * np.array(facts[key])).tolist()
        refused(document, "agree with the case")
        facts[key] = right


def test_the_checker_follows_a_command_with_a_single_jump_between_samples():
    problem, simulation = (
        problem_of("nothing", reference=Steps(times=(1.013,), values=(0.5,), initial=0.1)),
        Simulation(t_end=T_END, dt=DT),
    )
    found = certify(problem, [CONTROLLERS["known"]], simulation)
    document = json.loads(json.dumps(proof("a case", problem, [CONTROLLERS["known"]], simulation, found)))
    said, assumed = barbalat_check.check(document)
    assert "error_bound = " in said[1] and any("one in all" in sentence for sentence in assumed)
    (controller,) = document["controllers"].values()
    (line,) = [one for one in controller["lines"] if one["key"] == "error_bound"]
    line["value"] *= 0.998
    refused(document, "error_bound")


def test_the_slope_of_a_sine_follows_from_its_numbers():
    problem, simulation = problem_of("nothing", reference=Sine(amplitude=0.5, frequency=3.0)), Simulation(t_end=T_END, dt=DT)
    found = certify(problem, [CONTROLLERS["known"]], simulation)
    document = json.loads(json.dumps(proof("a case", problem, [CONTROLLERS["known"]], simulation, found)))
    barbalat_check.check(document)
    (controller,) = document["controllers"].values()
    controller["facts"]["between"][0]["slope"] = 1.4
    refused(document, "a command must not be steeper than stated")


def test_the_lag_of_the_sensor_and_the_jumps_of_a_square_wave_follow_from_the_file():
    square = Square(amplitude=0.5, frequency=0.7)
    problem, simulation = problem_of("delay", reference=square, sensor=Sensor(lag=0.02)), Simulation(t_end=T_END, dt=DT)
    found = certify(problem, [CONTROLLERS["known"]], simulation)
    document = json.loads(json.dumps(proof("a case", problem, [CONTROLLERS["known"]], simulation, found)))
    barbalat_check.check(document)
    plant = document["plant"]
    for sensor in (None, plant["sensor"] | {"lag": 0.2}, plant["sensor"] | {"lag": 0.0}):
        refused(document | {"plant": plant | {"sensor": sensor}}, "the sensor|a lag needs a state")
    (controller,) = document["controllers"].values()
    sampled, between = controller["facts"]["sampled"], controller["facts"]["between"][0]
    row = sampled["rows"]["sensor"][0]
    for matrix in ("J", "A", "free"):
        right = sampled[matrix][row][-1]
        sampled[matrix][row][-1] = right + 0.5
        refused(document, "the sensor")
        sampled[matrix][row][-1] = right
    for change in ({"jump": 0.0}, {"jump": between["jump"] / 2}, {"apart": 2 * between["apart"]}):
        controller["facts"]["between"] = [between | change]
        refused(document, "the jumps of the square wave")


def at_rest_with_noise(path, period, **fields):
    noise = Noise(std=[0.01, 0.03], sample_time=period)
    problem = problem_of(path, reference=Constant(0.0), sensor=Sensor(lag=0.02, noise=noise), **fields)
    return replace(problem, plant=replace(problem.plant, x0=[0.0, 0.0]))


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(kept=lambda name, path: (name, path) in (("adrc", "delay"), ("piecewise", "actuator and two samples")))
def test_noise_adds_the_stated_deviations(name, path):
    """The comparison is with the variances of a long simulation in which e is noise alone."""
    problem, simulation = (
        at_rest_with_noise(path, T / 2 if "euler" in name else T),
        Simulation(t_end=3000.0, dt=DT, record_points=60_000),
    )
    (found,) = certify(problem, [CONTROLLERS[name]], simulation, keys=OF_NOISE).values()
    (run,) = simulate(problem, [CONTROLLERS[name]], simulation).values()
    stated = {"error_noise_rms": run.x.std(axis=0), "control_noise_rms": run.u.reshape(len(run.t), -1).std(axis=0)}
    assert stated.keys() <= found.guaranteed
    for key, seen in stated.items():
        np.testing.assert_array_less(seen, 1.06 * np.array(found.values[key]))  # the statistical error of the sample is 2 to 3 %
        np.testing.assert_array_less(0.85 * np.array(found.values[key]), seen)


@pytest.mark.dear
def test_the_root_mean_square_covers_commands_and_noise():
    problem = replace(at_rest_with_noise("delay", T), reference=Square(amplitude=0.5, frequency=0.5))
    simulation = Simulation(t_end=60.0, dt=DT)
    for name in ("adrc", "piecewise", "known"):
        quiet, noisy = replace(problem, sensor=Sensor(lag=0.02)), problem
        (without,), (found,) = (certify(one, [CONTROLLERS[name]], simulation, keys=KEYS).values() for one in (quiet, noisy))
        assert "error_bound" not in found.guaranteed
        assert {"error_rms_bound", "error_noise_rms"} <= found.guaranteed
        expected = without.values["error_bound"] + max(found.values["error_noise_rms"])
        assert found.values["error_rms_bound"] == pytest.approx(expected, rel=1e-9)
        assert without.entry("error_noise_rms") is None


def test_a_root_mean_square_is_not_proven_by_the_continuous_loop():
    problem, simulation = at_rest_with_noise("nothing", T), Simulation(t_end=T_END, dt=DT)
    (controller, found) = CONTROLLERS["known"], certify(problem, [CONTROLLERS["known"]], simulation)
    document = json.loads(json.dumps(proof("a case", problem, [controller], simulation, found)))
    said, _ = barbalat_check.check(document)
    assert any("not in the proof: error_rms_bound" in sentence for sentence in said)


def test_noise_beside_limits_and_slow_noise_is_not_guaranteed():
    limited = at_rest_with_noise("delay", T)
    limited = replace(limited, plant=replace(limited.plant, input=PlantInput(delay=0.03, saturation=[-50.0, 50.0])))
    (found,) = certify(limited, [CONTROLLERS["adrc"]], Simulation(t_end=1.0, dt=DT), keys=OF_NOISE).values()
    assert found.entry("error_noise_rms").kind == "estimate"
    assert "beyond its limits" in found.entry("error_rms_bound").why
    slow = at_rest_with_noise("delay", 2 * T)
    (found,) = certify(slow, [CONTROLLERS["adrc"]], Simulation(t_end=1.0, dt=DT), keys=OF_NOISE).values()
    assert "not independent" in found.entry("error_noise_rms").why


def test_limits_that_u_may_reach_leave_no_bound():
    path = PlantInput(delay=0.03, saturation=[-0.5, 0.5])
    problem = replace(problem_of("delay", reference=Square(amplitude=1.0, frequency=0.5)))
    problem = replace(problem, plant=replace(problem.plant, input=path))
    (found,) = certify(problem, [CONTROLLERS["adrc"]], Simulation(t_end=1.0, dt=DT), keys=KEYS).values()
    entry = found.entry("error_bound")
    assert not entry.applies and "u may reach" in entry.why
    wide = replace(problem, plant=replace(problem.plant, input=PlantInput(delay=0.03, saturation=[-50.0, 50.0])))
    (found,) = certify(wide, [CONTROLLERS["adrc"]], Simulation(t_end=1.0, dt=DT), keys=KEYS).values()
    assert "error_bound" in found.guaranteed


def test_the_quadrotor_has_a_guaranteed_bound_that_its_run_keeps():
    case = load_case("quadrotor-pitch")
    certificates, runs = (
        certify(case.problem, case.controllers, case.simulation, keys=("error_bound",)),
        simulate(case.problem, case.controllers, case.simulation),
    )
    bounded = [name for name, one in certificates.items() if "error_bound" in one.guaranteed]
    assert bounded == ["L1, exact", "L1, as flown", "ADRC"]
    for name in bounded:
        assert max(runs[name].figures["max_abs_e"]) <= certificates[name].values["error_bound"]
