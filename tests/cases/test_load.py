"""Case files: every key reaches its field, and everything unusable is rejected in one clear sentence."""

import re
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from barbalat import InputError, L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac
from barbalat.adaptation.laws import (
    Gradient,
    IntegralCost,
    LeastSquares,
    LeastSquaresBounded,
    LeastSquaresBoundedGain,
    LeastSquaresForgetting,
    LeastSquaresResetting,
)
from barbalat.cases.bundled import bundled
from barbalat.cases.load import load_case, parse_case, text_to_start_from
from barbalat.controllers import SCHEMES
from barbalat.controllers.output.l1 import fast_limit, linear_equivalent
from barbalat.signals import SIGNALS, Sines
from barbalat.solvers import SOLVERS
from case_texts import DRIVE
from independent import as_toml, refusal

PAPER = bundled()["paper"].read_text()
LAW = '{ kind = "least-squares", covariance0 = 500.0 }'


def edited(old: str, new: str) -> str:
    assert old in PAPER
    return PAPER.replace(old, new, 1)


def test_paper_case_says_section_v():
    case = load_case("paper")
    plant = case.problem.plant
    np.testing.assert_array_equal(plant.A_m, [[0, 1], [-0.3, -1]])
    np.testing.assert_array_equal([*plant.b, *plant.theta, *plant.x0], [0, 1, 4, -3, 1, 1])
    assert case.problem.reference_model.k_0 == 4
    assert case.problem.reference(np.array([np.pi]))[0] == pytest.approx(50)
    assert (case.simulation.t_end, case.simulation.dt, case.simulation.solver.name) == (60, 1e-4, "rk4")
    robust, l1, mrac = case.controllers
    assert isinstance(robust, RobustMrac) and robust.tau == 0.5 and robust.law.covariance0 == 500
    assert isinstance(l1, L1Adaptive) and l1.gamma == 1e4
    assert l1.filter.poles == pytest.approx([-50])
    assert isinstance(mrac, Mrac)


LINEAR = """
[[controller]]
name = "K"
scheme = "linear"
"""


def test_linear_controllers():
    settings = LINEAR + "controller = { num = [20.0, 30.0], den = [1.0, 0.0] }\noutput = [1.0, 1.0]\nunmodelled_delay = 0.02\n"
    *_, given = parse_case(PAPER + settings).controllers
    assert isinstance(given, LinearFeedback)
    assert given.controller.response(np.array([2.0]))[0] == pytest.approx((20 * 2j + 30) / 2j)
    assert given.output.tolist() == [1.0, 1.0]
    assert abs(given.unmodelled.at(1j)) == pytest.approx(0.02, rel=1e-3)
    *_, pi = parse_case(PAPER + LINEAR + 'design = "pi"\n').controllers
    assert pi.controller.order == 1


def test_the_hinf_design():
    pytest.importorskip("slycot")
    *_, designed = parse_case(PAPER + LINEAR + 'design = "hinf"\nbandwidth = 5.0\n').controllers
    assert isinstance(designed, LinearFeedback) and designed.name == "K"


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ("", "either controller"),
        ('design = "pi"\ncontroller = { num = [1.0], den = [1.0] }', "either controller"),
        ('design = "pi"\nbandwidth = 3.0', "bandwidth"),
        ('design = "pi"\nunmodelled_delay = -1.0', "unmodelled_delay"),
        ('design = "pi"\ntheta_hat0 = [0.0, 0.0]', "theta_hat0"),
        ('design = "lqg"', "design"),
        ("controller = { num = [1.0, 0.0], den = [1.0] }", "proper"),
    ],
)
def test_linear_controllers_that_cannot_be(settings, words):
    with pytest.raises(InputError, match=words):
        parse_case(PAPER + LINEAR + settings)


@pytest.mark.parametrize("name", [*bundled(), str(bundled()["paper"].parents[1] / "template.toml")])
def test_every_bundled_file_loads(name):
    assert load_case(name).controllers


