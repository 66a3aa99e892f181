"""How the keys of plant, model, known set and signals differ from the fields of their classes, and the builders of these
objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import GenericAlias

from barbalat.cases.keys import REQUIRED, Context, Differences, Given, Key, keys_of
from barbalat.cases.physical_tables import physical_plant, scale_of_states, with_formulas
from barbalat.cases.table_models import FORMS, chosen
from barbalat.judge.settings import Judge
from barbalat.judge.specification import Specification
from barbalat.linear.pole_placement import place
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.actuation import PlantInput
from barbalat.problem.baseline import BASELINES, Baseline, SystemBaseline
from barbalat.problem.known_set import ParameterBall, ParameterBox
from barbalat.problem.labels import UNLABELLED
from barbalat.problem.measurement import Sensor
from barbalat.problem.observer import OBSERVERS, Observer
from barbalat.problem.output_feedback import OutputPlant, OutputProblem
from barbalat.problem.parameters import Parameter
from barbalat.problem.physical import PhysicalPlant
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import Disturbance
from barbalat.problem.truth import Truth
from barbalat.protocols import Signal
from barbalat.signals import Constant, MatFile, Recorded
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError, Matrix, Vector, counted, hint, local_path, show


@dataclass(frozen=True)
class Uncertainty:
    """[uncertainty]: a box or a ball; the intervals of unknown input gains."""


_BOX, _BALL = (keys_of(kind, Differences()) for kind in (ParameterBox, ParameterBall))


def _data_file(given: Given, context: Context) -> Path:
    """The file that a table names; a relative path starts at the case file's folder."""
    return context.folder / local_path("file", given.pop("file"))


def _as_given(given: Given, _: Context) -> Given:
    """For a table that makes no separate object, because the problem combines several tables."""
    return given


def _problem(given: Given, context: Context) -> Problem:
    """Disturbances are keys of the plant, the input gain is a key of the known set, and A is combined with the model."""
    plant, model, known = given.pop("plant"), given.pop("reference_model"), given.pop("uncertainty", {})
    disturbances = {key: plant.pop(key) for key in ("disturbance", "unmatched") if key in plant}
    baseline = given.pop("baseline", None)
    given = _with_measured(given, plant)
    if given.get("truth") is not None and context.raw is not None:
        given = given | {"truth": with_formulas(given["truth"], context.raw)}
    if baseline is not None:
        return _around_baseline(baseline, given | {"plant": plant, "reference_model": model}, disturbances, known, context)
    if "k_0" not in model and "follow" not in model:
        raise InputError.of(
            "reference_model.k_0", "is missing (or give reference_model.follow, the state that follows the command)"
        )
    reference_model = ReferenceModel(k_0=model.get("k_0"), follow=model.get("follow"))
    parameters = given.pop("parameters", None)
    if parameters and context.raw is not None:
        physical = physical_plant(context.raw, parameters)
        made = _nominal_plant(physical, plant, model, reference_model, given, context)
    else:
        made = _plant(plant, model)
    return Problem(plant=made, reference_model=reference_model, **disturbances, **known, **given)


def _with_measured(given: Given, plant: Given) -> Given:
    """The given values, with plant.C moved from the plant to the observer as its measurement."""
    C, observer = plant.pop("C", None), given.get("observer")
    if C is None:
        return given
    if observer is None:
        raise InputError.of("plant.C", "declares the measurement, so state feedback needs [observer], which is missing")
    if observer.measured is not None:
        raise InputError.of("observer.measured", "and plant.C are both given; give one of them")
    return given | {"observer": replace(observer, measured=C)}


