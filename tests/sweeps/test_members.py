"""A member's number determines its values and every bit of its metrics, whatever is simulated with it."""

import re

import numpy as np
import pytest
from scipy.stats import kstest, norm

from barbalat import InputError, load_case, simulate
from barbalat.cases.load import CaseText
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.probe import Kind
from barbalat.open_numbers.varied import VariedCase, VariedObjects
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import BLOCK_DRAWS, Design, Plan
from barbalat.sweeps.spread import Axis, InBall, LogUniform, Normal, Uniform
from barbalat.sweeps.study import Study
from barbalat.sweeps.sweep import replay
from independent import refusal

SHORT = CaseText.read("paper").text.replace("t_end = 60.0", "t_end = 1.0").replace("dt = 1e-4", "dt = 1e-3")
DELAYED = SHORT.replace("x0 = [1.0, 1.0]", "x0 = [1.0, 1.0]\ninput = { delay = 0.02 }").replace(
    "[reference_model]", "[sensor]\nnoise = { std = 0.01, sample_time = 0.01 }\n[reference_model]"
)


def study(text, plan):
    return Study(VariedCase(CaseText(text), plan.paths), plan)


A, B, C = (FieldPath.parse(name) for name in ("plant.theta[0]", "plant.theta[1]", "controller[0].gamma"))


@pytest.mark.parametrize("design", list(Design))
def test_members_are_made_alone_as_they_are_made_together(design):
    axes = {} if design is Design.SALTELLI else {C: Axis(1.0, 100.0, 3, True)}
    plan = Plan(axes, {A: Uniform(-1.0, 2.0), B: Normal(0.0, 1.0)}, 16, design, seed=3)
    together = plan.values(0, len(plan))
    for k in (0, 7, 15, 16, 33, len(plan) - 1):
        np.testing.assert_array_equal(plan.values(k, 1)[0], together[k])
    assert len(plan) == (16 * 4 if design is Design.SALTELLI else 48)


def test_every_block_is_a_latin_hypercube(monkeypatch):
    monkeypatch.setattr("barbalat.sweeps.plan.BLOCK_DRAWS", 50)
    plan = Plan({}, {A: Uniform(0.0, 1.0), B: Uniform(0.0, 1.0)}, 120)
    values = plan.values(0, 120)
    for first, count in ((0, 50), (50, 50), (100, 20)):
        strata = np.sort((values[first : first + count] * count).astype(int), axis=0)
        np.testing.assert_array_equal(strata, np.tile(np.arange(count)[:, None], 2))  # one in each, in each dimension
    assert BLOCK_DRAWS == 2**16


@pytest.mark.parametrize(
    ("spread", "law"),
    [
        (Uniform(-2.0, 3.0), lambda x: (x + 2) / 5),
        (LogUniform(1.0, 100.0), lambda x: np.log(x) / np.log(100)),
        (Normal(1.0, 2.0), lambda x: norm.cdf(x, 1, 2)),
    ],
)
def test_draws_have_their_distribution(spread, law):
    values = Plan({}, {A: spread}, 2000, Design.RANDOM, 1).values(0, 2000)[:, 0]
    assert kstest(law(values), "uniform").pvalue > 1e-3


def test_saltellis_matrices_differ_in_one_column():
    plan = Plan({}, {A: Uniform(0.0, 1.0), B: Uniform(0.0, 1.0), C: Uniform(0.0, 1.0)}, 8, Design.SALTELLI)
    matrices = plan.values(0, len(plan)).reshape(5, 8, 3)
    for i, one in enumerate(matrices[2:]):
        for column in range(3):
            np.testing.assert_array_equal(one[:, column], matrices[1 if column == i else 0][:, column])
    assert not (matrices[0] == matrices[1]).any()


def test_kinds_are_found_by_trying():
    given = {
        "plant.theta[0]": "uniform:-1:1", "controller[1].filter.kappa": "uniform:0.01:0.05", "reference.amplitude": "uniform:1:9",
    }  # fmt: skip
    draws = sampled(CaseText(SHORT), list(given.items()))
    found = study(SHORT, Plan({FieldPath.parse("simulation.dt"): Axis(1e-3, 5e-4, 2)}, draws, 4))
    assert found.kinds == (Kind.STRUCTURE, Kind.COPIED, Kind.FOLLOWED, Kind.SIGNAL)


def test_what_is_copied_equals_what_the_objects_give():
    """kappa and A_m are computed by objects, but theta, gamma and x0 are copied. Both give bit by bit the numbers from the
    members' cases."""
    text = CaseText(SHORT)
    draws = sampled(
        text, [("plant.theta", "known-set"), ("controller[1].gamma", "loguniform:1:1e4"), ("plant.x0[0]", "normal:0:1")]
    )
    axes = {
        FieldPath.parse("controller[1].filter.kappa"): Axis(0.01, 0.05, 3),
        FieldPath.parse("plant.A_m[1][0]"): Axis(-0.5, -0.2, 2),
    }
    found = study(SHORT, Plan(axes, draws, 40))
    setting = found.setting(found.tried.middle)
    rows = found.values(0, len(found))
    assert sorted(setting.copied) == [2, 3, 4, 5]
    for copied, made in zip(setting.numbers(rows), setting._all_made(rows), strict=True):
        assert copied.identical(made)