def test_other_keys():
    text = edited(
        'kind = "sine"\namplitude = 50.0\nfrequency = 0.5',
        'kind = "sines"\namplitudes = [1, 2]\nfrequencies = [3, 4]\nconstant = 5',
    )
    text += '\n[[controller]]\nscheme = "mrac-normalized"\ngamma = 3\nprojection = false\ntheta_hat0 = [7.0, 8.0]\n'
    case = parse_case(text)
    assert isinstance(case.problem.reference, Sines)
    assert case.problem.reference(np.zeros(1))[0] == 5
    last = case.controllers[-1]
    assert isinstance(last, NormalizedMrac) and isinstance(last.law, Gradient) and last.law.gamma == 3.0
    equations = last.bind(case.problem.known)
    assert equations.estimate_set is None and equations.theta_hat0.tolist() == [7, 8]


LAW_TABLES = {
    'kind = "gradient", gamma = [1, 2]': (Gradient, {"gamma": [1, 2]}),
    'kind = "gradient", gamma = [[2, 1], [1, 2]], sigma = 0.1': (Gradient, {"gamma": [[2, 1], [1, 2]], "leakage.sigma": 0.1}),
    'kind = "gradient", gamma = 1, nu = 0.1, g_0 = 0.2': (Gradient, {"leakage.nu": 0.1, "dead_zone.g_0": 0.2}),
    'kind = "integral-cost", gamma = 1, forgetting = 0.5': (IntegralCost, {"forgetting": 0.5}),
    'kind = "least-squares", covariance0 = [3, 4]': (LeastSquares, {"covariance0": [3, 4]}),
    'kind = "least-squares-forgetting", covariance0 = 3, forgetting = 0.2': (LeastSquaresForgetting, {"forgetting": 0.2}),
    'kind = "least-squares-resetting", rho_0 = 3, rho_1 = 0.2': (LeastSquaresResetting, {"rho_0": 3, "rho_1": 0.2}),
    'kind = "least-squares-bounded", covariance0 = 3, forgetting = 0.2, covariance_bound = 9, sigma = 1, M_0 = 5': (
        LeastSquaresBounded,
        {"covariance_bound": 9, "leakage.sigma": 1, "leakage.M_0": 5},
    ),
    'kind = "least-squares-bounded-gain", covariance0 = 3, forgetting = 0.2, covariance_bound = 9': (
        LeastSquaresBoundedGain,
        {"covariance_bound": 9},
    ),
}


@pytest.mark.parametrize("keys", LAW_TABLES)
def test_every_law_of_a_case_file(keys):
    kind, values = LAW_TABLES[keys]
    law = parse_case(edited(LAW, f"{{ {keys} }}")).controllers[0].law
    assert type(law) is kind
    for path, value in values.items():
        np.testing.assert_array_equal(attrgetter(path)(law), value)


def test_modifications_and_learning_of_the_lyapunov_laws():
    learning = "learning = { gamma_c = 2.0, time_constant = 0.5, forgetting = 0.1, capacity = 3.0 }"
    mrac = parse_case(edited("gamma = 1.0", f"gamma = [1.0, 2.0]\nmodification = {{ sigma = 0.1, M_0 = 9.0 }}\n{learning}"))
    settings = mrac.controllers[-1]
    assert (settings.leakage.sigma, settings.leakage.M_0, settings.learning.capacity) == (0.1, 9.0, 3.0)
    l1 = parse_case(edited("gamma = 1e4", "gamma = 1e4\nmodification = { nu = 0.1, g_0 = 0.2 }")).controllers[1]
    assert (l1.leakage.nu, l1.dead_zone.g_0, l1.learning) == (0.1, 0.2, None)


def test_a_ball_in_a_case_file():
    known_set = parse_case(
        edited("lower = [-5.0, -5.0]\nupper = [5.0, 5.0]", "center = [1.0, 0.0]\nradius = 6.0")
    ).problem.uncertainty
    assert (known_set.center.tolist(), known_set.radius) == ([1, 0], 6)


def test_unstable_plant_by_matching():
    text = edited("A_m = [[0.0, 1.0], [-0.3, -1.0]]", "A = [[0.0, 1.0], [3.7, -4.0]]").replace("theta = [4.0, -3.0]\n", "")
    case = parse_case(text.replace("k_0 = 4.0", "k_0 = 4.0\nA_m = [[0.0, 1.0], [-0.3, -1.0]]"))
    np.testing.assert_allclose(case.problem.plant.theta, [4, -3], atol=1e-12)  # A - A_m = b theta'


