"""The README's Python code runs, and the certificates' names are the same objects in any order of import."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
import scipy.io
import scipy.signal
from matplotlib.testing.compare import compare_images

import barbalat
from barbalat import InputError, TransferFunction, certify
from barbalat.cases.load import load_case, parse_case
from barbalat.systems import StateSpace, l1_norm, margins
from independent import refusal

README = Path(__file__).parents[1].joinpath("README.md").read_text(encoding="utf-8")


def test_the_examples_of_the_readme_run_and_make_its_picture(capsys, tmp_path, monkeypatch):
    root = Path(__file__).parents[1]
    assert len(README.splitlines()) < 100
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(blocks) >= 2
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks), {})
    assert "'holds': True" in capsys.readouterr().out
    # The runs differ by their roundings from machine to machine: by less than a pixel's width, 2 of 255 in the mean square.
    assert compare_images(str(root / "docs" / "first.png"), str(tmp_path / "first.png"), tol=2) is None


@pytest.mark.full
def test_the_examples_of_the_readme_are_typed(tmp_path):
    script = tmp_path / "readme.py"
    script.write_text("\n".join(re.findall(r"```python\n(.*?)```", README, re.DOTALL)), encoding="utf-8")
    (tmp_path / "mypy.ini").write_text("[mypy]\nstrict = true\n")
    source = str(Path(barbalat.__file__).parents[1])
    found = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", "mypy.ini", script.name],
        cwd=tmp_path, env=os.environ | {"MYPYPATH": source}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stdout


def test_an_extra_that_lacks_names_itself(monkeypatch):
    case = load_case("first-order")
    result = barbalat.simulate(case.problem, case.controllers[0], barbalat.Simulation(1.0, 1e-2))["MRAC"]
    monkeypatch.setattr("barbalat.validate.find_spec", lambda _: None)
    for method, extra in ((result.to_pandas, "tables"), (result.to_xarray, "tables"), (result.to_control, "control")):
        assert f"barbalat[{extra}]" in refusal(method)
    assert "barbalat[control]" in refusal(result.step_info)


def test_a_plant_in_every_form():
    """A = A_m + b theta', whichever two are given. Systems of python-control and SciPy give the same plant."""
    A, b, A_m = np.array([[0.0, 1.0], [3.7, -4.0]]), np.array([0.0, 1.0]), np.array([[0.0, 1.0], [-0.3, -1.0]])
    C, D = np.eye(2), np.zeros((2, 1))
    poles = list(np.linalg.eigvals(A_m))
    plants = [
        barbalat.Plant(A_m, b, [4.0, -3.0]),
        barbalat.Plant(A=A, b=b, A_m=A_m),
        barbalat.Plant(A=A, b=b, poles=poles),
        barbalat.Plant.from_system((A, b), A_m=A_m),
        barbalat.Plant.from_system(control.ss(A, b[:, None], C, D), poles=poles),
        barbalat.Plant.from_system(scipy.signal.StateSpace(A, b[:, None], C, D), A_m=A_m),
    ]
    for plant in plants:
        np.testing.assert_allclose(plant.A, A, atol=1e-12)
        np.testing.assert_allclose(plant.A_m, A_m, atol=1e-12)
        np.testing.assert_allclose(plant.theta, [4.0, -3.0], atol=1e-12)
    assert "either A_m or poles" in refusal(lambda: barbalat.Plant(A=A, b=b))
    assert "state-space model" in refusal(lambda: barbalat.Plant.from_system(control.tf([1.0], [1.0, 1.0]), poles=[-1.0]))


def test_an_output_plant_of_other_packages():
    num, den = [2.0, 2.0], [1.0, 3.0, 5.0]
    ours = barbalat.OutputPlant(TransferFunction(num, den)).transfer_function
    A, B, C, D = scipy.signal.tf2ss(num, den)
    for system in (control.tf(num, den), scipy.signal.lti(num, den), scipy.signal.StateSpace(A, B, C, D)):
        found = barbalat.OutputPlant(system).transfer_function
        np.testing.assert_allclose(found.num, ours.num, atol=1e-12)
        np.testing.assert_allclose(found.den, ours.den, atol=1e-12)


