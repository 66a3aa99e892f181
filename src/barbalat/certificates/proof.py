"""The proof of the guaranteed numbers of a case, each with a witness, for ``barbalat-check``, which shares no code with this
package.

A line is a number with the data needed to check it; a line depends only on earlier lines. The file contains the numbers of the
case, from which the checker derives everything else; docs/proofs.md has the theorems and the file format.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from barbalat.certificates.assumptions import unmet_by
from barbalat.certificates.bounds import any_command, known_command
from barbalat.certificates.bounds.any_command import CLOSENESS
from barbalat.certificates.bounds.laws import least_gain
from barbalat.certificates.bounds.model import model_bounds, state_bounds
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.entry import GUARANTEED, Entry, NotApplicable
from barbalat.certificates.linear_loops.continuous_response import loop_of
from barbalat.certificates.linear_loops.sampled_response import bounds_of, disturbances
from barbalat.certificates.linear_loops.sampled_response import grounds as sampled_grounds
from barbalat.certificates.linear_loops.sampled_response import witness as sampled_witness
from barbalat.certificates.lyapunov.written import SCHEME as OWN_V
from barbalat.certificates.lyapunov.written import written
from barbalat.certificates.schemes import FollowedFile, ProvenFile, scheme_file
from barbalat.certificates.schemes.bounded_response import OF_CONTINUOUS_LOOPS, is_for_the_case
from barbalat.controllers import Sampled
from barbalat.linear.conditions import smallest_eigenvalue
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.l1_norms.witness import as_floats, witness
from barbalat.problem.actuation import PlantInput
from barbalat.problem.departures import apart_sentence, departures
from barbalat.problem.known_set import KnownSet, ParameterBall
from barbalat.problem.measurement import Sensor
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.regressors import GaussianRBF, Linear, Polynomial, Regressor, Terms
from barbalat.problem.state_feedback import Known, Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import BoundedSignal, Controller, Signal
from barbalat.signals import Constant, Sine, Sines, Square, Step, Steps
from barbalat.signals.recorded import Recorded
from barbalat.signals.smooth import Chirp
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

FORMAT = "barbalat proof 1"
EXACT_BITS = 1024
"""Precision at which products and sums of a few float64 numbers are exact."""
RESTS_ON: dict[str, tuple[str, ...]] = {
    "nu_0": ("lambda_min",),
    "nu_0_worst": ("lambda_min",),
    "initial_parameter_error": (),
    "lambda_min": (),
    "theta_max": (),
    "bounds": ("lyapunov", "L1 norm of W_b"),
    "kappa_max": ("theta_max", "L1 norm of sW_b"),
    "kappa_admissible": ("theta_max", "L1 norm of W_b(1-C) at kappa"),
    "nu_1": ("lyapunov", "theta_max", "bounds", "L1 norm of sW_b"),
    "nu_2": ("lyapunov", "lambda_min", "theta_max", "L1 norm of sW_b"),
    "reference_error_bound": ("lyapunov", "lambda_min", "theta_max", "L1 norm of C", "L1 norm of W_b(1-C)"),
}
"""The lines that a rule needs in every scheme, by key."""
OF_V = "error_bound", "error_bound_worst", "error_bound_command"
OF_FIXED_LOOPS: dict[str, dict[str, tuple[str, ...]]] = {
    scheme: dict.fromkeys(("norms", "condition", "error_bound_command"), (f"L1 norm of {name}",))
    | {"error_bound": ("bounds", f"L1 norm of {name}"), "error_bound_worst": ()}
    for scheme, name in (("baseline", "W_b"), ("linear", "W_b S"), ("adrc", "T"))
}
BY_SCHEME: dict[str, dict[str, tuple[str, ...]]] = OF_FIXED_LOOPS | {
    "mrac": dict.fromkeys(OF_V, ("lyapunov", "lambda_min")),
    "mrac-direct": dict.fromkeys(OF_V, ("lyapunov", "lambda_min")),
    "mrac-closed-loop": dict.fromkeys(OF_V, ("lyapunov", "lambda_min", "L1 norm of 1-L")),
    "robust-mrac": {},
    "known-parameters": {"error_bound": ()},
    "network": {"W_hat_bound": (), "V_hat_bound": (), "control_bound": ()},
    "output": dict.fromkeys(("output_bound", "error_bound", "sigma_needed"), ("L1 norm of loop",))
    | {"slope": (), "condition": ("L1 norm of H(1-C)",)},
    "l1": {
        "norms": ("L1 norm of W_b(1-C)", "L1 norm of sW_b"),
        "condition": ("theta_max", "L1 norm of W_b(1-C)"),
        "error_bound": ("lyapunov", "lambda_min", "theta_max", "bounds", "L1 norm of W_b(1-C)"),
        "error_bound_command": ("lyapunov", "theta_max", "L1 norm of C", "L1 norm of W_b(1-C)"),
        "error_bound_worst": ("lyapunov", "L1 norm of C"),
    },
    OWN_V: dict.fromkeys((*OF_V, "estimates_error_bound"), ("lyapunov_decay",))
    | {"lyapunov_decay": (), "error_limit": ("lyapunov", "lyapunov_decay")},
    "sampled": dict.fromkeys(("error_bound_held", "state_bound", "control_bound"), ("sampled response",))
    | {"sampled response": (), "error_bound": ("sampled response", "L1 norm of W_r", "L1 norm of sW_r")},
}
LINEAR_RESPONSE, LINEAR_LOOP = "linear response", "linear loop"
OVER_CELLS = {"l1": "W_b(1-C)", "baseline": "W_b", "linear": "W_b S", "adrc": "T"}
"""Schemes whose bounds over the known set follow from cells of it, with the system G of e = G[(theta - theta_0)'x]."""
NO_RULE = "no rule covers it"
NO_WITNESS = "no witness was found for the L1 norm of {}"


def proof(
    case: str,
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    found: Mapping[str, Certificate],
) -> dict[str, Any]:
    """The document that ``certify --proof`` writes."""
    design = problem.design.nominal
    plant: dict[str, Any] | None = None
    if isinstance(design, Problem):
        plant = plant_facts(design)
    elif isinstance(design, OutputProblem):
        plant = _output_facts(design)
    return {
        "format": FORMAT,
        "case": case,
        "only if": _conditions(problem),
        "plant": plant,
        "controllers": {one.name: _of_controller(design, one, found[one.name], simulation) for one in controllers},
    }


def _conditions(problem: TrackingProblem) -> list[str]:
    """The conditions under which the guarantees of the design hold for the simulated loop, each as part of a sentence."""
    found = [one.sentence for one in unmet_by(problem)]
    apart = apart_sentence(departures(problem)) if isinstance(problem, Problem) else ""
    return [*found, f"the plant is that of the design, but {apart}"] if apart else found


def _of_controller(
    problem: TrackingProblem, controller: Controller, certificate: Certificate, simulation: Simulation
) -> dict[str, Any]:
    inner = controller.controller if isinstance(controller, Sampled) else controller
    claimed = [one for one in certificate.entries if one.kind in GUARANTEED and one.value is not None]
    file, witnesses = scheme_file(inner), dict[str, dict[str, Any]]()
    if isinstance(problem, Problem) and any(one.key == "error_bound_held" for one in claimed):
        facts = sampled_grounds(problem, controller, simulation.t_end)
    elif isinstance(problem, Problem) and any(one.key == "lyapunov_decay" for one in claimed):
        own = written(problem, inner)
        if isinstance(own, NotApplicable):
            return {"facts": {}, "lines": [], "not in the proof": [f"{one.key}: {own.why}" for one in claimed]}
        facts, witnesses = own.facts, own.witnesses
    elif isinstance(problem, Problem) and any(one.key in OF_CONTINUOUS_LOOPS and is_for_the_case(one) for one in claimed):
        facts = {"scheme": LINEAR_LOOP}
        if isinstance(file, ProvenFile) and problem.fixed_observer is None:
            facts = file.grounds(problem, inner, simulation)
        facts[LINEAR_LOOP] = loop_of(problem, inner).as_facts()
    elif claimed and isinstance(file, ProvenFile):
        facts = file.grounds(problem, inner, simulation)
        if isinstance(controller, Sampled):
            facts["sample_time"] = controller.sample_time
    else:
        return {"facts": {}, "lines": [], "not in the proof": [f"{one.key}: {NO_RULE}" for one in claimed]}
    followed = controller if facts["scheme"] == "sampled" else inner
    lines = _Lines(problem, followed, facts, {one.key: one for one in claimed}, simulation.t_end, witnesses)
    missing = [f"{key}: {why}" for key in lines.claimed if (why := lines.add(key))]
    return {"facts": facts, "lines": list(lines.found.values()), "not in the proof": missing}


@dataclass
class _Lines:
    """The lines so far, by the key that they prove."""

    problem: Any
    controller: Any
    facts: dict[str, Any]
    claimed: dict[str, Entry]
    t_end: float
    witnesses: dict[str, dict[str, Any]]
    found: dict[str, dict[str, Any]] = field(default_factory=dict)

    def add(self, key: str) -> str:
        """Add a line and all lines on which it depends; return the reason if it cannot be proven."""
        if key in self.found:
            return ""
        if key == "norms" and self.facts["scheme"] == "output":
            return self._add_norms_of_output()
        if key.startswith("L1 norm of "):
            return self._add_norm(key)
        rests_on = (RESTS_ON | {"lyapunov": (), LINEAR_RESPONSE: ()} | BY_SCHEME.get(self.facts["scheme"], {})).get(key)
        entry = self.claimed.get(key)
        if LINEAR_LOOP in self.facts and key in OF_CONTINUOUS_LOOPS and is_for_the_case(entry):
            rests_on = (LINEAR_RESPONSE,)
        of_samples = "sample_time" in self.facts and entry is not None and not entry.quantity.timeless
        if rests_on is None or of_samples:
            return NO_RULE
        directly = isinstance(self.problem, Problem) and self.problem.known.enters is not None
        for one in ("lyapunov", "L1 norm of W_r") if key == "bounds" and directly else rests_on:
            if why := self.add(one):
                return why
        value = self._unclaimed(key) if entry is None else entry.value
        line = {"key": key, "value": value, "claimed": entry is not None}
        try:
            line |= self._witness(key, value)
        except InputError as error:
            return str(error)
        self.found[key] = line
        return ""

    def _witness(self, key: str, value: Any) -> dict[str, Any]:
        """A line's witness, if it needs one; raises InputError, with the reason, if no witness exists."""
        of_every = self.claimed.get(known_command.OF_EVERY_COMMAND)
        if key in self.witnesses:
            return {"witness": self.witnesses[key]}
        if key == LINEAR_RESPONSE:
            return {"witness": self._of_the_loop()}
        if key == "error_bound" and LINEAR_LOOP in self.facts and is_for_the_case(self.claimed.get(key)):
            return {"witness": {"follows_from": LINEAR_RESPONSE}}
        if key == "sampled response":
            return {"witness": sampled_witness(self.problem, self.controller)}
        if key == known_command.KEY and of_every is not None and of_every.value == value and self.facts["scheme"] in OVER_CELLS:
            if why := self.add(known_command.OF_EVERY_COMMAND):
                raise InputError(why)
            return {"witness": {"follows_from": known_command.OF_EVERY_COMMAND}}
        return {"witness": self._over_the_set(key)} if key in (known_command.OF_EVERY_COMMAND, known_command.KEY) else {}

    def _over_the_set(self, key: str) -> dict[str, Any]:
        """The witness of a bound over the known set: the least eigenvalue of a gain matrix, or cells along the command."""
        found, gamma, file = dict[str, Any](), self.facts.get("gamma", 0.0), scheme_file(self.controller)
        if np.ndim(gamma) == 2:
            found["least_gain"] = least_gain(np.array(gamma))
        if isinstance(file, FollowedFile) and self.facts["scheme"] != "mrac":
            loop = file.known_loop(self.problem, self.controller)
            assert loop is not None and self.problem.uncertainty is not None
            if key == known_command.KEY:
                _, along = known_command.command_bound(self.problem, loop, self.problem.uncertainty, self.t_end)
                found |= {"t_end": self.t_end, "cells": along.tree(known_command.witness)}
            else:
                _, whole = any_command.worst_bound(self.problem, loop)
                with ctx.workprec(EXACT_BITS):
                    A, B, _, _ = _system(OVER_CELLS[self.facts["scheme"]], self.problem, self.facts, None)
                found["cells"] = whole.tree(partial(any_command.witness, self.problem, replace(loop, A=A, B=B.entries())))
        return found

    def _of_the_loop(self) -> dict[str, Any]:
        """The witnesses of the norms of a continuous linear loop and of its free response."""
        found = dict[str, Any]()
        sizes = {key: entry.value for key, entry in self.claimed.items() if key in OF_CONTINUOUS_LOOPS and is_for_the_case(entry)}
        for name, (of, parts) in _linear_loop(self.problem, self.facts[LINEAR_LOOP]).items():
            if of not in sizes:
                continue
            found[name] = witness(*parts, sizes[of], closeness=CLOSENESS)
            if found[name] is None:
                raise InputError(NO_WITNESS.format(f"{of} in the linear loop"))
        return found

    def _add_norms_of_output(self) -> str:
        """Add the norms of the loop around y, and of condition (20)."""
        value = self.claimed["norms"].value
        if why := next((why for name in value if (why := self.add(f"L1 norm of {name}"))), ""):
            return why
        self.found["norms"] = {"key": "norms", "value": value, "claimed": True}
        return ""

    def _unclaimed(self, key: str) -> Any:
        """An intermediate value that the certificate does not claim."""
        known = self.problem.known
        if key in ("lyapunov", "sampled response", LINEAR_RESPONSE):
            return True
        if key == "lambda_min":
            return smallest_eigenvalue(np.array(self.facts["P"]))
        if key == "theta_max":
            assert known.theta_set is not None
            return known.theta_set.theta_max
        assert key == "bounds"
        if known.inputs > 1:
            return {"x_m": max(state_bounds(self.problem))}
        model = model_bounds(self.problem)
        return {"r": model.r, "x_m": model.x_m}

    def _add_norm(self, key: str) -> str:
        name = key.removeprefix("L1 norm of ")
        entry = self.claimed.get("kappa_admissible")
        kappa = None if entry is None else entry.value
        with ctx.workprec(EXACT_BITS):
            if self.facts["scheme"] == "output":
                A, B, C, D = _output_system(name, self.facts)
            else:
                A, B, C, D = _system(name, self.problem, self.facts, kappa)
        size = l1_norm(*map(as_floats, (A, B, C, D)), relative_width=1e-3).lower
        found = witness(A, B, C, size)
        if found is None:
            return NO_WITNESS.format(name)
        own = {"kappa": kappa} if name == "W_b(1-C) at kappa" else {}
        self.found[key] = {"key": "L1 norm", "of": name, "claimed": False, "witness": found} | own
        return ""


def _output_system(name: str, facts: dict[str, Any]) -> tuple[arb_mat, ...]:
    if name == "H(1-C)":
        A, B, C, D = _state_space(facts["H(1-C)"])
        return A, B, C, arb_mat([[D]])
    a, b, c, d = (np.array(facts["loop"][key]) for key in "ABCD")
    if name == "y/(d+f)":
        b, c, d = b[:, 1:2], c[:1], d[:1, 1:2]
    return _balls(a), _balls(b), _balls(c), _balls(d)


def _system(name: str, problem: Problem, facts: dict[str, Any], kappa: float | None) -> tuple[arb_mat, ...]:
    """The system of a name in balls, computed from float64 numbers with negligible rounding."""
    known, n = problem.known, problem.known.n
    A_m, b, identity, nothing = _balls(known.A_m), _balls(known.b.reshape(n, -1)), _balls(np.eye(n)), _zeros(n, known.inputs)
    if name == "W_b":
        return A_m, b, identity, nothing
    if name == "sW_b":
        return A_m, b, A_m, b
    if name in ("W_r", "sW_r"):
        b_r = _balls(facts["sampled"]["b_r"] if facts["scheme"] == "sampled" else problem.model.matrices[1])
        return (A_m, b_r, identity, _zeros(n, b_r.ncols())) if name == "W_r" else (A_m, b_r, A_m, b_r)
    if name == "1-L":
        return A_m, -_balls(facts["L"]), identity, identity
    if name.startswith("W_b(1-C)"):
        A, B, C, D = _state_space(facts["filter"])
        if name.endswith("kappa"):
            assert kappa is not None
            pole = arb_mat([[1 / arb(kappa)]])
            A, B, C, D = -pole, pole, _balls([[1.0]]), arb(0)
        whole = _blocks([[A_m, -(b * C)], [_zeros(A.nrows(), n), A]])
        return whole, _blocks([[b * (1 - D)], [B]]), _blocks([[identity, _zeros(n, A.nrows())]]), nothing
    if name == "C":
        A, B, C, D = _state_space(facts["filter"])
        return A, B, C, arb_mat([[D]])
    return _disturbed(A_m, b, facts)


def _disturbed(A_m: arb_mat, b: arb_mat, facts: dict[str, Any]) -> tuple[arb_mat, ...]:
    """The system from a matched disturbance to x, in the loop with theta_0."""
    n, theta_0 = A_m.nrows(), _balls([facts["theta_0"]])
    identity, nothing = _balls(np.eye(n)), _zeros(n, 1)
    if facts["scheme"] == "linear" and not facts["K"]["A"]:  # K(s) is a gain
        return A_m - b * _balls([facts["c"]]) * arb(facts["K"]["D"]), b, identity, nothing
    if facts["scheme"] == "linear":
        A, B, C, D = _state_space(facts["K"])
        c = _balls([facts["c"]])
        feedback, inner = _blocks([[theta_0 + c * D, C]]), [B * c, A]
    else:
        o = {key: _balls(value) for key, value in facts["observer"].items()}
        of_estimates = _blocks([[theta_0, _balls([[1.0]])]])
        of_x, of_xi = of_estimates * o["N"], of_estimates * o["M"]
        feedback, inner = _blocks([[of_x, of_xi]]), [o["G"] - o["H"] * of_x, o["F"] - o["H"] * of_xi]
    k = inner[1].nrows()
    B = _blocks([[b], [_zeros(k, 1)]])
    whole = _blocks([[A_m + b * theta_0, _zeros(n, k)], inner]) - B * feedback
    return whole, B, _blocks([[identity, _zeros(n, k)]]), nothing


def _linear_loop(problem: Problem, facts: dict[str, Any]) -> dict[str, tuple[str, tuple[arb_mat, arb_mat, arb_mat]]]:
    """A, B and C from all signals at their sizes to e, x and u, and of the derivatives of the free responses; the rows of x and
    x_m are the plant's."""
    known, n, plant, k, N = problem.known, problem.known.n, problem.plant, facts["states"], len(facts["A"])
    sizes = [arb(one) for one in (*bounds_of(problem.commands), *bounds_of(disturbances(problem)))]
    unit = np.eye(N, N + len(sizes))
    x, x_m = _balls(unit[facts["x"]]), _balls(unit[facts["x_m"]])
    z, u, v = (_blocks([[_balls(facts[a]), _balls(facts[b])]]).tolist() for a, b in (("A", "B"), ("C", "D"), ("V", "V_w")))
    with ctx.workprec(EXACT_BITS):
        for j, path in enumerate(plant.paths):
            if path.actuator is None and path.multiplicative is None:
                v[j] = [arb(path.gain) * one for one in u[j]]
        A_m, b, k_0 = _balls(known.A_m), _balls(known.b.reshape(n, -1)), _balls(np.reshape(known.k_0, (known.inputs, -1)))
        enters = _zeros(n, k_0.ncols()) if known.enters is None else _balls(known.enters.reshape(n, -1))
        acting = [b] if problem.disturbance is not None else []
        acting += [_balls(np.append(one.direction, np.zeros(n - plant.states))[:, None]) for one in problem.unmatched]
        of_x = A_m * x + b * (arb_mat(v) + _balls(plant.theta.reshape(n, -1).T) * x) + _blocks([[_zeros(n, N), enters, *acting]])
        of_x_m = A_m * x_m + _blocks([[_zeros(n, N), b * k_0 + enters, *(_zeros(n, 1) for _ in acting)]])
        for row, rate in zip((*facts["x"], *facts["x_m"]), (*of_x.tolist(), *of_x_m.tolist()), strict=True):
            z[row] = rate
        A, B = arb_mat([row[:N] for row in z]), arb_mat([[a * size for a, size in zip(row[N:], sizes, strict=True)] for row in z])
        parts = (x - x_m).tolist()[:k], x.tolist()[:k], u
        outputs = {key: arb_mat([row[:N] for row in part]) for key, part in zip(OF_CONTINUOUS_LOOPS, parts, strict=True)}
        found = {name: (name, (A, B, C)) for name, C in outputs.items()}
        if np.any(facts["start"]):
            start = arb_mat([[arb(one)] for one in facts["start"]])
            found |= {f"free {name}": (name, (A, start, C * A)) for name, C in outputs.items()}
        return found


def _state_space(facts: dict[str, Any]) -> tuple[arb_mat, arb_mat, arb_mat, arb]:
    return _balls(facts["A"]), _balls([[one] for one in facts["B"]]), _balls([facts["C"]]), arb(facts["D"])


def _balls(rows: Any) -> arb_mat:
    return arb_mat(np.asarray(rows, dtype=float).tolist())


def _zeros(rows: int, columns: int) -> arb_mat:
    return _balls(np.zeros((rows, columns)))


def _blocks(parts: list[list[arb_mat]]) -> arb_mat:
    rows: list[list[arb]] = []
    for line in parts:
        tables = [part.tolist() for part in line]
        rows += [[entry for table in tables for entry in table[i]] for i in range(len(tables[0]))]
    return arb_mat(rows)


def plant_facts(problem: Problem) -> dict[str, Any]:
    """The plant as the designer knows it, and the signals that act on it."""
    plant, known = problem.plant, problem.known
    unmatched = "" if problem.derived is None else problem.derived.unmatched
    sensor = problem.sensor
    quiet = sensor is None or (sensor.lag == 0 and sensor.noise is None and sensor.quantization is None)
    return {
        "A_m": known.A_m.tolist(),
        "b": known.b.reshape(known.n, -1).tolist(),
        "k_0": np.reshape(known.k_0, (known.inputs, -1)).tolist(),
        "theta": plant.theta.tolist(),
        "x0": np.asarray(plant.x0).tolist(),
        "states": plant.states,
        "gain": [float(path.gain) for path in plant.paths],
        "input_gain": None if known.gains is None else {"lower": known.gains.lower.tolist(), "upper": known.gains.upper.tolist()},
        "regressor": _regressor(plant.regressor),
        "uncertainty": _known_set(problem.uncertainty),
        "inputs": [_path(path) for path in plant.paths],
        "disturbance": None if problem.disturbance is None else _command(problem.disturbance),
        "unmatched": [{"direction": one.direction.tolist(), "signal": _command(one.signal)} for one in problem.unmatched],
        "unmatched_ranges": unmatched,
        "sensor": None if quiet and problem.fixed_observer is None else _sensor(problem),
        "noise": _noise(problem),
        "baseline": _baseline(known),
        "reference": [_command(one) for one in problem.commands],
    }


def _sensor(problem: Problem) -> dict[str, Any]:
    """The sensor with the C of its measurement and the step of each measured quantity, 0 without one."""
    sensor, observer = problem.sensor or Sensor(), problem.fixed_observer
    steps = 0.0 if sensor.quantization is None else sensor.quantization
    return {
        "lag": sensor.lag,
        "reads": (np.eye(problem.known.n) if observer is None else observer.C).tolist(),
        "quantization": (steps * np.ones(problem.measured)).tolist(),
    }


def _noise(problem: Problem) -> Any:
    """The bound on the noise of each measured quantity, or its name if it has no bound; None without noise."""
    noise = problem.noise
    if noise is None or noise.bound is None:
        return None if noise is None else type(noise).__name__
    return (noise.bound * np.ones(problem.measured)).tolist()


def _baseline(known: Known) -> dict[str, Any] | None:
    if known.theta_0 is None:
        return None
    enters = np.zeros((known.n, np.reshape(known.k_0, (known.inputs, -1)).shape[1])) if known.enters is None else known.enters
    return {"theta_0": known.theta_0.tolist(), "enters": enters.reshape(known.n, -1).tolist()}


def _output_facts(problem: OutputProblem) -> dict[str, Any]:
    """The signals that act on a plant with output feedback."""
    acting = {"disturbance": problem.disturbance, "output_disturbance": problem.output_disturbance}
    noise = problem.noise
    return {
        "kind": "output",
        "inputs": [_path(path) for path in problem.plant.paths],
        "reference": _command(problem.reference),
        "noise": None if noise is None else type(noise).__name__,
    } | {name: None if signal is None else _command(signal) for name, signal in acting.items()}


def _regressor(regressor: Regressor) -> dict[str, Any]:
    if isinstance(regressor, Terms):
        return {"kind": "terms", "terms": list(regressor.terms)}
    kinds: dict[type, str] = {Linear: "x", Polynomial: "polynomial", GaussianRBF: "gaussian"}
    return {"kind": kinds.get(type(regressor), "unknown")}


def _known_set(known_set: KnownSet | None) -> dict[str, Any] | None:
    if known_set is None:
        return None
    if isinstance(known_set, ParameterBall):
        return {"center": known_set.center.tolist(), "radius": known_set.radius}
    return {"lower": known_set.lower.tolist(), "upper": known_set.upper.tolist()}


def _path(path: PlantInput) -> dict[str, Any]:
    def given(part: Any) -> Any:
        return part if part is None or isinstance(part, float) else str(part)

    names = ("quantization", "rate_limit", "actuator", "multiplicative")
    limits = None if path.saturation is None else np.asarray(path.saturation, dtype=float).tolist()
    return {"delay": path.delay, "saturation": limits} | {name: given(getattr(path, name)) for name in names}


def _command(signal: Signal) -> dict[str, Any]:
    """The numbers from which a command's bound follows; for a user-defined class, the bound that it states."""
    if isinstance(signal, Constant):
        return {"kind": "constant", "amplitudes": [signal.amplitude]}
    if isinstance(signal, Chirp):
        return {"kind": "chirp", "amplitudes": [signal.amplitude], "constant": getattr(signal, "constant", 0.0)}
    if isinstance(signal, (Sine, Square)):
        turns = {"frequencies": [signal.frequency], "phases": [signal.phase]}
        name = type(signal).__name__.lower()
        return {"kind": name, "amplitudes": [signal.amplitude], "constant": signal.constant} | turns
    if isinstance(signal, Sines):
        turns = {"frequencies": list(signal.frequencies), "phases": list(signal.phases or ())}
        return {"kind": "sines", "amplitudes": list(signal.amplitudes), "constant": signal.constant} | turns
    if isinstance(signal, Step):
        return {"kind": "levels", "times": [signal.start], "values": [signal.constant, signal.constant + signal.amplitude]}
    if isinstance(signal, Steps):
        return {"kind": "levels", "times": list(signal.times), "values": [signal.initial, *signal.values]}
    if isinstance(signal, Recorded):
        return {"kind": "recorded", "values": signal.values.tolist()}
    if isinstance(signal, BoundedSignal):
        return {"kind": "bounded", "bound": float(signal.bound), "name": type(signal).__name__}
    return {"kind": "unbounded", "name": type(signal).__name__}