def test_csv_is_relative_to_the_case_file(tmp_path):
    (tmp_path / "r.csv").write_text("t,r\n0,0\n10,20\n")
    (tmp_path / "case.toml").write_text(
        edited('kind = "sine"\namplitude = 50.0\nfrequency = 0.5', 'kind = "csv"\nfile = "r.csv"')
    )
    assert load_case(tmp_path / "case.toml").problem.reference(np.array([5.0]))[0] == 10


def test_disturbance():
    case = parse_case(edited("x0 = [1.0, 1.0]", 'x0 = [1.0, 1.0]\ndisturbance = { kind = "step", amplitude = 2.0, start = 1.0 }'))
    assert case.problem.disturbance(np.array([0.5, 1.0])).tolist() == [0, 2]


def test_input_dynamics():
    case = parse_case(edited("[plant]", "[plant]\ninput = { delay = 0.01, actuator = { num = [2500], den = [1, 100, 2500] } }"))
    assert case.problem.delay == 0.01
    assert case.problem.plant.input.dynamics.poles == pytest.approx([-50, -50])


BAD = [
    ("A_m = ", "A_n = ", ["plant.A_n", "'A_m'"]),
    ("kappa = 0.02", "kapa = 0.02", ["controller 2.filter.kapa", "'kappa'"]),
    ("[simulation]", "[simulatoin]", ["simulatoin", "'simulation'"]),
    ("frequency = 0.5", "frequncy = 0.5", ["reference.frequncy", "'frequency'"]),
    ("frequency = 0.5", "frequency = 0.5\nfrequncy = 1", ["reference.frequncy; known here: ", "frequency"]),
    ("gamma = 1e4", "gamma = 'high'", ["controller 2.gamma", '"high"']),
    ("gamma = 1e4", "gamma = -1.0", ["controller 2 (L1)", "gamma must be positive", "-1.0"]),
    ("gamma = 1e4", "gamma = true", ["controller 2.gamma", "true"]),
    ('scheme = "l1"', 'scheme = "l2"', ["l2", ", ".join([*SCHEMES][:6])]),
    ('kind = "sine"', 'kind = "sinus"', ["reference.kind", "sinus", "'sines'"]),
    ("k_0 = 4.0", "", ["reference_model.k_0 is missing"]),
    ("theta = [4.0, -3.0]", "theta = [4.0, -3.0, 1.0]", ["plant.theta", "shape 2", "got 3"]),
    ("theta = [4.0, -3.0]", "theta = [4.0, nan]", ["plant.theta 2", "finite", "nan"]),
    ("[-0.3, -1.0]", "[0.3, -1.0]", ["plant.A_m", "Hurwitz", "0.2416"]),
    ("b = [0.0, 1.0]", "b = [0.0, 0.0]", ["controllable", "[0.0, 0.0]"]),
    ("dt = 1e-4", "dt = 7e-4", ["simulation.dt", "divide", "0.0007"]),
    ("dt = 1e-4", "dt = 0.0", ["simulation.dt", "positive"]),
    ("t_end = 60.0", "t_end = inf", ["simulation.t_end", "finite"]),
    ('solver = "rk4"', 'solver = "rk5"', ["euler, heun, rk4", "rk5"]),
    ("kappa = 0.02", "num = [1.0], den = [1.0, -1.0]", ["stable", "real part 1"]),
    ("kappa = 0.02", "num = [1.0, 1.0], den = [2.0, 1.0]", ["strictly proper"]),
    ("kappa = 0.02", "num = [1.0, 1.0, 1.0], den = [2.0, 1.0]", ["strictly proper"]),
    ("kappa = 0.02", "num = [2.0], den = [1.0, 1.0]", ["DC gain", "got 2"]),
    ("kappa = 0.02", "num = [2.0]", ["filter"]),
    ("kappa = 0.02", "kappa = -1", ["kappa", "-1"]),
    ("c_0 = [1.0, 1.0]", "c_0 = [-1.0, 1.0]", ["minimum phase", "real part 1"]),
    ("c_0 = [1.0, 1.0]", "c_0 = [0.0, 0.0]", ["c_0 must not be zero"]),
    ("lower = [-5.0, -5.0]", "lower = [6.0, 6.0]", ["uncertainty.lower", "6 > 5", "empty"]),
    ('scheme = "l1"', 'scheme = "l1"\ntheta_hat0 = [6.0, 0.0]', ["theta_hat0", "known set"]),
    ("upper = [5.0, 5.0]", "upper = [5.0]", ["uncertainty.upper"]),
    ('name = "L1"', 'name = "MRAC"', ["'MRAC'", "2 times"]),
    ('name = "L1"', 'name = ""', ["controller 2.name"]),
    ("covariance0 = 500.0", "gamma = 1.0", ["law.covariance0 is missing"]),
    ("covariance0 = 500.0", "covariance0 = 500.0, gamma = 1.0", ["law.gamma", "no meaning", "least-squares"]),
    ("covariance0 = 500.0", "covariance0 = [1.0, 2.0, 3.0]", ["law.covariance0", "2 parameters"]),
    ("covariance0 = 500.0", "covariance0 = 500.0, sigma = 0.1", ["FixedSigma", "lower bound", "SwitchingSigma"]),
    ("covariance0 = 500.0", "covariance0 = 500.0, M_0 = 5.0", ["M_0 needs sigma"]),
    ("covariance0 = 500.0", "covariance0 = 500.0, M_0 = 5.0, nu = 1.0", ["either sigma", "nu"]),
    ("covariance0 = 500.0", "covariance0 = 500.0, sigma = 0.1, M_0 = 1e-20", ["M_0", "at least 1e-15"]),
    (LAW, '{ kind = "least-squares-forgetting", covariance0 = 5.0, forgetting = 0.1, g_0 = 0.1 }', ["dead zone", "grows"]),
    (LAW, '{ kind = "integral-cost", gamma = 5.0, forgetting = 0.1, g_0 = 0.1 }', ["law.g_0", "integral"]),
    (LAW, '{ kind = "integral-cost", gamma = 5.0, forgetting = 0.1, nu = 0.1 }', ["EpsilonModification", "integral-cost"]),
    (LAW, '{ kind = "least-squares-resetting", rho_0 = 1.0, rho_1 = 2.0 }', ["law.rho_1", "below", "2"]),
    (LAW, '{ kind = "least-squares-bounded", covariance0 = 9.0, forgetting = 1.0, covariance_bound = 10.0 }', ["Frobenius"]),
    (LAW, '{ kind = "kalman" }', ["law.kind", "kalman"]),
    ("gamma = 1.0", "gamma = [1.0, -1.0]", ["gamma", "-1"]),
    ("gamma = 1.0", "gamma = [[1.0, 2.0], [2.0, 1.0]]", ["gamma", "positive definite"]),
    ("gamma = 1.0", 'gamma = "high"', ["gamma", "high"]),
    ("gamma = 1.0", "gamma = 1.0\nmodification = { sigam = 1.0 }", ["modification.sigam", "'sigma'"]),
    ("gamma = 1.0", "gamma = 1.0\nmodification = { g_0 = 1.0 }\nlearning = { gamma_c = 1, time_constant = 1 }", ["dead zone"]),
    ("upper = [5.0, 5.0]", "radius = 5.0", ["either lower and upper, or center and radius", "lower, radius"]),
    ("[plant]", "[plant]\ninput = { saturation = [1, 2] }", ["plant.input.saturation", "lower <= 0 <= upper"]),
    ("[plant]", "[plant]\ninput = { rate_limit = 0.0 }", ["plant.input.rate_limit", "positive"]),
    ("[plant]", "[plant]\ninput = { quantization = -1.0 }", ["plant.input.quantization", "positive"]),
    ('scheme = "mrac"', 'scheme = "mrac"\nsample_time = 1.00005', ["sample_time", "whole number of solver steps"]),
    ('scheme = "mrac"', 'scheme = "mrac"\ndiscretization = "euler"', ["discretization", "sample_time"]),
    ("[plant]", "[plant]\ninput = { delay = 5e-5 }", ["plant.input.delay", "one solver step", "at most 5e-05 s"]),
    ("[plant]", "[plant]\ninput = { actuator = { num = [1], den = [1, -1] } }", ["plant.input.actuator", "stable"]),
    ('scheme = "mrac"', 'scheme = "l1-output"', ["l1-output", "must be one of"]),
    ("[[controller]]", "[controller]", ["TOML"]),
    ('name = "Section V"', "name = 3", ["name", "3"]),
]


