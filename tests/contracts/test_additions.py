"""An addition needs changes only in the places that CONTRIBUTING lists. They are made in a copy, in which all contracts must
hold.

A claim and a paper are added in ``tests/papers/test_slices.py``, a vehicle in ``tests/vehicles/test_a_vehicle_is_one_folder.py``.
"""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from copies import ROOT, barbalat_says, package_in, python_says, with_entry_point

HERE = ROOT.parents[1]
CASE = """
name = "An addition"

[plant]
A_m = [[0.0, 1.0], [-2.0, -3.0]]
b = [0.0, 1.0]
theta = [1.0, -0.5]
x0 = [0.5, 0.0]

[reference_model]
k_0 = 2.0

[reference]
kind = "{signal}"
amplitude = 1.0
frequency = 2.0

[uncertainty]
lower = [-2.0, -2.0]
upper = [2.0, 2.0]

[[controller]]
scheme = "{scheme}"
name = "one"
theta = [1.0, -0.5]

[[controller]]
scheme = "robust-mrac"
tau = 0.5
name = "other"

[controller.law]
kind = "{law}"
gamma = 10.0

[simulation]
t_end = 2.0
dt = 0.001
solver = "{solver}"
"""
OF_THE_PACKAGE = {"signal": "sine", "scheme": "known-parameters", "law": "gradient", "solver": "heun"}
ADDED = {"signal": "wave", "scheme": "knower", "law": "descent", "solver": "trapezoid"}


def copied(file: Path, to: Path, **names: str) -> None:
    """A copy of a module of the package with other names."""
    text = file.read_text()
    for old, new in names.items():
        text = re.sub(rf"\b{old}\b", new, text)
    assert not to.exists()
    to.write_text(text)


def inserted(file: Path, after: str, line: str) -> None:
    """A line of the user's own, below the existing one."""
    text = file.read_text()
    assert text.count(after) == 1, (file, after)
    file.write_text(text.replace(after, f"{after}\n{line}"))


def add_scheme(package: Path, tests: Path) -> None:
    """Add a scheme in five places: the file, its line in the registry, its public name, its certificate and an example."""
    copied(package / "controllers/known_parameters.py", package / "controllers/knower.py", KnownParameters="Knower")
    inserted(
        package / "controllers/__init__.py",
        "from barbalat.controllers.sampled import Sampled as Sampled",
        "from barbalat.controllers.knower import Knower as Knower",
    )
    inserted(package / "controllers/__init__.py", '    "known-parameters": KnownParameters,', '    "knower": Knower,')
    inserted(
        package / "__init__.pyi",
        "from .controllers import KnownParameters as KnownParameters",
        "from .controllers import Knower as Knower",
    )
    schemes = package / "certificates/schemes"
    copied(schemes / "known_parameters.py", schemes / "knower.py", KnownParameters="Knower")
    example = next(line for line in (tests / "independent.py").read_text().splitlines() if '"known-parameters": (Known' in line)
    inserted(
        tests / "independent.py",
        example,
        example.replace("known-parameters", "knower").replace("KnownParameters", "barbalat.Knower"),
    )
    inserted(tests / "independent.py", "import numpy as np", "import barbalat")


def add_law(package: Path, tests: Path) -> None:
    """Add a law in four places: the file, its line in the registry, its public name and an example; and its row on the page on
    laws."""
    laws = package / "adaptation/laws"
    copied(laws / "gradient.py", laws / "descent.py", Gradient="Descent")
    line = "from barbalat.adaptation.laws.gradient import Gradient as Gradient"
    inserted(laws / "__init__.py", line, line.replace("gradient", "descent").replace("Gradient", "Descent"))
    inserted(laws / "__init__.py", '    "gradient": Gradient,', '    "descent": Descent,')
    inserted(
        package / "laws.pyi",
        "from .adaptation.laws import Gradient as Gradient",
        "from .adaptation.laws import Descent as Descent",
    )
    with (tests / "adaptation/examples.py").open("a") as file:
        file.write('LAW_EXAMPLES["descent"] = LAW_EXAMPLES["gradient"]\n')
    page = tests.parent / "docs/laws.md"
    row = next(line for line in page.read_text().splitlines() if line.startswith("| `gradient` |"))
    inserted(page, row, row.replace("gradient", "descent"))


def add_signal(package: Path, tests: Path) -> None:
    """Add a signal in four places: a class, its line in the registry, its public name and an example."""
    smooth = package / "signals/smooth.py"
    (sine,) = re.findall(r"\n@dataclass\(frozen=True\)\nclass Sine\(.*?(?=\n@|\Z)", smooth.read_text(), re.DOTALL)
    smooth.write_text(smooth.read_text() + sine.replace("class Sine(", "class Wave("))
    inserted(package / "signals/registry.py", '    "sine": Sine,', '    "wave": Wave,')
    inserted(
        package / "signals/registry.py",
        "from barbalat.signals.recorded import MatFile, Recorded",
        "from barbalat.signals.smooth import Wave",
    )
    inserted(package / "signals/__init__.pyi", "from .smooth import Sine as Sine", "from .smooth import Wave as Wave")
    with (tests / "contracts/case_examples.py").open("a") as file:
        file.write('SIGNALS["wave"] = SIGNALS["sine"]\n')