def _around_baseline(baseline: Baseline, given: Given, disturbances: Given, known: Given, context: Context) -> Problem:
    """The problem whose model is the closed loop of the baseline with the nominal plant; ``known`` describes the deviation from
    that plant."""
    plant, model = given.pop("plant"), given.pop("reference_model")
    for table, keys, at in ((model, ("A_m", "poles", "k_0"), "reference_model"), (plant, ("A_m", "theta", "regressor"), "plant")):
        for key in keys:
            if key in table:
                raise InputError.of(
                    f"{at}.{key}", "and baseline are both given; the model is the plant of plant.A and plant.b with the baseline"
                )
    if "A" not in plant:
        raise InputError.of("plant.A", "is missing; the baseline acts on x' = A x + b u")
    follow = model.get("follow")
    if follow is None:
        raise InputError.of(
            "reference_model.follow", "is missing: name the state that is to track the command under the baseline"
        )
    parameters, labels = given.pop("parameters", None), given.get("labels")
    of_states = len(plant["A"])
    rows = _rows_of(follow, (labels or UNLABELLED).of_states(of_states))
    if len(rows) != (inputs := len(plant["b"][0]) if isinstance(plant.get("b", [0])[0], (list, tuple)) else 1):
        raise InputError.of(
            "reference_model.follow",
            f"must name {counted(inputs, 'state')}, one for each input, got {counted(len(rows), 'state')}",
        )
    baseline = replace(baseline, output=rows)  # type: ignore[type-var]  # every kind is a dataclass
    reference_model = ReferenceModel(follow=follow)
    if parameters and context.raw is not None:
        physical = physical_plant(context.raw, parameters)
        nominal = Plant(physical=physical, baseline=baseline)
        scale, said = scale_of_states(nominal, reference_model, given.get("reference"), labels, context.judge, context.t_end)
        made = Plant(physical=physical, baseline=baseline, scale=scale, scale_from=said)
    else:
        made = Plant(**plant, baseline=baseline)
    assert made.baseline is not None
    departure = known.pop("uncertainty", None)
    if departure is not None:
        wanted = made.states * made.inputs
        if departure.size != wanted:
            raise InputError.of(
                f"uncertainty.{departure.first_field}",
                f"must have {counted(wanted, 'entry')} with a baseline, to bound the deviation of the plant, got "
                f"{departure.size}",
            )
        known["uncertainty"] = made.baseline.around_nominal(departure)
    return Problem(plant=made, reference_model=reference_model, **disturbances, **known, **given)


def _rows_of(follow: str | tuple[str, ...], names: tuple[str, ...]) -> list[list[float]]:
    """The rows of C, one for each followed state."""
    followed = (follow,) if isinstance(follow, str) else tuple(follow)
    for state in followed:
        if state not in names:
            raise InputError.of(
                "reference_model.follow",
                f"does not name a state, got {show(state)}; the states are {', '.join(names)}{hint(state, names)}",
            )
    return [[float(name == state) for name in names] for state in followed]


def _system_of(given: Given, _: Context) -> SystemBaseline:
    """The system from num and den, or from A, B, C and D."""
    if given.keys() == {"num", "den"}:
        return SystemBaseline(TransferFunction(**given))
    if given.keys() != {"A", "B", "C", "D"}:
        raise InputError.of(
            "baseline", f"must have either num and den, or A, B, C and D, got {', '.join(sorted(given)) or 'neither'}"
        )
    return SystemBaseline(StateSpace(**given))


def _nominal_plant(
    physical: PhysicalPlant, plant: Given, model: Given, reference_model: ReferenceModel, given: Given, context: Context
) -> Plant:
    """The plant at its nominal parameters, with the formulas and the scales of its states."""
    for key in ("A_m", "theta", "regressor"):
        if key in plant:
            raise InputError.of(
                f"plant.{key}", "and parameters are both given; with parameters, plant.A and plant.b define the plant"
            )
    if ("A_m" in model) == ("poles" in model):
        raise InputError("give either reference_model.A_m or reference_model.poles with plant.A")
    A, b = physical.matrices(physical.nominal)
    A_m = place(A, b, model["poles"]) if "poles" in model else model["A_m"]
    commands, labels = given.get("reference"), given.get("labels")
    nominal = Plant(physical=physical, A_m=A_m)  # rejects an A_m that does not fit
    scale, said = scale_of_states(nominal, reference_model, commands, labels, context.judge, context.t_end)
    return Plant(physical=physical, A_m=A_m, scale=scale, scale_from=said)


