"""The package's public names: each has one module, is imported on first use, and is suggested for a misspelt name."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import barbalat
from barbalat.controllers import SCHEMES
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.public_names import PACKAGE, modules, places_of

ROOT = Path(__file__).parents[1]
SOURCE = Path(barbalat.__file__).parents[1]
HOMES = [PACKAGE, *(f"{PACKAGE}.{name}" for name in modules())]
STUBBED = [home for home in HOMES if places_of(home)]


def stub_of(home: str) -> Path:
    found = sys.modules[home].__file__ or ""
    return Path(found).with_suffix(".pyi")


@pytest.mark.parametrize("home", HOMES)
def test_a_public_module_says_what_is_in_it(home):
    """The names of a public module are in ``dir`` and ``__all__`` and exist, and the reference documents them."""
    module = importlib.import_module(home)
    assert inspect.getdoc(module)
    assert set(module.__all__) <= set(dir(module))
    assert all(getattr(module, name) is not None for name in module.__all__)
    pages = "\n".join(page.read_text(encoding="utf-8") for page in ROOT.glob("docs/reference/*.md"))
    named = home.removeprefix(f"{PACKAGE}.") if home != PACKAGE else ""
    assert re.search(rf"^```{{public-module}}.*{re.escape(named)}$", pages, re.MULTILINE)


@pytest.mark.parametrize("home", STUBBED)
def test_the_stub_is_the_one_list(home):
    """As for type checkers, each line imports one name under that name."""
    module = importlib.import_module(home)
    text = stub_of(home).read_text(encoding="utf-8")
    found = re.findall(r"^from (\S+) import (\w+) as (\w+)$", text, re.MULTILINE)
    assert sorted(name for _, name, _ in found) == module.__all__ == dir(module)
    assert all(name == shown for _, name, shown in found)
    assert len([line for line in text.splitlines() if "import" in line]) == len(found)
    for place, name, _ in found:
        inner = importlib.import_module(place, home if stub_of(home).name == "__init__.pyi" else PACKAGE)
        assert getattr(inner, name) is getattr(module, name)


def test_a_name_has_one_home():
    names = [name for home in HOMES for name in importlib.import_module(home).__all__]
    assert not {name for name in names if names.count(name) > 1}


def test_what_scripts_rely_on_stays_in_the_package_itself():
    fixed = "Problem Plant Simulation simulate simulate_ensemble certify load_case InputError Sampled OutputProblem OutputPlant"
    controllers = {kind.__name__ for registry in (SCHEMES, OUTPUT_SCHEMES) for kind in registry.values()}
    assert {*fixed.split(), *controllers} <= set(barbalat.__all__)


@pytest.mark.parametrize(
    ("code", "error", "said"),
    [
        ("door.Gradient", "AttributeError", "barbalat has no Gradient: it is in barbalat.laws"),
        ("from barbalat import Gradient", "ImportError", "barbalat has no Gradient: it is in barbalat.laws"),
        ("from barbalat.laws import Sine", "ImportError", "barbalat.laws has no Sine: it is in barbalat.signals"),
        ("from barbalat.signals import Problem", "ImportError", "barbalat.signals has no Problem: it is in barbalat"),
        ("door.Mrca", "AttributeError", "barbalat has no Mrca; did you mean barbalat.Mrac?"),
        ("from barbalat import Gradeint", "ImportError", "did you mean barbalat.laws.Gradient?"),
        ("door.signals.sine", "AttributeError", "did you mean barbalat.signals.Sine?"),
        ("from barbalat.studies import swep", "ImportError", "did you mean barbalat.studies.sweep?"),
        ("door.qqqqqq", "AttributeError", "barbalat has no qqqqqq"),
    ],
)
def test_a_name_that_is_elsewhere_or_misspelt_is_told_with_its_home(code, error, said):
    with pytest.raises((AttributeError, ImportError)) as raised:
        exec(code, {"door": barbalat})
    assert type(raised.value).__name__ == error
    assert str(raised.value).endswith(said)


def test_what_asks_politely_gets_an_answer():
    assert not hasattr(barbalat, "Gradient") and getattr(barbalat, "Sine", None) is None
    assert not hasattr(barbalat.laws, "__path__")


@pytest.mark.parametrize("home", [home for home in STUBBED if home != PACKAGE])
def test_a_public_module_imports_nothing_before_it_is_used(home):
    code = f"import sys, {home}; print(*sorted({{'numpy', 'casadi', 'pydantic', 'typing'}} & set(sys.modules)))"
    found = subprocess.run(
        [sys.executable, "-S", "-c", code],
        env=os.environ | {"PYTHONPATH": str(SOURCE)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.split() == []


def test_help_shows_what_a_class_takes():
    """The help does not show the arguments of the check for misspelt keywords. A callable object has the signature of its
    call."""
    shown = inspect.signature(barbalat.Mrac)
    assert list(shown.parameters)[:2] == ["gamma", "theta_hat0"] and shown.parameters["name"].default == "MRAC"
    assert str(inspect.signature(barbalat.Simulation)).startswith("(t_end: 'float', dt: 'float | None' = None, *, solver: ")
    assert list(inspect.signature(barbalat.signals.Constant(1.0)).parameters) == ["t"]


@pytest.mark.full
def test_type_checkers_read_every_name(tmp_path):
    lines = [f"from {home} import {name}" for home in STUBBED for name in importlib.import_module(home).__all__]
    (tmp_path / "names.py").write_text("\n".join([*lines, "reveal_type(Gradient)", 'Simulation(1.0, 0.1, solver="rk4")']))
    (tmp_path / "mypy.ini").write_text("[mypy]\nstrict = true\n")
    found = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", "mypy.ini", "names.py"],
        cwd=tmp_path, env=os.environ | {"MYPYPATH": str(SOURCE)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stdout
    assert "barbalat.adaptation.laws.gradient.Gradient" in found.stdout


def test_nothing_that_people_copy_imports_a_star():
    shown = [ROOT / "README.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.py")]
    assert not [page.name for page in shown if "import *" in page.read_text(encoding="utf-8")]
