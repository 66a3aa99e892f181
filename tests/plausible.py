"""Plausible cases, drawn from the JSON Schema of case files, which a user might write.

Every key of the schema can occur. The schema says which keys a table has, which are required and what shape a value has (a
description begins with it, such as "(n,)"). It does not say what size a value plausibly has or how keys depend on each other.
This file adds both by the names of keys. A new key is included automatically with a number of order one.
"""

from __future__ import annotations

import copy
import math
import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from barbalat.cases.load import CaseText
from barbalat.cases.schema import json_schema
from barbalat.validate import InputError

Table = dict[str, Any]

SCHEMA = json_schema()
LARGEST_ORDER = 4
STEPS = (200, 1500)
"""Number of solver steps of a case, which is enough for a motion and small enough for thousands of cases."""

RANGES: dict[str, tuple[float, float]] = {
    "gamma": (0.3, 3e3), "gamma_v": (0.1, 30), "gamma_r": (0.1, 30), "gamma_c": (0.1, 30), "kappa": (0.005, 0.5),
    "tau": (0.02, 2), "sigma": (0.01, 1), "nu": (0.01, 1), "M_0": (1, 30), "g_0": (0.005, 0.5), "mu": (0.1, 3),
    "margin": (0.05, 0.5), "covariance0": (1, 1e3), "covariance_bound": (2e3, 1e5), "forgetting": (0.01, 1),
    "bandwidth": (5, 80), "b_0": (0.5, 2), "alpha_0": (0.01, 1), "delta_0": (0.05, 0.8), "amplitude": (0.1, 30),
    "frequency": (0.1, 10), "frequency_start": (0.1, 1), "cycle": (0.01, 0.3), "frequency_end": (2, 20), "rate_limit": (1, 500),
    "quantization": (1e-4, 0.05), "gain": (0.5, 2), "lag": (0.005, 0.2), "std": (1e-4, 0.05), "radius": (0.5, 5),
    "width": (0.5, 3), "spread": (0.2, 2), "time_constant": (0.1, 2), "capacity": (1, 20), "anti_windup": (0.1, 10),
    "unmodelled_delay": (0.005, 0.05), "m": (1, 5), "sigma_bound": (10, 100), "lipschitz": (0.05, 0.5),
    "normalization": (0.1, 2), "k_r0": (0.5, 2), "duration": (0.5, 5), "history": (0.01, 1), "threshold": (0.1, 3),
    "jitter": (0.002, 0.4),
}  # fmt: skip
"""The range of each key's number, which is drawn evenly in its logarithm."""
WHOLE: dict[str, tuple[int, int]] = {
    "degree": (1, 2), "order": (1, 3), "neurons": (2, 6), "seed": (0, 99), "record_points": (2, 3000)
}  # fmt: skip
SIGNED = frozenset({"constant", "phase", "history", "initial"})
SHAPE = re.compile(r"\(([^()]*)\)")
FILES = {"csv": "recorded.csv", "mat": "recorded.mat"}
LEFT_OUT = frozenset({"A", "V_hat0", "c_0", "design_plant", "file", "filter_poles", "input_gain", "lower", "poles", "upper"})
"""Optional keys that need others and are added together with them."""
PHYSICAL = 0.3
"""Fraction of plants with one input that are given by A and b, often with parameters or a baseline."""
DRAWS = 8
"""Attempts at a controller that fits its problem. The package decides which settings fit together."""


def write_files(folder: Path) -> None:
    """Write the recordings that drawn cases refer to."""
    import numpy as np
    from scipy.io import savemat

    t = np.linspace(0.0, 20.0, 41)
    r = np.round(np.sin(t) + (t > 7), 3)
    (folder / FILES["csv"]).write_text("t,r\n" + "".join(f"{a},{b}\n" for a, b in zip(t, r, strict=True)), encoding="utf-8")
    savemat(folder / FILES["mat"], {"t": t, "r": r})


