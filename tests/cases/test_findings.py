"""Messages about a faulty case file: the first few faults together, with suggestions and the values as typed."""

import json
import tomllib

import pytest
from jsonschema import Draft202012Validator

from barbalat.cases.bundled import bundled
from barbalat.cases.load import parse_case, text_to_start_from
from barbalat.cases.schema import json_schema
from barbalat.validate import InputError
from independent import refusal

CASE = """
name = "c"
plant = { A_m = [[-1.0]], b = [1.0], theta = [1.0] }
reference_model = { k_0 = 1.0 }
reference = { kind = "step", amplitude = 1.0 }
simulation = { t_end = 1.0, dt = 0.1 }
[[controller]]
scheme = "robust-mrac"
tau = 0.2
law = { kind = "gradient", gamma = 3.0 }
"""


def edited(*changes: tuple[str, str]) -> str:
    text = CASE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.mark.parametrize(
    ("old", "new", "meant"),
    [
        ('scheme = "robust-mrac"', 'scheme = "Robust-MRAC"', "did you mean 'robust-mrac'?"),
        (CASE[CASE.index("scheme") :], 'scheme = "l1"\nfilter = 0.05\ngamma = 1.0\n', "write filter = { kappa = 0.05 }"),
        ("dt = 0.1 }", "dt = 0.1 }\nname2 = 0,001", "a number has a decimal point: name2 = 0.001"),
        ("[[controller]]", "[controller]", "write [[controller]] instead of [controller]"),
        ('law = { kind = "gradient", gamma = 3.0 }', 'law = "least-squares"', 'write law = { kind = "least-squares" }'),
        ("theta = [1.0]", "theta = [1.0], saturation = [-3, 3]", "plant.saturation; did you mean 'plant.input.saturation'?"),
        ("theta = [1.0]", "theta = [1.0], input = { saturation = 3.50 }", "must be a list, such as [-3.50, 3.50], got 3.50"),
        ("theta = [1.0]", "theta = 1e-3", "plant.theta must be a list, such as [1e-3], got 1e-3"),
        ('kind = "step"', 'kind = "stp"', "got \"stp\"; did you mean 'step'?"),
        ("tau = 0.2", "tau = true", "controller 1.tau should be a valid number, got true"),
        ("dt = 0.1", 'dt = { of = [1.50, "x"] }', 'simulation.dt should be a valid number, got { of = [1.50, "x"] }'),
        ("theta = [1.0]", "theta = [1.0], input = { limits = [-3, 3] }", "plant.input.limits; did you mean 'saturation'?"),
        ("theta = [1.0]", "theta = [1.0], states = 3", "known here: A_m, b, theta, x0, input, regressor, A, C"),
        ("theta = [1.0]", "theta = [1.0], input = { limits = [-3, 3] }", "plant.input.limits; did you mean 'saturation'?"),
        ("theta = [1.0]", "theta = [1.0], states = 3", "or did you mean 'truth.states'?"),
        ('name = "c"', "nmae = 3", "unknown key nmae; did you mean 'name'?"),
        ('scheme = "robust-mrac"', 'Scheme = "robust-mrac"', "unknown key controller 1.Scheme; did you mean 'scheme'?"),
        ('{ kind = "step"', '{ Kind = "step"', "unknown key reference.Kind; did you mean 'kind'?"),
        ('{ kind = "gradient"', '{ kid = "gradient"', "law.kid; did you mean 'kind'?"),
        ("tau = 0.2", 'tau = 0.2\nname = ""', 'controller 1.name should have at least 1 character, got ""'),
    ],
)  # fmt: skip
def test_the_nearest_thing_that_is_meant(old, new, meant):
    assert meant in refusal(lambda: parse_case(edited((old, new))))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("dt = 0.1", "dt = 0", "simulation.dt must be positive, got 0"),
        ("dt = 0.1", "dt = -1e-03", "simulation.dt must be positive, got -1e-03"),
        ("t_end = 1.0", "t_end = -0.50", "simulation.t_end must be positive, got -0.50"),
        ("tau = 0.2", "tau = -2", "controller 1 (robust-mrac): tau must be positive, got -2"),
        ("gamma = 3.0", "gamma = -3", "controller 1 (robust-mrac): law.gamma must be positive, got -3"),
        ("A_m = [[-1.0]]", "A_m = [[1]]", "plant.A_m must be Hurwitz, but its largest eigenvalue has real part 1: [[1]]"),
        ("theta = [1.0]", "theta = [1, 2.50]", "plant.theta must have shape 1, got 2: [1, 2.50]"),
        ("theta = [1.0]", "theta = [1.0], input = { delay = -1 }", "plant.input.delay must not be negative, got -1"),
        ("theta = [1.0]", "theta = [1.0], input = { saturation = [3, -3.0] }", "lower <= 0 <= upper, got [3, -3.0]"),
        ('"step", amplitude = 1.0', '"square", amplitude = 1.0, frequency = 0', "reference: frequency must be positive, got 0"),
        ('"step", amplitude = 1.0', '"steps", times = [0, 0.0], values = [1, 2]', "must be increasing, got [0, 0.0]"),
        ("tau = 0.2", "tau = 0.2\nsample_time = 0", "controller 1 (robust-mrac): sample_time must be positive, got 0"),
    ],
)  # fmt: skip
def test_what_an_object_refuses_is_told_as_it_was_typed(old, new, said):
    """The message shows the typed value even if the object contains the converted number, and in lists and nested tables."""
    found = refusal(lambda: parse_case(edited((old, new))))
    assert found.endswith(said), found