def _plant(plant: Given, model: Given) -> Plant:
    """The plant, given by A_m and theta, or by A with the model's A_m or poles."""
    if "A" not in plant:
        if "A_m" not in plant:
            raise InputError.of("plant.A_m", "is missing (or give plant.A together with reference_model.A_m or .poles)")
        if "theta" not in plant:
            raise InputError.of("plant.theta", "is missing")
        if "poles" in model:
            raise InputError.of("reference_model.poles", "needs plant.A, which is missing")
        if model.get("A_m", plant["A_m"]) != plant["A_m"]:
            raise InputError.of(
                "reference_model.A_m", "differs from plant.A_m; give one of them, or plant.A with reference_model.A_m"
            )
        return Plant(**plant)
    if "A_m" in plant:
        raise InputError.of("plant.A", "and plant.A_m are both given; use plant.A with reference_model.A_m")
    if "theta" in plant:
        raise InputError.of("plant.A", "and plant.theta are both given; theta follows from plant.A and reference_model.A_m")
    if "regressor" in plant:
        raise InputError.of("plant.A", "and plant.regressor are both given; with plant.A the regressor is the state")
    if ("A_m" in model) == ("poles" in model):
        raise InputError("give either reference_model.A_m or reference_model.poles with plant.A")
    return Plant(**plant, **{key: model[key] for key in ("A_m", "poles") if key in model})


def _uncertainty(given: Given, _: Context) -> Given:
    """The known set: exactly one of a box and a ball, or only the input gains."""
    found = {key: value for key, value in given.items() if key != "input_gain"}
    gain = {key: value for key, value in given.items() if key == "input_gain"}
    if gain and not found:
        return gain
    if found.keys() not in (_BOX.keys(), _BALL.keys()):
        got = ", ".join(sorted(found)) or "nothing"
        raise InputError.of("uncertainty", f"must have either lower and upper, or center and radius, got {got}")
    return {"uncertainty": ParameterBox(**found) if "lower" in found else ParameterBall(**found), **gain}


def _output_problem(given: Given, _: Context) -> OutputProblem:
    plant = given.pop("plant")
    disturbances = {key: plant.pop(key) for key in ("disturbance", "output_disturbance") if key in plant}
    return OutputProblem(plant=OutputPlant(**plant), **disturbances, **given)


_NAME = Key(str, "of the case")
_JUDGE = Key(Judge, "the limits for following, loss and limit cycles; by default derived from the model's motion", None)
_SPECIFICATION = Key(
    Specification, "the requirements on a controller for `barbalat design`; no other command reads this table", None
)
_DISTURBANCE = Key(Signal | None, "matched disturbance, which enters with u; none by default", None)

MEASURED = chosen(
    {"labels": GenericAlias(list, (str,)), "matrix": FORMS["matrix"]},
    lambda value: "matrix" if isinstance(value, list) and value and isinstance(value[0], list) else "labels",
)
STATES = chosen(
    {"names of states": GenericAlias(list, (str,)), "matrix": FORMS["matrix"]},
    lambda value: "matrix" if isinstance(value, list) and value and isinstance(value[0], list) else "names of states",
)

OF_OBSERVERS = Key(
    MEASURED, "y = C x: the labels of the measured states, or C, (p, n), which may be given as `plant.C` instead", None
)

