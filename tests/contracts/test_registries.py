"""The contract of every registered name: an example, a row in docs/cases.md, a certificate for a scheme, and a form in case
files."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass, fields, is_dataclass
from importlib import import_module
from inspect import isabstract
from pathlib import Path
from pkgutil import walk_packages

import numpy as np
import pytest
from scipy.io import savemat

import barbalat
from barbalat.adaptation.laws import LAWS, OUTPUT_LAWS
from barbalat.cases import key_tables
from barbalat.cases.build import made
from barbalat.cases.keys import Context, Differences, keys_of
from barbalat.cases.load import parse_case
from barbalat.cases.schema import CASES, case_table, table_of
from barbalat.cases.table_models import Table
from barbalat.certificates.schemes import scheme_file
from barbalat.controllers import SCHEMES, Mrac, Sampled
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.explorer.commands import is_computed, is_formula
from barbalat.problem.regressors import REGRESSORS, Linear, Regressor
from barbalat.protocols import BoundedSignal, BreakingSignal, SettlingSignal
from barbalat.signals import SIGNALS
from barbalat.signals.recorded import MatFile, Recorded
from barbalat.signals.smooth import Clock, Constant, Continuous
from barbalat.solvers import SOLVERS, Tableau
from barbalat.solvers.tableau import AUTO
from contracts import case_examples
from independent import example_controllers, example_output_controllers, refusal

PAGE = (Path(__file__).parents[2] / "docs" / "cases.md").read_text(encoding="utf-8")
EXAMPLES = {
    "scheme": (SCHEMES, example_controllers(2)),
    "output scheme": (OUTPUT_SCHEMES, example_output_controllers(2)),
    "law": (OUTPUT_LAWS, case_examples.LAWS),
    "signal": (SIGNALS, case_examples.SIGNALS),
    "regressor": (REGRESSORS, case_examples.REGRESSORS),
}


@pytest.mark.parametrize("registry", EXAMPLES)
def test_every_registered_name_has_an_example_and_a_row_of_the_docs(registry):
    registered, examples = EXAMPLES[registry]
    lacking = [f"{name}: an example" for name in registered if name not in examples]
    lacking += [f"{name}: a row in docs/cases.md" for name in registered if f"\n| `{name}` |" not in PAGE]
    assert not lacking


def test_every_law_has_a_row_of_the_page_on_laws():
    page = (Path(__file__).parents[2] / "docs" / "laws.md").read_text(encoding="utf-8")
    assert not [name for name in LAWS if f"\n| `{name}` |" not in page]


def test_every_solver_has_its_name_in_the_docs():
    (row,) = {line for line in PAGE.splitlines() if line.startswith("| `simulation.solver` |")}
    assert not [name for name in SOLVERS if name not in row]


def test_every_scheme_has_a_certificate():
    examples = example_controllers(2) | {f"output {name}": given for name, given in example_output_controllers(2).items()}
    for name in [*SCHEMES, *(f"output {name}" for name in OUTPUT_SCHEMES)]:
        assert name in examples, f"{name} lacks an example in tests/independent.py"
        file = scheme_file(examples[name][0])
        assert file is not None, f"{name} lacks its file in certificates/schemes"
        assert callable(file.certificate) and callable(file.column), name


REGISTRIES = (SCHEMES, OUTPUT_SCHEMES, OUTPUT_LAWS, SIGNALS, REGRESSORS)
PUBLIC = {kind.__name__: kind for registry in REGISTRIES for kind in registry.values()}
PUBLIC |= {name.upper(): tableau for name, tableau in SOLVERS.items()}


HOMES = {
    "controllers": (barbalat, [*SCHEMES.values(), *OUTPUT_SCHEMES.values()]),
    "laws": (barbalat.laws, OUTPUT_LAWS.values()),
    "signals": (barbalat.signals, SIGNALS.values()),
    "regressors": (barbalat.regressors, REGRESSORS.values()),
}
"""The public modules with the registered names that they offer."""


@pytest.mark.parametrize("registry", HOMES)
def test_everything_registered_is_a_public_name(registry):
    home, registered = HOMES[registry]
    lacking = [kind.__name__ for kind in registered if getattr(home, kind.__name__, None) is not kind]
    assert not lacking, f"add them to the stub of {home.__name__}"


def test_every_solver_is_a_public_name():
    assert not [name for name, tableau in SOLVERS.items() if getattr(barbalat.solvers, name.upper(), None) is not tableau]


@pytest.mark.parametrize("name", [name for name, kind in PUBLIC.items() if isinstance(kind, type)])
def test_a_misspelt_keyword_is_told_with_the_one_that_is_meant(name):
    kind = PUBLIC[name]
    (first, *_) = [one.name for one in fields(kind) if one.init]
    with pytest.raises(TypeError, match=rf"{name} has no keyword '{first}s'; did you mean '{first}'\?"):
        kind(**{f"{first}s": 1.0})
    with pytest.raises(TypeError, match="known here: "):
        kind(qqq=1.0)


@pytest.mark.parametrize("name", [*(name for name, kind in PUBLIC.items() if isinstance(kind, type)), "Problem", "OutputProblem"])
def test_a_value_too_many_by_position_is_told_which_are_keywords(name):
    kind = PUBLIC.get(name) or getattr(barbalat, name)
    places = [one.name for one in fields(kind) if one.init and not one.kw_only]
    said = ", ".join(places) or "nothing"
    with pytest.raises(TypeError, match=f"^{name} takes {said} without a keyword, got {len(places) + 1} value"):
        kind(*range(len(places) + 1))


@pytest.mark.parametrize(
    ("made", "same"),
    [
        (lambda: barbalat.RobustMrac(0.5, barbalat.laws.LeastSquares(500.0)), {"tau": 0.5}),
        (lambda: barbalat.KnownParameters([1.0, 2.0]), {"theta": [1.0, 2.0]}),
        (lambda: barbalat.plants.Noise(0.1, 0.01), {"std": [0.1], "sample_time": 0.01}),
        (lambda: barbalat.laws.SwitchingSigma(0.2, 5.0), {"sigma": 0.2, "M_0": 5.0}),
        (lambda: barbalat.laws.LeastSquaresBounded(9.0, forgetting=1.0, covariance_bound=99.0), {"covariance0": 9.0}),
        (lambda: barbalat.regressors.Polynomial(3), {"degree": 3}),
    ],
)
def test_what_a_class_is_about_stands_first(made, same):
    assert all(np.array_equal(getattr(made(), name), value) for name, value in same.items())


def test_what_is_lacking_is_named_with_the_whole_call():
    with pytest.raises(TypeError, match=r"^Square needs frequency too: Square\(amplitude, frequency, phase, constant\)$"):
        barbalat.signals.Square(1)
    with pytest.raises(TypeError, match=r"^RobustMrac needs law too: RobustMrac\(tau, law, c_0=\.\.\."):
        barbalat.RobustMrac(0.1)


def test_a_class_of_somebody_else_may_take_any_keyword():
    class Own(Mrac):
        def __init__(self, **given):
            super().__init__(given["speed"])

    assert Own(speed=3.0).gamma == 3.0
    assert copy.copy(Own(speed=3.0)).gamma == pickle.loads(pickle.dumps(Mrac(3.0))).gamma == 3.0


ROOMS = {
    "controllers": lambda kind: is_dataclass(kind) and hasattr(kind, "bind"),
    "adaptation.laws": lambda kind: is_dataclass(kind) and hasattr(kind, "rates") and not isabstract(kind),
    "signals": lambda kind: is_dataclass(kind) and hasattr(kind, "before"),
    "problem.regressors": lambda kind: isinstance(kind, type) and is_dataclass(kind) and issubclass(kind, Regressor),
    "solvers": lambda value: isinstance(value, Tableau),
}
NO_CHOICE_OF_A_CASE = (Sampled, Clock, Linear, AUTO)
"""Classes that a case file does not select by a kind. Sampling is two keys of every controller, t is needed by a plant's formula,
phi(x) = x is used without a key, and auto is the solver that a tolerance selects."""


@pytest.mark.parametrize("room", ROOMS)
def test_everything_written_is_registered(room):
    """No class or tableau in these folders and files is missing from every registry."""
    place = import_module(f"barbalat.{room}")
    inside = [import_module(found.name) for found in walk_packages(getattr(place, "__path__", ()), f"{place.__name__}.")]
    written = {name: value for module in (place, *inside) for name, value in vars(module).items() if ROOMS[room](value)}
    known = (*PUBLIC.values(), *NO_CHOICE_OF_A_CASE)
    assert written
    assert not [name for name, value in written.items() if not any(value is each for each in known)]


def test_the_docs_hold_what_the_registries_make():
    assert key_tables.page(PAGE) == PAGE, "run: python -m barbalat.cases.key_tables docs/cases.md"


@pytest.mark.parametrize("problem", CASES)
def test_editors_get_a_schema(problem):
    """The JSON Schema contains every kind and scheme, and each key has a description."""
    schema = case_table(problem).model_json_schema()
    assert all(value["description"] for value in schema["properties"].values())
    tags = {value.get("const") for table in schema["$defs"].values() for value in table["properties"].values()}
    assert tags >= {*CASES[problem], *SIGNALS}
    for table in schema["$defs"].values():
        assert table["additionalProperties"] is False
        for key, value in table["properties"].items():
            assert value["description"], (table["title"], key)


def test_every_key_has_a_meaning():
    """The meaning of a key is written once, in the docstring of the settings, for the docs and for the schema that editors
    use."""
    for problem in CASES:
        case_table(problem)
    tables = [table for table in Table.__subclasses__() if table.recipe.settings.__module__.startswith("barbalat.")]
    assert len(tables) > 30
    lacking = [f"{table.__name__}.{name}" for table in tables for name, key in table.recipe.keys.items() if not key.meaning]
    assert not lacking


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "r.csv").write_text(case_examples.CSV)
    savemat(tmp_path / "r.mat", {"t": [0.0, 1.0], "r": [1.0, 2.0]})
    return tmp_path


def of_case_file(registry, name, folder):
    """The object made from the example's table."""
    registered, examples = EXAMPLES[registry]
    table = table_of(registered[name], "kind", name).model_validate({"kind": name, **examples[name]})
    return made(table, Context(folder), name)