def test_a_system_is_taken_as_files_and_scipy_write_it():
    """(num, den) or the matrices (A, B, C, D) are accepted wherever a linear system is needed."""
    num, den = [1.0], [0.02, 1.0]
    matrices = scipy.signal.tf2ss(num, den)
    for given in ((num, den), matrices, [part.tolist() for part in matrices]):
        for found in (
            barbalat.L1Adaptive(gamma=10.0, filter=given).filter,
            barbalat.OutputPlant(given).transfer_function,
            barbalat.OutputReferenceModel(given).transfer_function,
            barbalat.plants.PlantInput(actuator=given).actuator,
            barbalat.LinearFeedback(given).controller.transfer_function(),
            barbalat.LinearOutput(given).loop,
        ):
            np.testing.assert_allclose(found.num, [50.0])
            np.testing.assert_allclose(found.den, [1.0, 50.0])
    assert "plant.input.actuator.den" in refusal(lambda: barbalat.plants.PlantInput(actuator=([1.0], ["s"])))
    assert "controller.A must be square" in refusal(lambda: barbalat.LinearFeedback(([[1.0, 2.0]], [1.0], [1.0], 0.0)))
    assert "controller.B must have shape 1" in refusal(lambda: barbalat.LinearFeedback(([[1.0]], [1.0, 2.0], [1.0], 0.0)))


def test_what_a_case_file_names_python_takes_by_its_name():
    assert barbalat.Simulation(1.0, 0.1, solver="heun").solver is barbalat.solvers.HEUN
    assert barbalat.Simulation(1.0, 0.1, solver="heun") == barbalat.Simulation(1.0, 0.1, solver=barbalat.solvers.HEUN)
    rule = barbalat.studies.Rule(delay_margin=0.1, until="loss")
    assert rule.as_json()["until"] == "loss" and rule == replace(rule, until="loss")
    assert "did you mean 'onset'?" in refusal(lambda: barbalat.studies.Rule(delay_margin=0.1, until="onst"))


@pytest.mark.parametrize(
    ("lookup", "meant"),
    [
        (lambda found, _: found["MRCA"], "MRAC"),
        (lambda found, _: found["MRAC"].figures["max_abs_ee"], "max_abs_e"),
        (lambda found, _: found["MRAC"].columns()["theta_ht_1"], "theta_hat_1"),
        (lambda _, certified: certified["MRCA"], "MRAC"),
        (lambda _, certified: certified["MRAC"].values["gama_max"], "gamma_max"),
    ],
)
def test_a_misspelt_name_of_a_result_is_told_with_the_one_that_is_meant(lookup, meant):
    case = load_case("first-order")
    short = barbalat.Simulation(1.0, 1e-2)
    given = case.problem, case.controllers[0], short
    with pytest.raises(KeyError, match=rf"did you mean '{meant}'\?"):
        lookup(barbalat.simulate(*given), certify(*given))


def test_recorded_commands_in_every_form(tmp_path):
    t, r = np.array([0.0, 0.5, 1.25]), np.array([1.0, -2.5, 3.0])
    texts = {
        "comma": "t,r\n0,1\n0.5,-2.5\n1.25,3\n",
        "spaces": "0 1\n0.5 -2.5\n1.25   3\n",
        "tab": "t\tr\n0\t1\n0,5\t-2,5\n1,25\t3\n",
        "semicolon": "t;r\n0;1\n0,5;-2,5\n1,25;3\n",
        "decimal commas": "0,0 1,0\n0,5 -2,5\n1,25 3,0\n",
        "Latin-1, with units": "Zeit;größe 1\n[s];[°]\n0;1\n0,5;-2,5\n1,25;3\n",
        "a spreadsheet's": 'sep=;\n"t_1";"r_1"\n"0";"1"\n"0,5";"-2,5"\n"1,25";"3"\n',
        "another separator in the header": "t [s], at 1 kHz; r\n0;1\n0,5;-2,5\n1,25;3\n",
    }
    for name, text in texts.items():
        file = tmp_path / f"{name}.csv"
        file.write_bytes(text.encode("latin-1"))
        found = barbalat.signals.Recorded.from_csv(file)
        assert found.times.tolist() == t.tolist() and found.values.tolist() == r.tolist(), name
    scipy.io.savemat(tmp_path / "r.mat", {"t": t, "r": r, "other": np.eye(2)})
    scipy.io.savemat(tmp_path / "pair.mat", {"data": np.column_stack([t, r])})
    logged = {"time": t, "signals": {"values": r, "dimensions": 1.0, "label": "r"}}  # Simulink's structure with time
    scipy.io.savemat(tmp_path / "logged.mat", {"yout": logged})
    scipy.io.savemat(tmp_path / "named.mat", {"own": {"seconds": t, "speed": r, "other": 2 * r}})
    for found in (
        barbalat.signals.Recorded.from_mat(tmp_path / "r.mat"),
        barbalat.signals.Recorded.from_mat(tmp_path / "pair.mat", values="data"),
        barbalat.signals.Recorded.from_mat(tmp_path / "pair.mat"),
        barbalat.signals.Recorded.from_mat(tmp_path / "logged.mat"),
        barbalat.signals.Recorded.from_mat(tmp_path / "named.mat", times="own.seconds", values="own.speed"),
    ):
        assert found.times.tolist() == t.tolist() and found.values.tolist() == r.tolist()
    scipy.io.savemat(tmp_path / "square.mat", {"data": np.eye(2)})
    assert "data is 2 x 2" in refusal(lambda: barbalat.signals.Recorded.from_mat(tmp_path / "square.mat"))
    said = refusal(lambda: barbalat.signals.Recorded.from_mat(tmp_path / "named.mat"))
    assert "no variable 't' for the times; its variables are: own.other, own.seconds, own.speed" in said
    (tmp_path / "no.mat").write_bytes(b"nothing of MATLAB's")
    assert "no.mat" in refusal(lambda: barbalat.signals.Recorded.from_mat(tmp_path / "no.mat"))


