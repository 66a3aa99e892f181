"""The user's own controllers at the command line, from a file given by name or from an installed package that a case names."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from barbalat.cases.load import load_case
from barbalat.cli import main
from barbalat.controllers import Mrac, Sampled
from barbalat.run.engine.simulate import simulate
from independent import refusal

LAWS = (Path(__file__).parents[1] / "foreign.py").read_text().partition("def wrong(")[0]
"""The classes Plain, Bare and Proportional. None of them can be made without settings."""
CASE = """
name = "own"
[plant]
A_m = [[0.0, 1.0], [-1.0, -1.4]]
b = [0.0, 1.0]
theta = [1.0, -0.5]
[reference_model]
k_0 = 1.0
[reference]
kind = "sine"
amplitude = 1.0
frequency = 0.5
[simulation]
t_end = 2.0
dt = 1e-2
"""
OWN = '[[controller]]\nscheme = "Plain"\ngamma = 5.0\n'
KNOWN = '[[controller]]\nscheme = "mrac"\ngamma = 5.0\nprojection = false\n'


@pytest.fixture
def folder(tmp_path):
    def write(case=CASE, laws=LAWS):
        (tmp_path / "case.toml").write_text(case)
        (tmp_path / "mylaws.py").write_text(laws)
        return tmp_path / "case.toml", tmp_path / "mylaws.py"

    return write


def documents(capsys, case, laws) -> tuple[dict, dict]:
    found = []
    for command in ("run", "certify"):
        assert main([command, str(case), "--controllers", str(laws), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out)["controllers"])
    return found[0], found[1]


def test_a_list_joins_the_cases_own(folder, capsys):
    """The same equations as MRAC's give the same metrics. The names keep their order."""
    case, laws = folder(CASE + KNOWN, LAWS + 'CONTROLLERS = [Plain(5.0), Bare(5.0, "second")]\nleft_out = Plain(1.0, "x")')
    run, certified = documents(capsys, case, laws)
    assert list(run) == list(certified) == ["MRAC", "plain", "second"]
    assert run["plain"]["max_abs_e"] == run["second"]["max_abs_e"] == pytest.approx(run["MRAC"]["max_abs_e"], rel=1e-12)
    assert certified["plain"]["delay_margin"] == pytest.approx(certified["MRAC"]["delay_margin"], rel=1e-9)
    assert "error_bound" not in certified["plain"] and "error_bound" in certified["MRAC"]


def test_without_a_list_what_is_made_in_the_file(folder, capsys):
    """A case without controllers is then sufficient."""
    case, laws = folder(CASE, LAWS + "first, second = Plain(5.0), Proportional([1.0, 1.0])")
    assert list(documents(capsys, case, laws)[0]) == ["plain", "proportional"]


def test_without_any_the_classes_that_need_no_settings(folder):
    case, laws = folder(CASE, LAWS + "class Zero(Proportional):\n    def __init__(self):\n        super().__init__([0.0, 0.0])\n")
    assert [c.name for c in load_case(case, laws).controllers] == ["proportional"]


def test_a_case_names_the_files_classes(folder, capsys):
    """A case names them with keys for their fields and the keys common to all controllers."""
    case, laws = folder(CASE + OWN + 'sample_time = 0.1\ndiscretization = "euler"\nname = "mine"\n')
    found = load_case(case, laws)
    (controller,) = found.controllers
    assert isinstance(controller, Sampled) and controller.name == "mine" and controller.controller.gamma == 5.0
    assert list(documents(capsys, case, laws)[1]) == ["mine"]
    renamed, laws = folder(CASE + OWN.replace('"Plain"', '"Plian"'))
    assert "did you mean 'Plain'?" in refusal(lambda: load_case(renamed, laws))
    misspelt, laws = folder(CASE + OWN.replace("gamma", "gama"))
    assert "gamma" in refusal(lambda: load_case(misspelt, laws))


@pytest.mark.parametrize(
    ("laws", "words"),
    [
        ("x = = 1", ["invalid syntax", "line 1"]),
        ("\n1/0", ["line 2 of mylaws.py", "ZeroDivisionError"]),
        ("x = 1", ["contains no controllers", "CONTROLLERS"]),
        ("CONTROLLERS = 3", ["must be a list", "3"]),
        ("CONTROLLERS = [3]", ["a name and a method bind"]),
        (LAWS + "CONTROLLERS = [Plain]", ["Plain()", "gamma"]),
        (LAWS + "a, b = Plain(1.0), Plain(2.0)", ["'plain' occurs 2 times"]),
        (LAWS + "class Wrong(Plain):\n    bind = 3\nwrong = Wrong(1.0)", ["Wrong 'plain': bind fails"]),
    ],
)
def test_a_file_that_is_wrong(folder, capsys, laws, words):
    """The command prints one sentence on standard error, nothing on standard output, and has exit code 2."""
    case, file = folder(CASE, laws)
    for command in ("run", "certify"):
        assert main([command, str(case), "--controllers", str(file)]) == 2
        said = capsys.readouterr()
        assert not said.out and said.err.count("\n") == 1
        assert all(word in said.err for word in words), said.err


def test_a_class_that_no_table_can_make(folder):
    case, laws = folder(CASE + OWN.replace('"Plain"', '"Bare"'))
    assert "dataclass" in refusal(lambda: load_case(case, laws))
    odd = LAWS + "@dataclass(frozen=True)\nclass Odd(Plain):\n    gain: np.ndarray = None\n"
    case, laws = folder(CASE + OWN.replace('"Plain"', '"Odd"'), odd)
    assert "ndarray" in refusal(lambda: load_case(case, laws))


def test_no_file_no_code(folder, tmp_path):
    """A case alone runs no code, not even from a file in the same folder, whatever its name."""
    case, _ = folder(CASE + OWN, "raise SystemExit(7)")
    assert "scheme" in refusal(lambda: load_case(case))
    assert "is not a file" in refusal(lambda: load_case(case, tmp_path / "other.py"))


def test_an_installed_package(tmp_path, monkeypatch, folder):
    """A package registered under barbalat.controllers is imported only when a case names it."""
    (tmp_path / "somelaws.py").write_text(LAWS)
    (tmp_path / "somelaws-1.0.dist-info").mkdir()
    (tmp_path / "somelaws-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: somelaws\nVersion: 1.0\n")
    points = "[barbalat.controllers]\nplain-law = somelaws:Plain\nbroken = somelaws:There\n"
    (tmp_path / "somelaws-1.0.dist-info" / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(tmp_path)
    load_case("paper")
    assert "somelaws" not in sys.modules
    case, _ = folder(CASE + OWN.replace('"Plain"', '"plain-law"') + KNOWN)
    found = load_case(case)
    monkeypatch.delitem(sys.modules, "somelaws")
    assert [type(c).__name__ for c in found.controllers] == ["Plain", "Mrac"]
    results = simulate(found.problem, found.controllers, found.simulation)
    np.testing.assert_allclose(results["plain"].e, results[Mrac.name].e, atol=1e-12)
    broken, _ = folder(CASE + OWN.replace('"Plain"', '"broken"'))
    assert "somelaws:There" in refusal(lambda: load_case(broken))


def test_the_help_loads_nothing_more():
    """Neither NumPy nor the entry points are loaded, so the command line starts as fast as without them."""
    code = (
        "import sys; from barbalat.cli import _parser; _parser(); "
        "print([m for m in ('numpy', 'casadi', 'importlib.metadata', 'pydantic') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]", out