@pytest.mark.parametrize(("registry", "name"), [(r, name) for r in ("signal", "regressor", "law") for name in EXAMPLES[r][0]])
def test_a_case_file_says_it(registry, name, folder):
    """Each key sets the field of the same name."""
    registered, examples = EXAMPLES[registry]
    found = of_case_file(registry, name, folder)
    assert type(found) is {MatFile: Recorded}.get(
        registered[name], registered[name]
    )  # a MATLAB file is another form of the same signal
    for key, value in examples[name].items():
        if key != "file":
            np.testing.assert_array_equal(getattr(found, key), value)


@pytest.mark.parametrize("name", REGRESSORS)
def test_a_regressor_computes_as_many_components_as_it_says(name, folder):
    found = of_case_file("regressor", name, folder)
    assert isinstance(found, Regressor)
    assert found(np.array([0.3, -0.7])).shape == (found.size(2),) == (2,)


@pytest.mark.parametrize("name", SIGNALS)
@pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 3)])
def test_a_signal_has_the_shape_of_the_times(name, shape, folder):
    signal, t = of_case_file("signal", name, folder), np.full(shape, 0.25)
    assert isinstance(signal, BoundedSignal)
    assert np.shape(signal(t)) == shape
    assert np.shape(signal.before(t)) == shape