def test_no_bit_depends_on_who_else_is_simulated_and_a_member_alone_is_the_same():
    text = CaseText(DELAYED)
    draws = sampled(text, [("plant.theta", "known-set"), ("plant.input.delay", "uniform:0.005:0.03")])
    axes = {FieldPath.parse("reference.amplitude"): Axis(1.0, 40.0, 2), FieldPath.parse("simulation.dt"): Axis(1e-3, 5e-4, 2)}
    found = study(DELAYED, Plan(axes, draws, 9))
    together = found.run(0, len(found))
    fresh = study(DELAYED, found.plan)
    part = fresh.run(13, 11)
    for name, values in part.items():
        np.testing.assert_array_equal(values, together[name][13:24])
    again = replay(found, 20)
    assert again.differing({name: float(values[20]) for name, values in together.items()}) == []
    assert again.differing({"L1/rms_e[0]": 1.0}) == ["L1/rms_e[0]"]
    for result in again.results:  # the recorded run is the run whose metrics these are
        assert np.abs(result.e).max(axis=0) == pytest.approx(result.metrics.max_abs_e[0], rel=1e-2)


def test_a_member_is_the_run_of_its_case():
    """``simulate`` compiles its numbers in, so roundings differ. A thousand smooth steps hardly amplify them."""
    found = study(SHORT, Plan({}, sampled(CaseText(SHORT), [("plant.theta", "known-set")]), 5))
    columns = found.run(0, 5)
    case = found.varied.at(found.values(3, 1)[0])
    for name, result in simulate(case.problem, case.controllers, case.simulation).items():
        for figure in ("max_abs_e", "rms_e", "theta_hat_final"):
            got = [columns[f"{name}/{figure}[{i}]"][3] for i in range(2)]
            np.testing.assert_allclose(got, result.figures[figure], rtol=1e-8, atol=1e-10)


def test_objects_and_case_files_give_the_same():
    text = CaseText(SHORT)
    plan = Plan({FieldPath.parse("controller[2].gamma"): Axis(1.0, 2.0, 2)}, {A: Uniform(-1.0, 1.0)}, 3)
    by_objects = Study(VariedObjects(text.case(), plan.paths), plan).run(0, 6)
    for name, values in study(SHORT, plan).run(0, 6).items():
        np.testing.assert_array_equal(values, by_objects[name])


def test_a_refused_member_is_named():
    plan = Plan({}, {FieldPath.parse("controller[1].gamma"): Normal(1.0, 0.5)}, 300)
    found = study(SHORT, plan)
    member = int((found.values(0, 300)[:, 0] <= 0).argmax())
    with pytest.raises(InputError, match=f"member {member}: .*gamma must be positive"):
        found.run(0, 300)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("plant.theta[7]", "has 2 entries"),
        ("plant.theta", "name one entry, such as plant.theta\\[0\\]"),
        ("controller[0].gama", "unknown key"),
        ("controller[9].gamma", "has 3 entries"),
        ("name", "not a number"),
        ("plant..theta", "keys and indices"),
        ("simulation.dt[0]", "not a list"),
    ],
)
def test_paths_that_name_no_number(path, message):
    with pytest.raises(InputError, match=message):
        study(SHORT, Plan({FieldPath.parse(path): Axis(1.0, 2.0, 2)}))


@pytest.mark.parametrize(
    ("path", "message"),
    [("plant.thet[0]", "has no 'thet'"), ("controller[5].gamma", "3 entries"), ("name", "not a single number")],
)
def test_fields_that_are_no_number(path, message):
    plan = Plan({FieldPath.parse(path): Axis(1.0, 2.0, 2)})
    with pytest.raises(InputError, match=message):
        Study(VariedObjects(load_case("paper"), plan.paths), plan)


@pytest.mark.parametrize(
    "text",
    ["1:2", "1:2:0", "1:2:x", "a:2:3", "0:1:3:log", "1:2:3:lin", "1:1:3", "nan:1:2", "1:inf:2", "-1e308:1e308:3", "0:1:99999999"],
)  # fmt: skip
def test_bad_ranges(text):
    with pytest.raises(InputError):
        Axis.parse(text)


def test_more_members_than_a_sweep_can_have_are_refused_in_words():
    axis = Axis(0.0, 1.0, 10**7)
    assert "at most 1e+10 members, got 1e+14" in refusal(lambda: Plan({A: axis, B: axis}))
    assert "from 1 to 10000000000" in refusal(lambda: Plan({}, {A: Uniform(0.0, 1.0)}, 10**30))


@pytest.mark.parametrize(
    "text", ["uniform:1", "uniform:2:1", "loguniform:0:1", "normal:0:0", "gauss:0:1", "uniform:a:1", "uniform:-1e308:1e308", ""]
)
def test_bad_distributions(text):
    with pytest.raises(InputError, match="theta"):
        sampled(CaseText(SHORT), [("plant.theta[0]", text)])