DIFFERENCES: dict[type, Differences] = {
    Parameter: Differences(without=("name",), make=_as_given),
    Truth: Differences(
        keys={
            "A": Key(Matrix, "(N, N): different dynamics, possibly with more states than the plant", None),
            "b": Key(Array, "(N,), or (N, m)", None),
            "C": Key(Matrix, "(p, N): the output matrix for its states, instead of that of `observer`", None),
            "x0": Key(Vector, "(N,) initial state; the plant's by default", None),
            "input": Key(PlantInput | tuple[PlantInput, ...], "the input dynamics, instead of `plant.input`", None),
            "sensor": Key(Sensor, "the sensor, instead of the case's `sensor`", None),
            "states": Key(
                STATES,
                "names of its states, or of the first ones, or a matrix (n, N). A state corresponds to the plant's state of the "
                "same name",
                None,
            ),
            "disturbance": Key(Signal | None, "matched disturbance, instead of the plant's", None),
        },
    ),
    Problem: Differences(
        keys={
            "parameters": Key(
                Mapping[str, float | Parameter],
                "physical parameters by name, each a number or a table; a string in plant.A, plant.b, plant.x0, plant.input, "
                "sensor or truth (but not in its friction) is a formula in them",
                None,
            ),
            "baseline": Key(
                Baseline | None,
                "the existing fixed controller, to which adaptive laws add their control; the model is its loop with `plant.A` "
                "and `plant.b`, and `reference_model` has only `follow`",
                None,
            ),
            "observer": Key(
                Observer | None,
                "the estimator of a state that is not measured; it is a part of every controller and is designed for the "
                "nominal plant. Without it the state is measured",
                None,
            ),
            "uncertainty": Key(
                Uncertainty,
                "the known set Omega; without it there is no projection. With `baseline` it bounds the plant's deviation "
                "from the nominal plant",
                None,
            ),
            "simulation": Key(Simulation, "how to simulate"),
            "judge": _JUDGE,
            "specification": _SPECIFICATION,
            "name": _NAME,
        },
        required=("reference_model", "reference"),
        without=("input_gain", "disturbance", "unmatched"),
        make=_problem,
    ),
    OutputProblem: Differences(
        keys={"simulation": Key(Simulation, "how to simulate"), "judge": _JUDGE, "name": _NAME},
        required=("reference",),
        without=("disturbance", "output_disturbance"),
        make=_output_problem,
    ),
    Plant: Differences(
        keys={
            "A": Key(
                Matrix,
                "instead of A_m and theta: x' = A x + b u; theta follows from A = A_m + b theta' with `reference_model.A_m`",
                None,
            ),
            "C": Key(Matrix | None, "(p, n): the measurement y = C x for `observer`, which then does not need `measured`", None),
            "disturbance": _DISTURBANCE,
            "unmatched": Key(tuple[Disturbance, ...], "other disturbances: direction (n,) times the signal is added to x'", None),
        },
        optional=("A_m", "theta"),
        without=("physical", "scale", "scale_from", "baseline", "nominal_A", "declared"),
        make=_as_given,
    ),
    **{kind: Differences(without=("output",)) for kind in BASELINES.values()},
    **{kind: Differences(keys={"measured": OF_OBSERVERS}) for kind in OBSERVERS.values()},
    SystemBaseline: Differences(
        keys={
            "num": Key(Vector | None, "of K(s), highest power first; with `den`", None),
            "den": Key(Vector | None, "of K(s); with `num`", None),
            "A": Key(Matrix | None, "instead of num and den: A of its state space, with B, C and D", None),
            "B": Key(Array | None, "of its state space", None),
            "C": Key(Array | None, "of its state space", None),
            "D": Key(float | None, "of its state space", None),
        },
        without=("output", "system"),
        make=_system_of,
    ),
    OutputPlant: Differences(
        keys={
            "disturbance": _DISTURBANCE,
            "output_disturbance": keys_of(OutputProblem, Differences())["output_disturbance"],
        },
        make=_as_given,
    ),
    ReferenceModel: Differences(
        keys={
            "A_m": Key(Matrix, "with `plant.A`", None),
            "poles": Key(
                tuple[float | Vector, ...],
                "with `plant.A`: the model's poles, placed by state feedback; give a complex pair once, as [real, imaginary]",
                None,
            ),
        },
        make=_as_given,
    ),
    Uncertainty: Differences(
        keys={
            **{name: key._replace(default=None) for name, key in (_BOX | _BALL).items()},
            "input_gain": Key(
                Array,
                "[lower, upper] > 0: "
                "the input gain is unknown, estimated and always projected; with a box, a ball or neither. A list of pairs "
                "for several inputs",
                None,
            ),
        },
        make=_uncertainty,
    ),
    Constant: Differences(keys={"amplitude": Key(float, "the value", REQUIRED, "value")}),
    Recorded: Differences(
        keys={
            "file": Key(
                str,
                "a file with a column of times, a column of values and an optional header; relative to the case file",
                REQUIRED,
                "path",
            ),
            "separator": Key(
                str,
                "the separator of the columns: comma, semicolon, tab or space"
                "; detected by default. With separators other than the comma, numbers may have a decimal comma",
                None,
            ),
        },
        without=("times", "values"),
        make=lambda given, context: Recorded.from_csv(_data_file(given, context), **given),
    ),
    MatFile: Differences(make=lambda given, context: Recorded.from_mat(_data_file(given, context), **given)),
}