RANGE = "is beyond the range of floating-point numbers, 1.8e+308"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("tau = 0.2", f"tau = {'9' * 5000}", f"the case, line 9: a number of 5000 digits {RANGE}"),
        ("tau = 0.2", f"tau = 0.2  # 12\ngain = -{'9_' * 4999}9", f"the case, line 10: a number of 5000 digits {RANGE}"),
        ("tau = 0.2", f"tau = {'9' * 400}", f"controller 1.tau {RANGE}, got {'9' * 57}..."),
        ("tau = 0.2", f"tau = 0x{'f' * 5000}", f"controller 1.tau {RANGE}, got 0x{'f' * 55}..."),
        ("theta = [1.0]", f"theta = [-{'9' * 400}]", f"plant.theta 1 {RANGE}, got -{'9' * 56}..."),
        ("dt = 0.1", f"dt = 0.1, s = 0x{'f' * 5000}", "unknown key simulation.s; known here: "),
        ("tau = 0.2", 'tau = 0.2\n"" = 1', 'unknown key controller 1.""; known here: '),
        ("tau = 0.2", 'tau = 0.2\n"a.b" = 1', 'unknown key controller 1."a.b"; known here: '),
        ("tau = 0.2", 'tau = 0.2\n"a\\u001b[31m" = 1', 'unknown key controller 1."a\\u001b[31m"; known here: '),
        ("gamma = 3.0", "gamma = 3.0, knd = 1", "unknown key controller 1.law.knd; known here: "),  # kind is present
        ("dt = 0.1", "dt = 0.1, widht = 1", "unknown key simulation.widht; known here: "),
        ('"step", amplitude = 1.0', '"step", amp = 1.0', "unknown key reference.amp; did you mean 'amplitude'?"),
    ],
)  # fmt: skip
def test_numbers_beyond_range_and_keys_that_nobody_knows(old, new, said):
    found = refusal(lambda: parse_case(edited((old, new))))
    assert found.startswith(said), found


def test_three_findings_are_told_at_once_then_how_many_more():
    wrong = edited(
        ('name = "c"', 'nmae = "c"'),
        ("b = [1.0]", "b = true"),
        ("k_0 = 1.0", "k0 = 1.0"),
        ("dt = 0.1", "dt = 'a'"),
        ("tau", "tua"),
    )
    with pytest.raises(InputError) as caught:
        parse_case(wrong)
    assert caught.value.sentences[:3] == (
        "unknown key nmae; did you mean 'name'?",
        "unknown key reference_model.k0; did you mean 'k_0'?",
        "unknown key controller 1.tua; did you mean 'tau'?",
    )
    assert caught.value.sentences[3:] == ("and 2 more",)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("saturation = 3.0", ("plant.input.saturation must be a list, such as [-3.0, 3.0], got 3.0",)),
        ("delay = 0.1", ()),  # its spelling is most similar to theta, which is a list
        ('delay = "x"', ('plant.input.delay should be a valid number, got "x"',)),
    ],
)
def test_what_belongs_further_in_is_looked_at_as_if_it_stood_there(given, told):
    """No message mentions a key that the user did not write, such as the one with the most similar spelling."""
    with pytest.raises(InputError) as caught:
        parse_case(edited(("theta = [1.0]", f"theta = [1.0], {given}")))
    name = given.partition(" ")[0]
    assert caught.value.sentences == (f"unknown key plant.{name}; did you mean 'plant.input.{name}'?", *told)


def test_what_is_told_at_once_is_not_long():
    wrong = edited(("theta = [1.0]", f"theta = [1.0], {'x' * 400} = 1"), ("dt = 0.1", f"dt = 0.1, {'y' * 400} = 1"))
    with pytest.raises(InputError) as caught:
        parse_case(wrong)
    assert len(caught.value.sentences) == 2 and caught.value.sentences[-1] == "and 1 more"
    assert len(str(caught.value)) < 600


def test_what_several_controllers_refuse_is_told_at_once():
    wrong = CASE.replace("tau = 0.2", "tau = -1.0") + '[[controller]]\nscheme = "mrac"\ngamma = -2.0\n'
    message = refusal(lambda: parse_case(wrong))
    assert "controller 1" in message and "tau" in message and "controller 2" in message and "gamma" in message


CASES = [*bundled(), None]


@pytest.mark.parametrize("name", CASES)
def test_editors_accept_what_the_program_accepts(name):
    Draft202012Validator(json_schema()).validate(tomllib.loads(text_to_start_from(name)))


@pytest.mark.parametrize(
    ("old", "new"), [("tau = 0.2", "tua = 0.2"), ("tau = 0.2", "tau = 'a'"), ("[[controller]]", "[controller]")]
)
def test_editors_refuse_what_the_program_refuses(old, new):
    schema = json_schema()
    Draft202012Validator.check_schema(schema)
    assert list(Draft202012Validator(schema).iter_errors(tomllib.loads(edited((old, new)))))
    assert not list(Draft202012Validator(schema).iter_errors(tomllib.loads(CASE)))
    assert json.loads(json.dumps(schema)) == schema


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('terms = ["x1"], width = 1', "plant.regressor.width has no meaning for terms"),
        ('terms = ["x1"], widht = 1', "unknown key plant.regressor.widht"),
        ("terms = { a = 1 }", "plant.regressor.terms must be a list"),
        ('terms = ["x1", 3]', "plant.regressor.terms 2 should be a valid string, got 3"),
    ],
)
def test_a_kind_may_be_called_as_one_of_its_keys(keys, said):
    """In pydantic's location of a finding the kind follows the table. Here the kind is also the name of a key."""
    assert said in refusal(
        lambda: parse_case(edited(("theta = [1.0]", f'theta = [1.0], regressor = {{ kind = "terms", {keys} }}')))
    )