@pytest.mark.parametrize(
    "keys", ["modification = { sigma = 0.1, M_0 = 6.0 }", "leakage = { sigma = 0.1, M_0 = 6.0 }", "dead_zone = { g_0 = 0.2 }"]
)
def test_case_files_have_the_names_of_python(keys):
    text = f"""
name = "named"
plant = {{ A_m = [[-1.0]], b = [1.0], theta = [2.0] }}
reference_model = {{ k_0 = 1.0 }}
reference = {{ kind = "constant", value = 1.0 }}
simulation = {{ t_end = 1.0, dt = 0.01 }}
[[controller]]
name = "one"
scheme = "mrac"
gamma = 1.0
{keys}
"""
    (controller,) = parse_case(text).controllers
    name = "dead_zone" if "dead_zone" in keys else "leakage"
    assert getattr(controller, name) is not None
    if "modification" in keys:
        twice = text + "leakage = { sigma = 0.1 }\n"
        assert "twice" in refusal(lambda: parse_case(twice))


@pytest.mark.parametrize("before", ["", "import barbalat.certificates.certify", "import barbalat.results"])
def test_certify_can_be_called_whatever_was_imported_before(before):
    code = f"""
{before}
from barbalat import certify
import barbalat.linear.margins
import barbalat
assert callable(certify) and barbalat.certify is certify
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_certify_gives_a_certificate_for_each_controller():
    case = load_case("first-order")
    found = certify(case.problem, list(case.controllers), case.simulation)
    assert list(found) == [controller.name for controller in case.controllers]
    assert all(isinstance(one, barbalat.results.Certificate) for one in found.values())


def test_the_norm_of_a_system_in_every_form():
    """The closed form of the standard second-order system is the total variation of its step response, (1 + q)/(1 - q) with the
    overshoot q."""
    zeta = 0.3
    q = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    exact = (1 + q) / (1 - q)
    ours = TransferFunction([4.0], [1.0, 4 * zeta, 4.0])
    theirs = control.tf([4.0], [1.0, 4 * zeta, 4.0])
    for system in (ours, ours.realise(), theirs, control.ss(theirs)):
        found = l1_norm(system)
        assert found.lower <= exact * (1 + 1e-14) and found.upper >= exact * (1 - 1e-14)
        assert found.relative_width < 1e-9
    A, B, C, D = np.diag([-1.0, -2.0]), np.eye(2), np.array([[1.0, 2.0]]), np.array([[0.5, 0.0]])
    several = l1_norm(control.ss(A, B, C, D))
    assert several == l1_norm(A, B, C, D)
    assert several.midpoint == pytest.approx(1 + 1 + 0.5, rel=1e-9)


def test_what_is_no_system_is_refused():
    assert "l1_norm takes the matrices" in refusal(lambda: l1_norm("s"))
    with pytest.raises(ValueError, match="not given: C, D"):
        l1_norm([[-1.0]], [[1.0]])
    assert "proper" in refusal(lambda: l1_norm(TransferFunction([1.0, 0.0, 0.0], [1.0, 1.0])))
    assert "sample time 0.1" in refusal(lambda: l1_norm(control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1)))
    with pytest.raises(ValueError, match="Hurwitz"):
        l1_norm(TransferFunction([1.0], [1.0, -1.0]))


def test_margins_of_a_loop_in_every_form():
    ours = TransferFunction([2.0], [1.0, 3.0, 3.0, 1.0])
    pair, matrices = ([2.0], [1.0, 3.0, 3.0, 1.0]), scipy.signal.tf2ss([2.0], [1.0, 3.0, 3.0, 1.0])
    listed = [part.tolist() for part in matrices]
    forms = (ours, ours.realise(), control.tf(*pair), pair, matrices, listed, StateSpace(listed[0], listed[1], listed[2], 0))
    for loop in forms:
        assert margins(loop).gain_up == pytest.approx(4, rel=1e-9)
    assert "delay" in refusal(lambda: margins(ours, -1.0))
    assert "loop" in refusal(lambda: margins([[1.0]]))
    assert isinstance(ours.realise(), StateSpace) and issubclass(InputError, ValueError)
