"""Extremes, requirements and sensitivities, compared with formulas and exact values."""

import numpy as np
import pytest

from barbalat import InputError
from barbalat.open_numbers.path import FieldPath
from barbalat.sweeps import sensitivity
from barbalat.sweeps.chunks import Chunk, UnstoredChunks
from barbalat.sweeps.evidence import Extremes, evidence
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.spread import Axis, Uniform

PATHS = [FieldPath.parse(name) for name in ("a", "b", "c")]


def rows(**columns):
    made = UnstoredChunks(None)
    made.add(Chunk(0, 0), {name.replace("_in_", "/"): np.asarray(values) for name, values in columns.items()})
    return made


def test_extremes_are_over_the_members_that_have_the_figure():
    found = Extremes.of(np.array([3.0, np.nan, 1.0, 7.0, 2.0]))
    assert (found.min, found.median, found.max, found.worst_member, found.finite) == (1.0, 2.5, 7.0, 3, 4)
    assert Extremes.of(np.array([np.nan, 5.0, 4.0]), smallest=True).worst_member == 2
    assert Extremes.of(np.full(3, np.nan)) is None


@pytest.mark.parametrize(
    ("text", "broken"),
    [
        ("max_abs_e[0] < 2", [False, True, True, True]),
        ("max_abs_e<=2", [False, False, True, True]),
        ("  L1/max_abs_e[1]   >= 1e0 ", [True, False, True, True]),
        ("max_abs_e > -1", [False, False, False, True]),
    ],
)
def test_requirements(text, broken):
    names = ["L1/max_abs_e[0]", "L1/max_abs_e[1]", "Other/max_abs_e[0]"]
    columns = {"L1/max_abs_e[0]": [1.0, 2.0, 3.0, np.nan], "L1/max_abs_e[1]": [0.0, 1.0, 0.0, np.nan]}
    requirement = Requirement.parse(text)
    found = [requirement.broken(np.array(columns[name])) for name in requirement.columns(names, "L1")]
    assert np.logical_or.reduce(found).tolist() == broken


@pytest.mark.parametrize(
    "text",
    ["", "max_abs_e", "< 2", "max_abs_e < ", "max_abs_e < x", "1 < a < 2", "a == 2", "a < nan", "__import__('os') < 1e999"],
)
def test_what_is_no_requirement(text):
    with pytest.raises(InputError, match="a requirement must be"):
        Requirement.parse(text)


def test_a_requirement_on_no_figure_is_refused():
    with pytest.raises(InputError, match="choose one of max_abs_e"):
        Requirement.parse("max_e < 2").require_known(["member", "L1/max_abs_e[0]"], ("L1",))


def test_failures_come_first_and_a_diverged_member_breaks_every_requirement():
    made = rows(
        member=np.arange(4.0),
        **{
            "L1/diverged_at": np.array([np.nan, 0.5, np.nan, np.nan]),
            "L1/max_abs_e[0]": np.array([1.0, np.nan, 3.0, 1.0]),
            "L1/oscillated": np.array([0.0, np.nan, 1.0, 0.0]),
            "L1/error_bound": np.array([2.0, 2.0, 2.0, np.nan]),
        },
    )
    found = evidence(made, ["L1"], [Requirement.parse("max_abs_e[0] < 2")], Plan({PATHS[0]: Axis(0.0, 1.0, 4)}))
    counts = {name: (by["L1"].count, by["L1"].judged) for name, by in found.shares.items()}
    assert counts == {
        "diverged": (1, 4), "oscillated": (1, 3), "max_abs_e[0] < 2": (2, 4), "above the guaranteed bound": (2, 3),
    }  # fmt: skip
    assert found.filled["L1"].max == 1.5 and found.metrics["diverged_at"]["L1"].worst_member == 1
    assert next(iter(found.shares)) == "diverged"


def ishigami(x):
    """First-order indices 0.3139, 0.4424, 0 and total ones 0.5576, 0.4424, 0.2437 (Ishigami and Homma, 1990; a = 7, b = 0.1)."""
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def indices(plan):
    x = plan.values(0, len(plan))
    columns = {str(path): x[:, i] for i, path in enumerate(plan.paths)}
    made = rows(member=np.arange(len(plan)), **columns, **{"L1/max_abs_e[0]": ishigami(x), "L1/max_abs_u": x[:, 0] * np.nan})
    found, notes = sensitivity.sensitivities(made, ["L1"], plan)
    assert notes == [f"L1: {len(plan)} members without max_abs_u, whose variance is therefore unknown"]
    return found


ANGLES = {path: Uniform(-np.pi, np.pi) for path in PATHS}