@pytest.mark.parametrize(("old", "new", "words"), BAD, ids=lambda value: value if isinstance(value, str) else "")
def test_bad_input_is_one_clear_sentence(old, new, words):
    with pytest.raises(InputError) as caught:
        parse_case(edited(old, new))
    sentence = str(caught.value)
    assert "\n" not in sentence
    for word in words:
        assert word in sentence


def test_unmatched_difference_names_the_rest():
    text = edited("A_m = [[0.0, 1.0], [-0.3, -1.0]]", "A = [[0.5, 1.0], [3.7, -4.0]]").replace("theta = [4.0, -3.0]\n", "")
    with pytest.raises(InputError, match=r"matched.*0\.5"):
        parse_case(text.replace("k_0 = 4.0", "k_0 = 4.0\nA_m = [[0.0, 1.0], [-0.3, -1.0]]"))


def test_a_mark_of_the_byte_order_is_no_part_of_the_text(tmp_path):
    """Editors on Windows and PowerShell write a byte-order mark before UTF-8."""
    (tmp_path / "marked.toml").write_text(PAPER, encoding="utf-8-sig", newline="\r\n")
    marked, plain = load_case(tmp_path / "marked.toml"), parse_case(PAPER)
    assert (repr(marked.problem), repr(marked.controllers)) == (repr(plain.problem), repr(plain.controllers))