@pytest.mark.parametrize("name", SIGNALS)
def test_before_is_the_limit_from_the_left(name, folder):
    """``before`` is the value just before every instant of the grid, including jumps. The tolerance is 1e-6 because smooth
    signals move by that much in 1e-8 s."""
    signal, t = of_case_file("signal", name, folder), np.linspace(0, 20, 401)
    np.testing.assert_allclose(signal.before(t[1:]), signal(t[1:] - 1e-9), atol=1e-6)


@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_says_where_it_jumps_or_bends(name, folder):
    """Jumps and bends are where second differences exceed 1e-6, which is ten times the second differences of the fastest smooth
    example over 1e-4 s."""
    signal, h = of_case_file("signal", name, folder), 1e-4
    t = h * np.arange(-10, 200_000)
    broken = t[1:-1][np.abs(np.diff(signal(t), 2)) > 1e-6]
    said = signal.breaks(-1.0, 30.0) if isinstance(signal, BreakingSignal) else np.zeros(0)
    for instant in broken:
        assert np.abs(said - instant).min(initial=np.inf) <= h
    for instant in said[(said > t[0]) & (said < t[-1])]:
        assert name == "chirp" or np.abs(broken - instant).min(initial=np.inf) <= h  # in which only the frequency bends


@pytest.mark.parametrize("name", SIGNALS)
def test_the_bound_of_a_signal_bounds_it(name, folder):
    """The bound holds on a dense grid and is not far too large."""
    signal = of_case_file("signal", name, folder)
    largest = np.abs(signal(np.linspace(0, 50, 20_001))).max()
    assert 0.6 * signal.bound <= largest <= signal.bound