def test_sobol_indices_of_saltellis_design():
    found = indices(Plan({}, ANGLES, 2**12, Design.SALTELLI))
    assert [one.first for one in found] == pytest.approx([0.3139, 0.4424, 0.0], abs=0.02)
    assert [one.total for one in found] == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.02)
    assert all(one.low < one.first < one.high for one in found)
    assert found == indices(Plan({}, ANGLES, 2**12, Design.SALTELLI))  # the bootstrap is seeded


def test_sobol_indices_of_any_sample():
    found = indices(Plan({}, ANGLES, 2**13))
    assert [one.first for one in found] == pytest.approx([0.3139, 0.4424, 0.0], abs=0.03)


def test_main_effects_of_a_grid_and_of_draws_at_its_points():
    """For 2 x + 3 y + noise, the variances add up."""
    plan = Plan({PATHS[0]: Axis(0.0, 1.0, 5)}, {PATHS[1]: Uniform(0.0, 1.0), PATHS[2]: Uniform(0.0, 1.0)}, 2000)
    x = plan.values(0, len(plan))
    y = 2 * x[:, 0] + 3 * x[:, 1]
    made = rows(member=np.arange(len(plan)), **{str(p): x[:, i] for i, p in enumerate(plan.paths)}, **{"L1/max_abs_e[0]": y})
    found, _ = sensitivity.sensitivities(made, ["L1"], plan)
    parts = [4 * np.var(np.linspace(0, 1, 5)), 9 / 12, 0.0]
    assert [one.first for one in found] == pytest.approx([part / sum(parts) for part in parts], abs=0.01)


@pytest.mark.parametrize("scale", [2.0**-565, 2.0**520], ids=["squares underflow", "squares overflow"])
@pytest.mark.parametrize(
    "plan",
    [
        Plan({PATHS[0]: Axis(0.0, 1.0, 3), PATHS[1]: Axis(0.0, 1.0, 5)}),
        Plan({}, ANGLES, 256),
        Plan({}, ANGLES, 2**8, Design.SALTELLI),
    ],
    ids=["grid", "draws", "saltelli"],
)
def test_shares_of_a_variance_do_not_depend_on_the_unit(plan, scale):
    """A power of two changes no digit of a metric and therefore no bit of a fraction, although the plain variance is then 0 or
    infinite."""
    x = plan.values(0, len(plan))
    columns = {str(path): x[:, i] for i, path in enumerate(plan.paths)}
    figure = x @ np.arange(2.0, 2.0 + x.shape[1]) + x[:, 0] * x[:, 1]

    def found(values):
        made = rows(member=np.arange(len(plan)), **columns, **{"L1/max_abs_e[0]": values})
        return sensitivity.sensitivities(made, ["L1"], plan)[0]

    with np.errstate(over="ignore"):
        assert not 0 < np.var(scale * figure) < np.inf
    assert found(scale * figure) == found(figure) != []


def test_why_fewer_members_are_held_against_a_bound():
    """Two of five members have no bound. The fraction refers to three, and the reason is stated."""
    columns = {"max_abs_e[0]": [1.0, 2.0, 3.0, 4.0, 5.0], "diverged_at": [np.nan] * 5, "oscillated": [0.0] * 5}
    columns["error_bound"] = [2.0, np.nan, 2.0, np.nan, 9.0]
    found = rows(member=np.arange(5), a=np.arange(5.0), **{f"L1/{name}": one for name, one in columns.items()})
    plan = Plan({PATHS[0]: Axis(0.0, 4.0, 5)})
    made = evidence(found, ("L1",), [], plan)
    assert made.shares["above the guaranteed bound"]["L1"].as_json()["judged"] == 3
    assert any(note.startswith("L1: 2 of 5 members have no guaranteed bound") for note in made.notes)


def test_what_decides_the_verdicts_comes_first():
    """Of three numbers, the second alone determines which members follow, and the first shifts the boundary."""
    from types import SimpleNamespace

    from barbalat.sweeps.picture import deciding

    a, b, c = np.random.default_rng(0).random((3, 400))
    kinds = np.where(b + 0.2 * a > 0.6, 3.0, 2.0)
    columns = {"a": a, "b": b, "c": c, "L1/verdict": kinds, "L1/tail_max_abs_e[0]": c}
    plan = SimpleNamespace(paths=PATHS)

    class Found:
        controllers = ("L1",)

        def __init__(self, columns):
            self.columns, self.plan = columns, plan

        def __len__(self):
            return 400

        def column(self, name):
            return self.columns[name]

    assert [str(path) for path in deciding(Found(columns))] == ["b", "a", "c"]
    same = Found(columns | {"L1/verdict": np.full(400, 2.0)})
    assert str(deciding(same)[0]) == "c"  # none follows: the members with the larger errors