def test_unreadable_files(tmp_path):
    with pytest.raises(InputError, match=r"neither a file nor a bundled case \(.*paper.*\)"):
        load_case(tmp_path / "none.toml")
    with pytest.raises(InputError, match="cannot be read"):
        load_case(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8 text"):
        load_case(tmp_path / "binary.toml")
    (tmp_path / "csv.toml").write_text(
        edited('kind = "sine"\namplitude = 50.0\nfrequency = 0.5', 'kind = "csv"\nfile = "gone.csv"')
    )
    with pytest.raises(InputError, match=r"reference: the data file .*gone\.csv' cannot be read"):
        load_case(tmp_path / "csv.toml")


SCALARS = st.one_of(
    st.floats(),
    st.integers(),
    st.integers(-(10**400), 10**400),
    st.booleans(),
    st.text(max_size=5),
    st.just("l1"),
    st.just("sine"),
)
VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3), max_leaves=9
)


LINES = [line for line in PAPER.splitlines() if "=" in line and not line.startswith("#")]


@settings(max_examples=400, suppress_health_check=[HealthCheck.too_slow])
@given(line=st.sampled_from(LINES), value=VALUES)
@example(line="gamma = 1e4", value=10**400)
@example(line='law = { kind = "least-squares", covariance0 = 500.0 }', value={"\n": 1})
@example(line="b = [0.0, 1.0]", value=[])
@example(line='name = "MRAC"', value="\n")
@example(line="A_m = [[0.0, 1.0], [-0.3, -1.0]]", value=[[-1.0], [-1.0, 2.0]])
@example(line="theta = [4.0, -3.0]", value=[1e300, 1e300])
def test_fuzz_values(line, value):
    """Any value of any key gives either a case or an InputError of one sentence."""
    try:
        parse_case(PAPER.replace(line, f"{line.split('=')[0]}= {as_toml(value)}", 1))
    except InputError as error:
        assert "\n" not in str(error)


@settings(max_examples=200)
@given(start=st.integers(0, len(PAPER)), length=st.integers(0, 40), insert=st.text(max_size=8))
def test_fuzz_text(start, length, insert):
    """Fuzzes the readers with damaged text."""
    try:
        parse_case(PAPER[:start] + insert + PAPER[start + length :])
    except InputError as error:
        assert str(error)


def output_case(*controllers: str):
    head = """
        name = "c"
        [plant]
        transfer_function = { num = [2.0], den = [1.0, 1.0] }
        [reference_model]
        transfer_function = { num = [3.0], den = [1.0, 3.0] }
        [reference]
        kind = "sine"
        amplitude = 1.0
        frequency = 1.0
        [simulation]
        t_end = 2.0
        dt = 1e-2
    """
    return "\n".join((head, *(f"[[controller]]\n{controller}" for controller in controllers)))