class Draw:
    """Draws a case: first its dimensions, then tables and values by the schema."""

    def __init__(self, rng: random.Random, folder: Path) -> None:
        self.rng, self.folder = rng, folder
        self.n = rng.choices((1, 2, 3, LARGEST_ORDER), (3, 6, 3, 1))[0]
        self.m = 1 if self.n == 1 or rng.random() < 0.85 else 2
        self.p = self.n
        self.steps = rng.randint(*STEPS)
        self.dt = rng.choice((5e-4, 1e-3, 2e-3, 5e-3))
        self.sample_time = self.dt * rng.choice((2, 5, 10))
        self.theta: list[float] = []
        self.output = rng.random() < 0.15
        self.known: Table = {}
        self.share = 0.0
        """Fraction of optional keys that are present. Most users' cases have few of them."""
        self.special: dict[str, Callable[[], Any]] = {
            "A_m": self.hurwitz, "b": self.input_matrix, "theta": self.parameters, "x0": lambda: self.vector(self.n),
            "k_0": self.feedforward, "uncertainty": self.known_set, "theta_hat0": self.inside, "nominal": self.inside,
            "filter": self.low_pass, "actuator": self.actuator, "multiplicative": self.multiplicative,
            "saturation": self.limits, "sample_time": lambda: self.sample_time, "delay": lambda: self.dt * rng.randint(1, 30),
            "start": lambda: self.dt * rng.randint(0, self.steps), "times": self.instants, "values": lambda: self.vector(3),
            "amplitudes": lambda: self.vector(2), "frequencies": lambda: [self.number("frequency") for _ in range(2)],
            "phases": lambda: self.vector(2), "output": self.combination, "direction": lambda: self.vector(self.n),
            "model_feedback": lambda: self.diagonal(self.n, -3.0),
            "scale": lambda: [1.0 + abs(x) for x in self.vector(self.n)], "predictor_poles": lambda: -rng.uniform(1, 20),
            "assumed_sample_time": lambda: self.sample_time * rng.uniform(0.8, 1.5), "terms": self.terms,
            "centers": lambda: [self.vector(self.n) for _ in range(self.p)], "labels": self.labels,
            "regressor": self.regressor, "specification": self.specification,
            "nonlinear": lambda: rng.choice(("0.3*sin(y)", "0.2*y/(1 + y*y)", "0.1*cos(t)*tanh(y)")),
        }  # fmt: skip

    # Numbers and arrays

    def number(self, key: str) -> float:
        low, high = RANGES.get(key, (0.2, 5.0))
        value = math.exp(self.rng.uniform(math.log(low), math.log(high)))
        return -value if key in SIGNED and self.rng.random() < 0.5 else value

    def vector(self, size: int, scale: float = 1.0) -> list[float]:
        return [round(self.rng.gauss(0, scale), 3) for _ in range(size)]

    def diagonal(self, size: int, sign: float) -> list[list[float]]:
        return [[sign * self.rng.uniform(0.5, 2) if i == j else 0.0 for j in range(size)] for i in range(size)]

    def hurwitz(self) -> list[list[float]]:
        """A Hurwitz matrix in companion form with real poles and pairs."""
        coefficients, left = [1.0], self.n
        while left:
            if left > 1 and self.rng.random() < 0.5:
                omega, zeta = self.rng.uniform(0.5, 5), self.rng.uniform(0.2, 1.0)
                factor = [1.0, 2 * zeta * omega, omega * omega]
            else:
                factor = [1.0, self.rng.uniform(0.5, 6)]
            left -= len(factor) - 1
            product = [0.0] * (len(coefficients) + len(factor) - 1)
            for i, x in enumerate(coefficients):
                for j, y in enumerate(factor):
                    product[i + j] += x * y
            coefficients = product
        chain = [[1.0 if j == i + 1 else 0.0 for j in range(self.n)] for i in range(self.n - 1)]
        return [*chain, [-round(c, 6) for c in reversed(coefficients[1:])]]

    def input_matrix(self) -> Any:
        last = self.rng.choice((1.0, 1.0, self.rng.uniform(0.2, 20), -self.rng.uniform(0.2, 5)))
        if self.m == 1:
            return [0.0] * (self.n - 1) + [last]
        return [[0.0] * self.m for _ in range(self.n - 2)] + [[1.0, 0.0], [0.2, last]]

    def parameters(self) -> Any:
        flat = self.vector(self.p * self.m, self.rng.choice((0.3, 1.0, 3.0)))
        self.theta = flat
        return flat if self.m == 1 else [flat[i * self.m : (i + 1) * self.m] for i in range(self.p)]

    def known_set(self) -> Table:
        wide = [self.rng.uniform(0.2, 3) for _ in self.theta]
        if self.rng.random() < 0.8:
            known = {
                "lower": [x - w * self.rng.uniform(0.1, 1) for x, w in zip(self.theta, wide, strict=True)],
                "upper": [x + w * self.rng.uniform(0.1, 1) for x, w in zip(self.theta, wide, strict=True)],
            }
            if self.rng.random() < 0.6:  # most people's sets contain 0, where estimates start by default
                known = {"lower": [min(x, -0.1) for x in known["lower"]], "upper": [max(x, 0.1) for x in known["upper"]]}
        else:
            known = {"center": [0.3 * x for x in self.theta], "radius": 0.8 * math.hypot(*self.theta) + 0.2}
        if self.rng.random() < 0.2:
            known["input_gain"] = [0.5, 2.0] if self.m == 1 else [[0.5, 2.0]] * self.m
        self.known = known
        return known

    def inside(self) -> list[float]:
        known = self.known
        if "lower" in known:
            return [self.rng.uniform(*ends) for ends in zip(known["lower"], known["upper"], strict=True)]
        return list(known.get("center", [0.9 * x for x in self.theta]))

    def feedforward(self) -> Any:
        if self.m == 1:
            return self.rng.choice((1.0, -1.0, 4.0, round(self.rng.uniform(0.2, 10), 3)))
        return [[1.0, 0.0], [0.0, 2.0]]

    def combination(self) -> Any:
        return [1.0] + [0.0] * (self.n - 1) if self.m == 1 else None

    def low_pass(self) -> Table:
        if self.rng.random() < 0.7:
            order = {"order": self.rng.randint(1, 3)} if self.rng.random() < 0.3 else {}
            return {"kappa": self.number("kappa"), **order}
        pole = self.rng.uniform(5, 100)
        return {"num": [pole], "den": [1.0, pole]}

    def actuator(self) -> Table:
        pole = self.rng.uniform(20, 200)
        second = {"num": [pole**2], "den": [1.0, self.rng.uniform(0.6, 2) * pole, pole**2]}
        return self.rng.choice(({"num": [pole], "den": [1.0, pole]}, second))

    def multiplicative(self) -> Table:
        return {"num": [-self.rng.uniform(0.001, 0.02), 0.0], "den": [self.rng.uniform(0.001, 0.01), 1.0]}

    def limits(self) -> list[float]:
        size = math.exp(self.rng.uniform(0, 5))
        return [-size * self.rng.uniform(0.5, 1), size]

    def instants(self) -> list[float]:
        return sorted(self.dt * k for k in self.rng.sample(range(1, self.steps), 3))

    def terms(self) -> list[str]:
        some = ["abs(x1)*x1", "sin(x1)", "tanh(x1)", "x1**3", *(f"x{i + 1}" for i in range(self.n))]
        return self.rng.sample(some, self.p)

    def labels(self) -> Table:
        size = 1 if self.output else self.n
        return {"names": [f"state {i}" for i in range(size)], "units": ["rad"] * size, "input_units": ["N m"] * self.m}

    def regressor(self) -> Table:
        kinds = self.variants(self.properties(self.definition("Plant"))["regressor"])
        chosen = self.rng.choice(sorted(kinds))
        if chosen == "polynomial":
            constant = self.rng.random() < 0.5
            self.p = math.comb(self.n + 2, 2) - (0 if constant else 1)
            return {"kind": chosen, "degree": 2, "constant": constant}
        self.p = self.rng.randint(1, self.n + 1) if chosen == "gaussian" else self.rng.randint(1, self.n)
        return self.table(kinds[chosen])

    def simulation(self) -> Table:
        table = {"t_end": self.steps * self.dt, "dt": self.dt}
        more = self.table(self.definition("Simulation"), without={**table, "tolerance": 0})  # which replaces dt
        if more.get("solver") == "auto":  # which needs a tolerance
            del more["solver"]
        return table | more

    def specification(self) -> Table:
        """At least one requirement. A gain is a factor above 1."""
        demands = {
            "settling": self.steps * self.dt * self.rng.uniform(0.1, 0.5), "overshoot": self.rng.uniform(0.02, 0.3),
            "u_max": self.number("amplitude"), "error": self.number("amplitude"),
            "delay": self.dt * self.rng.randint(1, 10), "gain": self.rng.uniform(1.1, 2),
        }  # fmt: skip
        return {key: demands[key] for key in self.rng.sample(sorted(demands), self.rng.randint(1, 3))}

    # The schema

    @staticmethod
    def definition(name: str) -> Table:
        return SCHEMA["$defs"][name]

    def resolved(self, spec: Table) -> Table:
        return self.definition(spec["$ref"].rsplit("/", 1)[1]) if "$ref" in spec else spec

    @staticmethod
    def properties(spec: Table) -> Table:
        return spec["properties"]

    def variants(self, spec: Table) -> dict[str, Table]:
        """The name that selects one of several tables."""
        if "discriminator" not in spec:
            spec = next(one for one in spec["oneOf"] if "discriminator" in one)
        return {name: self.resolved({"$ref": place}) for name, place in spec["discriminator"]["mapping"].items()}

    def table(self, spec: Table, without: Table | None = None) -> Table:
        """A table with its required keys and a fraction of the others."""
        found: Table = {}
        for key, value in self.properties(spec).items():
            if key in (without or ()) or (key not in spec.get("required", ()) and self.rng.random() >= self.share):
                continue
            drawn = self.value(key, value)
            if drawn is not None:
                found[key] = drawn
        return found

    def value(self, key: str, spec: Table) -> Any:
        if key in LEFT_OUT:
            return None
        if key in self.special and not (key == "filter" and spec.get("$ref", "").endswith("TransferFunction")):
            return self.special[key]()
        spec = spec if "$ref" not in spec else {**self.resolved(spec), "description": spec.get("description", "")}
        if "const" in spec:
            return spec["const"]
        if "enum" in spec:
            return self.rng.choice(spec["enum"])
        if "discriminator" in spec or any("discriminator" in one for one in spec.get("oneOf", ())):
            return self.one_of(spec)
        if spec.get("title") == "Modification":
            return self.modification(spec)
        if spec.get("title") == "TransferFunction":
            pole = self.rng.uniform(5, 100)
            return {"num": [pole], "den": [1.0, pole]}
        if "properties" in spec:
            return self.table(spec)
        return self.plain(key, spec)

    def one_of(self, spec: Table) -> Any:
        key = (spec if "discriminator" in spec else next(one for one in spec["oneOf"] if "discriminator" in one))["discriminator"]
        variants = self.variants(spec)
        chosen = self.rng.choice(sorted(variants))
        if chosen in FILES:
            return {"kind": chosen, "file": FILES[chosen]}
        return self.table(variants[chosen]) | {key["propertyName"]: chosen}

    def modification(self, spec: Table) -> Table | None:
        """A modification: fixed leakage, switching leakage or a dead zone."""
        keys = set(self.properties(spec))
        groups = [group for group in ({"sigma"}, {"sigma", "M_0"}, {"nu"}, {"g_0"}) if group <= keys]
        return {key: self.number(key) for key in self.rng.choice(groups)} if groups else None

    def plain(self, key: str, spec: Table) -> Any:
        given = [one.get("type") for one in spec.get("oneOf", (spec,))]
        kinds = [kind for one in given for kind in (one if isinstance(one, list) else [one])]
        if "number" in kinds:  # text would be a formula of physical parameters
            kinds = [kind for kind in kinds if kind != "string"]
        if "boolean" in kinds:
            return self.rng.random() < 0.5
        if "integer" in kinds:
            return self.rng.randint(*WHOLE.get(key, (1, 3)))
        if "string" in kinds:
            return self.rng.choice(("A", "a name", "Größe 2"))
        if "number" in kinds:
            return self.number(key)
        return self.array(spec)

    def array(self, spec: Table) -> Any:
        """A value of the shape with which its description begins. None if it has no shape."""
        shape = SHAPE.search(spec.get("description", ""))
        if not shape:
            return None
        sizes = {"n": self.n, "m": self.m, "p": self.p, "q": self.m, "p m": self.p * self.m, "n m": self.n * self.m}
        try:
            extents = [sizes[one.strip()] for one in shape[1].split(",") if one.strip()]
        except KeyError:
            return None
        if len(extents) == 1:
            return self.vector(extents[0])
        return [self.vector(extents[1]) for _ in range(extents[0])]

    # Whole cases

    def signal(self) -> Table:
        return self.one_of(self.properties(self.definition("Problem"))["reference"])

    def case(self) -> Table:
        """A problem with its required keys, a fraction of the others, and one to three controllers."""
        self.share = self.rng.choice((0.0, 0.05, 0.15, 0.3))
        return self.output_case() if self.output else self.state_case()

    def state_case(self) -> Table:
        plant_spec = self.definition("Plant")
        plant: Table = {}
        if self.m == 1 and self.rng.random() < self.share:
            plant["regressor"] = self.regressor()
        own = ("regressor", "A_m", "b", "C", "theta", "unmatched", "disturbance")
        plant |= self.table(plant_spec, without=dict.fromkeys(own, 0))
        plant |= {"A_m": self.hurwitz(), "b": self.input_matrix(), "theta": self.parameters()}
        if self.rng.random() < self.share:
            plant["disturbance"] = self.signal()
        if self.rng.random() < self.share:
            plant["unmatched"] = [{"direction": self.vector(self.n), "signal": self.signal()}]
        case: Table = {"name": "drawn", "plant": plant, "reference_model": {"k_0": self.feedforward()}}
        physical = self.m == 1 and "regressor" not in plant and self.rng.random() < PHYSICAL
        if not physical and self.rng.random() < 0.75:
            case["uncertainty"] = self.known_set()
        case["reference"] = self.signal() if self.m == 1 else [self.signal() for _ in range(self.m)]
        case["simulation"] = self.simulation()
        # these need a plant given by A and b, and an observer needs its measurements
        apart = dict.fromkeys(("controller", "parameters", "truth", "baseline", "observer"), 0)
        if physical:
            case |= self.physics(plant)
        case |= self.table(self.definition("Problem"), without={**case, **apart})
        if "follow" in case["reference_model"]:
            case["reference_model"]["follow"] = case.get("labels", {}).get("names", ["x_1"])[0]
        return case | {"controller": self.controllers(case)}

    def physics(self, plant: Table) -> Table:
        """A and b in place of A_m and theta, with formulas of parameters, and a baseline, or poles of the model. Some of these
        cases have a truth with other parameters, or an observer."""
        rng, n = self.rng, self.n
        del plant["A_m"], plant["theta"]
        self.theta, self.known = [0.0] * n, {}
        A: list[list[Any]] = [*self.hurwitz()[:-1], [round(rng.gauss(-1, 3), 3) for _ in range(n)]]
        case: Table = {"reference_model": {"poles": [-rng.uniform(0.5, 8) for _ in range(n)], "follow": ""}, "parameters": {}}
        for k in range(n if rng.random() < 0.7 else 0):
            value = A[-1][k]
            case["parameters"][f"k{k}"] = {"value": value, "between": [value - rng.uniform(0, 1), value + rng.uniform(0, 1)]}
            A[-1][k] = rng.choice((f"k{k}", f"0.5*k{k} + {value / 2}"))
        b = abs(plant["b"][-1])
        if case["parameters"] and rng.random() < 0.3:
            case["parameters"]["gain"] = {"value": b, "tolerance": rng.uniform(0.05, 0.4)}
            b = "gain"
        plant |= {"A": A, "b": [0.0] * (n - 1) + [b]}
        if not case["parameters"]:
            del case["parameters"]
        elif rng.random() < 0.3:
            name, one = rng.choice(sorted(case["parameters"].items()))
            case["truth"] = {"parameters": {name: one["value"] * rng.uniform(0.8, 1.25)}}
        if rng.random() < 0.6:
            case |= {"baseline": self.baseline("saturation" in plant.get("input", {})), "reference_model": {"follow": ""}}
        if "parameters" not in case and rng.random() < 0.75:
            case["uncertainty"] = {"lower": [-abs(one) for one in self.vector(n)], "upper": [abs(one) for one in self.vector(n)]}
        if rng.random() < 0.2:
            plant["C"] = [[1.0] + [0.0] * (n - 1)]
            case["observer"] = {"kind": "luenberger", "poles": [-rng.uniform(10, 40) - k for k in range(n)]}
        return case

    def baseline(self, limited: bool) -> Table:
        rng, weights = self.rng, [abs(one) + 0.1 for one in self.vector(self.n)]
        gains = {key: rng.uniform(0.5, 20) for key in ("k_p", "k_i")}
        kinds: list[Table] = [
            {"kind": "lqr", "Q": weights, "R": 1.0},
            {"kind": "lqi", "Q": [*weights, rng.uniform(1, 100)], "R": 1.0},
            {"kind": "pi", **gains},
            {"kind": "pid", **gains, "k_d": rng.uniform(0.1, 5), "T_f": rng.uniform(0.01, 0.1)},
        ]
        found = rng.choices(kinds, (3, 3, 1, 1))[0]  # the last two often do not stabilise the plant
        if found["kind"] != "lqr" and limited and rng.random() < 0.5:
            found["anti_windup"] = self.number("anti_windup")
        return found

    def output_case(self) -> Table:
        """A first- or second-order plant with its model and some of the optional keys."""
        self.n, self.m, self.p = 1, 1, 2
        pole, gain = self.rng.uniform(-1, 3), self.rng.uniform(0.5, 4)
        model = self.rng.uniform(1, 5)
        spec = self.definition("OutputPlant")
        plant = self.table(spec, without={"transfer_function": 0, "disturbance": 0, "output_disturbance": 0})
        plant["transfer_function"] = {"num": [gain], "den": [1.0, pole]}
        case: Table = {"name": "drawn", "plant": plant, "reference": self.signal(), "simulation": self.simulation()}
        case["reference_model"] = {"transfer_function": {"num": [model], "den": [1.0, model]}}
        case |= self.table(self.definition("OutputProblem"), without={**case, "controller": 0, "f": 0})
        self.theta = [0.0, 0.0]

        def adjust(one: Table) -> None:
            if one["scheme"] == "mrac-output":
                one |= {"order": 1, "relative_degree": 1, "sign": 1, "c_0_min": 0.05}
                one.pop("theta_hat0", None)
            if "m" in one:
                one["m"] = model

        return case | {"controller": self.controllers(case, adjust)}

    def controllers(self, case: Table, adjust: Callable[[Table], None] = lambda one: None) -> list[Table]:
        """One to three controllers that fit the case's problem, if DRAWS attempts find them. ``adjust`` fits one to its plant."""
        spec = self.properties(self.definition("OutputProblem" if self.output else "Problem"))["controller"]["items"]
        return [self.controller(case, spec, i, adjust) for i in range(self.rng.choices((1, 2, 3), (6, 3, 1))[0])]

    def controller(self, case: Table, spec: Table, place: int, adjust: Callable[[Table], None]) -> Table:
        one: Table = {}
        for _ in range(DRAWS):
            one = self.one_of(spec)
            if one["scheme"] == "linear":
                one = self.linear(one)
            if self.rng.random() < 0.5 and "sample_time" not in one:
                one["sample_time"] = self.sample_time
            if (
                "sample_time" in one
                and one["scheme"] != "l1-piecewise"
                and "discretization" not in one
                and self.rng.random() < 0.5
            ):
                one["discretization"] = "euler"
            one["name"] = f"{one['scheme']} {place}"
            adjust(one)
            if accepted(case | {"controller": [one]}, self.folder):
                break
        return one

    def linear(self, one: Table) -> Table:
        """A linear controller given by a design or by its matrices."""
        kept = {key: value for key, value in one.items() if key in ("scheme", "nominal", "sample_time", "anti_windup")}
        if self.rng.random() < 0.7:
            return {**kept, "design": "pi", "unmodelled_delay": self.number("unmodelled_delay")}
        return {**kept, "controller": {"num": [self.rng.uniform(0.1, 3)], "den": [1.0, self.rng.uniform(0.5, 5)]}}