def add_solver(package: Path, tests: Path) -> None:
    """Add a solver in four places: a tableau, its name in the registry, its public name and its step by hand in the tests."""
    tableau, registry = package / "solvers/tableau.py", package / "solvers/registry.py"
    with tableau.open("a") as file:
        file.write('TRAPEZOID = Tableau("trapezoid", 2, ((), (1.0,)), (1 / 2, 1 / 2), (0.0, 1.0))\n')
    registry.write_text(
        registry.read_text().replace("HEUN, RK4", "HEUN, RK4, TRAPEZOID", 1).replace("HEUN, RK4)}", "HEUN, RK4, TRAPEZOID)}")
    )
    inserted(package / "solvers/__init__.pyi", "from .tableau import RK4 as RK4", "from .tableau import TRAPEZOID as TRAPEZOID")
    independent = tests / "independent.py"
    independent.write_text(independent.read_text().replace('solver == "heun"', 'solver in ("heun", "trapezoid")'))


def numbers(folder: Path, **names: str) -> tuple[dict, dict]:
    """The output of ``run`` and ``certify`` for the case with these names."""
    (folder / "case.toml").write_text(CASE.format(**names))
    said = [json.loads(barbalat_says(command, "case.toml", "--json", path=folder)) for command in ("run", "certify")]
    return said[0]["controllers"], said[1]["controllers"]


@pytest.mark.full
def test_a_scheme_a_law_a_signal_and_a_solver_take_the_places_of_contributing(tmp_path):
    """All four are added in one copy. They work in case files, run and certify, and satisfy the contracts of all registered
    names."""
    package, tests = package_in(tmp_path / "src"), tmp_path / "tests"
    shutil.copytree(HERE / "tests", tests, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(HERE / "docs", tmp_path / "docs", ignore=shutil.ignore_patterns("gallery"))
    shutil.copy(HERE / "pyproject.toml", tmp_path)
    before = numbers(package.parent, **OF_THE_PACKAGE)
    for add in (add_scheme, add_law, add_signal, add_solver):
        add(package, tests)
    python_says("-m", "barbalat.cases.key_tables", str(tmp_path / "docs/cases.md"), path=package.parent)
    assert numbers(package.parent, **ADDED) == before
    python_says(
        "-m", "pytest", "-p", "no:cacheprovider", "-n", "0", str(tests / "contracts/test_registries.py"), path=package.parent
    )


@pytest.mark.full
def test_a_command_is_one_file_and_its_name(tmp_path):
    package = package_in(tmp_path)
    copied(package / "commands/cases.py", package / "commands/examples.py")
    examples = package / "commands/examples.py"
    examples.write_text(examples.read_text().replace('add_parser("cases"', 'add_parser("examples"'))
    inserted(package / "cli.py", "    claims,\n    completion,\n    contest,", "    examples,")  # the import
    text = (package / "cli.py").read_text()
    (package / "cli.py").write_text(text.replace("COMMANDS = (\n", "COMMANDS = (\n    examples,\n"))
    assert barbalat_says("examples", "--json", path=tmp_path) == barbalat_says("cases", "--json", path=tmp_path)


TARGET = '''
"""A list of the controller's operations, for readers."""

from barbalat.export.target import Target


def _files(asked):
    from barbalat.export.contents import Contents
    from barbalat.lowering.c99 import DOUBLE

    found = Contents.of(asked.problem, asked.controller, asked.simulation, DOUBLE)
    return {"operations.txt": "".join(f"{op.name}\\n" for op in found.step.operations)}
CHECK = "cat {}/operations.txt"
TARGETS = (Target(name="listing", help="operations", files=_files, check=lambda folder, _: CHECK.format(folder)),)
'''


def test_an_export_target_is_one_folder(tmp_path):
    (tmp_path / "listing").mkdir()
    (tmp_path / "listing/__init__.py").touch()
    (tmp_path / "listing/target.py").write_text(TARGET)
    with_entry_point(tmp_path, "barbalat.export_targets", "listing")
    assert "one of ardupilot, c99, fmu2, fmu3, rust, listing" in " ".join(
        barbalat_says("export", "--help", path=tmp_path).split()
    )
    said = barbalat_says(
        "export", "first-order", "--controller", "MRAC, sampled", "--target", "listing", "--out", "made", "--json", path=tmp_path
    )
    assert json.loads(said)["files"] == ["operations.txt"]
    assert "mul" in (tmp_path / "made/operations.txt").read_text().split()