L1_TABLE = 'name = "A"\nscheme = "l1-output"\nm = 3.0\ngamma = 50.0\nfilter = { num = [20.0], den = [1.0, 20.0] }'


def test_the_equivalent_of_a_controller_of_the_case():
    text = output_case(
        L1_TABLE,
        'scheme = "linear"\nname = "same"\nequivalent_of = "A"',
        'scheme = "linear"\nname = "limit"\nequivalent_of = "A"\nlimit = true',
    )
    first, same, limit = parse_case(text, "c").controllers
    assert same.loop.den.tolist() == linear_equivalent(first).feedback.den.tolist()
    assert limit.feedforward.num.tolist() == fast_limit(first).feedforward.num.tolist()


def test_the_equivalent_of_a_sampled_controller_is_that_of_the_continuous_one():
    text = output_case(f"{L1_TABLE}\nsample_time = 0.1", 'scheme = "linear"\nname = "same"\nequivalent_of = "A"')
    sampled, same = parse_case(text, "c").controllers
    assert same.loop.den.tolist() == linear_equivalent(sampled.controller).feedback.den.tolist()


@pytest.mark.parametrize(
    ("controllers", "words"),
    [
        ((L1_TABLE, 'scheme = "linear"\nequivalent_of = "B"'), ["equivalent_of", "'A'", "'B'"]),
        (('scheme = "linear"\nequivalent_of = "B"',), ["equivalent_of", "none"]),
        ((L1_TABLE, 'scheme = "linear"\nequivalent_of = "A"\nbandwidth = 1.0'), ["bandwidth", "equivalent_of"]),
        (('scheme = "linear"\nlimit = true\ndesign = "pi"\nunmodelled_delay = 0.1',), ["limit", "equivalent_of"]),
        (
            ('scheme = "linear"\ndesign = "pi"\nunmodelled_delay = 0.1\ndesign_plant = { num = [1, 2], den = [1, 1] }',),
            ["design_plant", "strictly proper"],
        ),
        (
            (
                'scheme = "mrac-output"\norder = 1\nrelative_degree = 1\nsign = 1\nprojection = false\nc_0_min = 0.1\n'
                'law = { kind = "gradient", gamma = 1.0 }',
            ),
            ["projection must stay on", "c_0"],
        ),
        (
            (
                'scheme = "mrac-output"\norder = 1\nrelative_degree = 1\nsign = 1\nprojection = true\n'
                'law = { kind = "lyapunov", gamma = 1.0 }',
            ),
            ["projection needs lower and upper"],
        ),
        (
            (
                'scheme = "mrac-output"\norder = 1\nrelative_degree = 1\nsign = 1\nnormalization = { delta_0 = 0.1 }\n'
                'law = { kind = "lyapunov", gamma = 1.0 }',
            ),
            ["normalization", "unnormalised"],
        ),
    ],
)
def test_output_keys_that_do_not_go_together(controllers, words):
    message = refusal(lambda: parse_case(output_case(*controllers), "c"))
    assert all(word in message for word in words), message


DEEP = ".".join("a" * 150)
NOISE = "[sensor]\nnoise = {{ std = 1.0, sample_time = {}, seed = {} }}\n[reference]"
POLYNOMIAL = 'theta = [4.0, -3.0]\nregressor = { kind = "polynomial", degree = 3000 }'


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[reference]", NOISE.format(1e-3, 2**64), ["sensor.noise.seed", "18446744073709551615"]),
        ("[reference]", NOISE.format(61.0, 0), ["sensor.noise.sample_time", "t_end = 60 s", "61"]),
        ('name = "L1"', 'name = "L1"\nsample_time = 1e80', ["L1", "sample_time", "t_end = 60 s", "1e+80"]),
        ('name = "L1"', 'name = "L1"\nsample_time = 18446744073709551617', ["L1", "sample_time", "t_end = 60 s"]),
        ("k_0 = 4.0", f"k_0 = 4.0\n{DEEP} = 1", ["unknown key reference_model.a"]),
        ("k_0 = 4.0", f"k_0.{DEEP} = 1", ["reference_model.k_0", "{ a = { a = "]),
        ("theta = [4.0, -3.0]", POLYNOMIAL, ["plant.theta", "4504500"]),
        ("dt = 1e-4", "dt = 1e-5\nrecord_points = 6000000", ["simulation.record_points", "at most 4294967 would do", "6000000"]),
    ],
)
def test_extreme_values_are_refused_in_one_sentence(old, new, words):
    message = refusal(lambda: parse_case(edited(old, new)))
    assert all(word in message for word in words), message