@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_says_whether_it_settles(name, folder):
    """Every example that settles is constant after a thousand seconds."""
    signal = of_case_file("signal", name, folder)
    assert isinstance(signal, SettlingSignal)
    assert signal.settles == (np.ptp(signal(np.linspace(1000, 1100, 1001))) == 0)


@pytest.mark.parametrize("name", SIGNALS)
def test_a_page_computes_a_signal_without_jumps(name, folder):
    signal = of_case_file("signal", name, folder)
    assert is_computed(signal) == isinstance(signal, Continuous)


def test_of_a_signal_that_is_no_formula_a_page_keeps_rows():
    assert is_formula(Constant(1.0)) and not is_computed(Ramp(1.0)) and not is_computed(Branching(1.0))


@dataclass(frozen=True)
class Ramp(Continuous):
    """slope t.

    slope  [1/s]
    """

    slope: float

    def __call__(self, t):
        return self.slope * np.asarray(t)


class Branching(Ramp):
    def __call__(self, t):
        return self.slope * t if t > 1 else t


@dataclass(frozen=True, eq=False, kw_only=True)
class Half(Mrac):
    """The MRAC with half of its gain.

    share  of the gain
    """

    share: float = 0.5


@pytest.fixture
def registered(monkeypatch):
    """A signal and a scheme from outside the package, each with one line in its registry."""
    monkeypatch.setitem(SIGNALS, "ramp", Ramp)
    monkeypatch.setitem(SCHEMES, "half", Half)
    for cached in (case_table, table_of):
        cached.cache_clear()
    yield
    for cached in (case_table, table_of):
        cached.cache_clear()


CASE = """
name = "c"
plant = { A_m = [[-1.0]], b = [1.0], theta = [1.0] }
reference_model = { k_0 = 1.0 }
reference = { kind = "ramp", slope = 2 }
simulation = { t_end = 1.0, dt = 0.1 }
[[controller]]
scheme = "half"
gamma = 3.0
share = 0.25
sample_time = 0.2
modification = { sigma = 0.1 }
"""


@pytest.mark.usefixtures("registered")
def test_a_registry_line_is_all_that_case_files_need():
    case = parse_case(CASE)
    assert case.problem.reference(np.array([3.0])) == [6.0]
    (sampled,) = case.controllers
    assert (sampled.controller.share, sampled.controller.leakage.sigma, sampled.sample_time) == (0.25, 0.1, 0.2)
    assert "reference.slope is missing" in refusal(lambda: parse_case(CASE.replace(", slope = 2", "")))
    assert "did you mean 'share'" in refusal(lambda: parse_case(CASE.replace("share", "shrae")))
    assert "controller 1.tau has no meaning for half" in refusal(lambda: parse_case(CASE.replace("share", "tau")))
    assert "|  | `slope` | number | required | [1/s] |" in key_tables.page(PAGE)
    assert keys_of(Half, Differences())["gamma"].meaning == keys_of(Mrac, Differences())["gamma"].meaning != ""