def test_a_misspelt_list_offers_the_nearest_path():
    path = FieldPath.parse("plant.theata[0]")
    assert "did you mean 'plant.theta[0]'?" in refusal(lambda: path.put({"plant": {"theta": [1.0], "b": [1.0]}}, 2.0))


BALL = SHORT.replace("lower = [-5.0, -5.0]\nupper = [5.0, 5.0]", "center = [1.0, -2.0]\nradius = 3.0")


def test_draws_over_a_ball_are_even_and_inside():
    """The volume within a fraction s of the radius is proportional to s^d, and all directions are equally likely."""
    center = (1.0, -2.0, 0.5)
    draws = {FieldPath.parse(f"plant.theta[{k}]"): InBall(center, 3.0, k) for k in range(3)}
    for design in (Design.LATIN, Design.RANDOM):
        plan = Plan({}, draws, 4000, design, seed=2)
        away = (plan.values(0, len(plan)) - center) / 3.0
        distance = np.linalg.norm(away, axis=1)
        assert (distance <= 1).all()
        assert kstest(distance**3, "uniform").pvalue > 1e-3
        for direction in np.random.default_rng(0).normal(size=(5, 3)):  # Archimedes: even along any axis of the sphere
            assert kstest(away @ direction / distance / np.linalg.norm(direction), "uniform", (-1, 2)).pvalue > 1e-3
    with pytest.raises(InputError, match="independent"):
        Plan({}, draws, 16, Design.SALTELLI)


def test_a_known_set_is_drawn_from_whatever_the_case_gives():
    """The cases have a box of a matrix, a ball, an input gain, and a plant given by A, from which theta follows."""
    ball = sampled(CaseText(BALL), [("plant.theta", "known-set")])
    assert list(map(str, ball.values())) == ["ball:[1.0, -2.0]:3.0, entry 1", "ball:[1.0, -2.0]:3.0, entry 2"]
    text = CaseText.read("lateral-aircraft")
    draws = sampled(text, [("plant.theta", "known-set")])
    assert {str(path): str(one) for path, one in draws.items()}["plant.theta[7]"] == "uniform:-100.0:100.0"
    assert len(draws) == 8 and sampled(text.case(), [("plant.theta[0]", "uniform:0:1")])
    varied = VariedCase(text, tuple(draws))
    plant, made = text.case().problem.plant, varied.at(np.arange(8.0)).problem.plant
    np.testing.assert_array_equal(varied.at(plant.theta).problem.plant.theta, plant.theta)
    np.testing.assert_array_equal(made.theta, np.arange(8.0))
    np.testing.assert_array_equal(made.A_m, plant.A_m)
    gain = sampled(CaseText.read("f16-short-period"), [("plant.input.gain", "known-set"), ("plant.theta", "known-set")])
    assert str(gain[FieldPath.parse("plant.input.gain")]) == "uniform:0.3:1.5" and len(gain) == 3
    several = sampled(CaseText.read("mass-spring-damper"), [("plant.input[1].gain", "known-set")])
    assert list(map(str, several.values())) == ["uniform:0.1:2.0"]
    objects = sampled(load_case("paper"), [("plant.theta", "known-set")])
    assert list(map(str, objects)) == ["plant.theta[0]", "plant.theta[1]"]


@pytest.mark.parametrize(
    ("case", "path", "message"),
    [
        ("paper", "reference.amplitude", "as many entries"),
        ("paper", "plant.input.gain", "needs the interval of the input gain"),
        ("flexible-joint", "parameters.K_s", "write parameters.K_s=between"),
        ("payload-drop", "plant.theta", "the case has none"),
        ("rohrs", "plant.theta", "the case has no plant.theta"),
        ("paper", "plant.thet", "the case has no plant.thet"),
    ],
)
def test_what_has_no_known_set(case, path, message):
    with pytest.raises(InputError, match=message):
        sampled(CaseText.read(case), [(path, "known-set")])


@pytest.mark.parametrize(
    ("name", "path", "axis"),
    [("quadrotor-pitch", "plant.A[1][1]", Axis(-0.55, -0.45, 7)), ("wing-rock", "plant.b[1]", Axis(0.9, 1.1, 23))],
)
def test_a_number_that_is_computed_anew_may_end_in_another_last_bit(name, path, axis):
    """A_m of a plant given by A and P of that A_m are constant up to rounding, which the few tried values need not show."""
    plan = Plan({FieldPath.parse(path): axis}, {}, 1)
    made = study(re.sub(r"t_end = [\d.e+]+", "t_end = 1.0", CaseText.read(name).text), plan)
    found = made.run(0, len(plan))
    for member in (0, len(plan) - 2):
        case = made.varied.at(plan.values(member, 1)[0])
        for one, result in simulate(case.problem, case.controllers, case.simulation).items():
            assert found[f"{one}/max_abs_e[0]"][member] == pytest.approx(result.metrics.max_abs_e[0][0], rel=1e-9)