def test_a_pole_that_is_no_number():
    text = edited("A_m = [[0.0, 1.0], [-0.3, -1.0]]", "A = [[0.0, 1.0], [3.7, -4.0]]").replace("theta = [4.0, -3.0]\n", "")
    assert "reference_model.poles must be numbers" in refusal(
        lambda: parse_case(text.replace("k_0 = 4.0", "k_0 = 4.0\npoles = [[]]"))
    )


def test_an_order_that_no_computer_holds():
    controller = (
        'scheme = "mrac-output"\norder = 1000000\nrelative_degree = 1\nsign = 1\nlaw = { kind = "lyapunov", gamma = 1.0 }'
    )
    assert "order must be a whole number from 1 to 100, got 1000000" in refusal(lambda: parse_case(output_case(controller), "c"))


def test_all_steps_of_a_short_run_may_be_recorded():
    assert parse_case(edited("dt = 1e-4", "dt = 1e-3\nrecord_points = 6000000")).simulation.record_points == 6000000


def test_a_second_spelling_is_understood():
    """``value`` is accepted for a constant's amplitude, and ``path`` for a file."""
    constant = edited('kind = "sine"\namplitude = 50.0\nfrequency = 0.5', 'kind = "constant"\nvalue = 3')
    assert parse_case(constant).problem.reference(np.zeros(1)) == [3.0]


PHYSICAL = ("[parameters]", "[plant.input]", "[sensor]", "[labels]", "[truth]", "[specification]", "[judge]")
"""Tables of the template that are comments."""


def test_the_template_with_its_physical_options_is_a_case():
    """The options are commented lines; with these tables, the formulas and a sample time in place of theta, they fit together."""
    lines, active = [], False
    for line in text_to_start_from().splitlines():
        option = line.removeprefix("# ")
        active = option.startswith(PHYSICAL) or (active and line.startswith("# ") and not option.startswith("["))
        physical = line.startswith("# ") and option.startswith(
            ('A = [[0.0, 1.0], [0.0, "', 'b = [0.0, "', "poles = [-3", "follow")
        )
        dropped = line.startswith(("A_m", "b =", "theta", "k_0", "[uncertainty]", "lower", "upper"))
        lines.append(option if active or physical else "" if dropped else line)
    text = "\n".join(lines).split("[[controller]]")[0]
    case = parse_case(text + '[[controller]]\nname = "MRAC"\nscheme = "mrac"\ngamma = 20.0\nsample_time = 0.01\n')
    assert case.problem.plant.physical is not None and case.problem.truth is not None and case.specification is not None
    assert all(f"# {table}" in text_to_start_from() for table in PHYSICAL)


def test_the_template_names_every_solver_and_every_kind_of_command():
    lines = text_to_start_from().splitlines()
    (solver,) = (line for line in lines if line.startswith("solver"))
    assert solver.partition("# ")[2] == ", ".join(SOLVERS)
    said = " ".join(
        line.partition("#")[2] for line in lines[lines.index(next(x for x in lines if x.startswith("[reference] "))) :]
    )
    assert all(re.search(rf"\b{kind}\b", said) for kind in SIGNALS)


@pytest.mark.parametrize("simulation", ["dt = 1e-3", "tolerance = 1e-6"])
def test_a_case_that_cannot_be_simulated_is_refused_when_it_is_read(simulation):
    """Such a case with a tolerance was once read, and ``certify`` gave a certificate for it."""
    text = f"{DRIVE.split('[simulation]')[0]}[sensor]\nquantization = 0.1\n[simulation]\nt_end = 4.0\n{simulation}\n"
    controller = '[[controller]]\nname = "MRAC"\nscheme = "mrac"\ngamma = 3.0\n'
    assert "MRAC: sensor.quantization applies only to controllers that sample the sensor" in refusal(
        lambda: parse_case(text + controller)
    )