def accepted(case: Table, folder: Path) -> bool:
    """Whether the package accepts these tables. Tables that crash it are kept, so the commands show the crash."""
    try:
        CaseText("", folder).case(copy.deepcopy(case))
    except InputError:
        return False
    except Exception:  # noqa: BLE001  # a finding, which a command that reads the case reports
        return True
    return True


def places(table: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all values of nested tables and lists."""
    keys = list(table) if isinstance(table, dict) else range(len(table))
    found = []
    for key in keys:
        found.append((*path, key))
        if isinstance(table[key], (dict, list)):
            found += places(table[key], (*path, key))
    return found


def at(table: Any, path: tuple[Any, ...]) -> Any:
    """The value at a path."""
    for key in path:
        table = table[key]
    return table


FIXED = frozenset({"simulation", "name", "order", "relative_degree", "sign"})
"""Keys whose numbers do not change, because the step is chosen for the plant."""


def changed(rng: random.Random, case: Table, folder: Path) -> Table:
    """A case with different plausible numbers, one key more or less and perhaps another controller."""
    case = copy.deepcopy(case)
    for path in places(case):
        value = at(case, path)
        if isinstance(value, float) and not FIXED & set(path) and rng.random() < 0.2:
            at(case, path[:-1])[path[-1]] = value * math.exp(rng.gauss(0, 0.4))
    plant = case["plant"]
    if "transfer_function" not in plant and "A" not in plant:
        draw = Draw(rng, folder)
        draw.output, draw.share, draw.n, draw.p = False, 0.1, len(plant["A_m"]), len(plant["theta"])
        draw.m = len(plant["b"][0]) if isinstance(plant["b"][0], list) else 1
        draw.theta = [x for row in plant["theta"] for x in (row if isinstance(row, list) else [row])]
        draw.known, draw.dt = case.get("uncertainty", {}), case["simulation"].get("dt", 1e-3)
        draw.sample_time = 5 * draw.dt
        for home, key, name in ((plant, "input", "PlantInput"), (case, "sensor", "Sensor")):
            if rng.random() < 0.3 and key not in home:
                home[key] = draw.table(draw.definition(name))
        if rng.random() < 0.4:
            case["controller"] += draw.controllers({key: value for key, value in case.items() if key != "controller"})
    for i, one in enumerate(case["controller"]):
        one["name"] = f"{i} {one.get('name', '')}".strip()
    return case
