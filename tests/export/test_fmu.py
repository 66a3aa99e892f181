"""Units of FMI 2.0 and 3.0, checked by FMPy: valid, complete, equal to simulations bit for bit, with states saved as bytes."""

from __future__ import annotations

import ctypes
import math
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from barbalat import Mrac, Sampled, Simulation
from barbalat.cases.load import load_case
from barbalat.cli import main
from barbalat.export.acceptance import Order
from barbalat.export.parameters import Opened
from barbalat.exports import export_controller
from barbalat.plants import Labels, PlantInput
from barbalat.signals import Sine, Square
from export.examples import FREE, STATE, T, sampled_examples
from export.made import files, units
from export.slave import Slave
from export.targets import ISO, STRICT, needs, needs_gcc, write
from export.units import Ensemble, write_units
from foreign import Plain, PlainEquations
from independent import refusal

SHORT = Simulation(t_end=10.0, dt=T / 2)
EXAMPLES = {name: (problem, controller) for name, problem, controller in sampled_examples()}
SAMPLES = 60
LIMITS = {f"plant.input.saturation[{side}]" for side in (0, 1)}


def one(start: str) -> str:
    return next(name for name in EXAMPLES if name.startswith(start))


CHOSEN = [
    one("L1Adaptive-state-midpoint"), one("Mrac-free-euler"), one("L1Adaptive-terms"), one("L1Adaptive-several"),
    one("NormalizedMrac-ball"), one("RobustMrac-state-midpoint"), one("LinearFeedback"), one("KnownParameters"),
    one("MracOutput-third"), one("L1Output"), one("L1PiecewiseConstant-state"),
]  # fmt: skip


def head(version: int) -> str:
    """The standard's header, from FMPy."""
    import fmpy

    return (Path(fmpy.__file__).parent / "c-code" / f"fmi{version}Functions.h").read_text()


def declared(version: int) -> set[str]:
    return set(re.findall(rf"FMI{version}_Export fmi{version}\w+TYPE\s+(fmi{version}\w+);", head(version)))


@needs_gcc
@pytest.mark.parametrize(("name", "version"), [(name, 2 + i % 2) for i, name in enumerate([*CHOSEN, CHOSEN[0]])])
@pytest.mark.short(kept=lambda name, version: name == CHOSEN[1])
@pytest.mark.dear
def test_a_loop_of_units_is_the_simulation(name, version, tmp_path) -> None:
    """FMPy's validation finds no fault. A master closes the loop of controller and plant. This loop and the unit of the whole
    loop give, bit for bit, the state of an ensemble in which each parameter has a different value in one member.
    """
    from fmpy.validation import validate_fmu

    problem, controller = EXAMPLES[name]
    paths = write_units(tmp_path, problem, controller, SHORT, version)
    assert [validate_fmu(str(path)) for path in paths.values()] == [[], [], []]
    ensemble = Ensemble(problem, controller, SHORT)
    assert len(ensemble.opened.parameters) >= 2
    expected = ensemble.run(SAMPLES)
    for member in range(len(ensemble.opened.cases)):
        found = closed(paths, tmp_path, ensemble, member)
        parts = ensemble.batch.loop.unpack
        for k, (by_two, by_one) in enumerate(found):
            after = parts(expected[k, :, member])
            estimates = getattr(after.controller, "theta_hat", np.empty(0))
            wanted = np.concatenate([part.reshape(-1) for part in (after.held.u, estimates, after.x)])
            assert wanted.tobytes() == np.array(by_two).tobytes() == np.array(by_one).tobytes(), (member, k)


def closed(paths, folder, ensemble: Ensemble, member: int) -> list[tuple[list[float], list[float]]]:
    """u, the estimates and x after each sample, for a loop of two units and for one unit with both."""
    starts, noise = ensemble.value(member), ensemble.noise(SAMPLES, member)
    controller, plant, loop = (Slave(paths[what], folder, starts) for what in ("controller", "plant", "loop"))
    assert any(name in slave.at for slave in (controller, plant) for name in starts) or not starts
    measured = "y" if "y" in controller.at else "x"
    found = []
    for k in range(SAMPLES):
        r = ensemble.commands(k)
        plant.set_all("noise", noise[k])
        loop.set_all("noise", noise[k])
        controller.set_all("r", r)
        loop.set_all("r", r)
        controller.set_all(measured, plant.get_all(measured))
        controller.step(k * T, T)
        plant.set_all("u", controller.get_all("u"))
        plant.step(k * T, T)
        loop.step(k * T, T)
        by_two = [*controller.get_all("u"), *controller.get_all("theta_hat"), *plant.get_all("plant.x")]
        found.append((by_two, [*loop.get_all("u"), *loop.get_all("theta_hat"), *loop.get_all("plant.x")]))
    for slave in (controller, plant, loop):
        slave.close()
    return found


@needs_gcc
@pytest.mark.full
@pytest.mark.parametrize("version", [2, 3])
def test_all_functions_are_there_as_the_standard_declares_them(version, tmp_path) -> None:
    """The sources compile without a warning with the standard's headers, which check every signature."""
    import fmpy

    path = write_units(tmp_path, *EXAMPLES[CHOSEN[0]], SHORT, version)["loop"]
    fmpy.extract(str(path), str(tmp_path / "loop"))
    here = fmpy.platform if version == 2 else fmpy.platform_tuple
    (binary,) = (tmp_path / "loop" / "binaries" / here).glob("*.so")
    library = ctypes.CDLL(str(binary))
    names = declared(version)
    assert len(names) == {2: 44, 3: 75}[version]
    assert {name for name in names if name in library.__dict__ or library[name]} == names
    sources = tmp_path / "loop" / "sources"
    own = [*ISO, *STRICT, "-DFMI_OFFICIAL_HEADERS", f"-I{Path(fmpy.__file__).parent / 'c-code'}"]
    compiled = sorted(file.name for file in sources.glob("*.c"))
    subprocess.run(["gcc", *own, "-c", *compiled], cwd=sources, check=True, timeout=60)
    subprocess.run(["gcc", *ISO, *STRICT, "-c", *compiled], cwd=sources, check=True, timeout=60)
    if shutil.which("nm"):
        shown = subprocess.run(["nm", "-D", "--defined-only", binary], capture_output=True, text=True, check=True).stdout
        assert {line.split()[-1] for line in shown.splitlines()} == names  # nothing else is visible


STEPPED = """\
#include "fmi3Functions.h"
#include "model.h"
#include <stdio.h>

int main(void)
{
    fmi3Instance c = fmi3InstantiateCoSimulation("c", MODEL_TOKEN, "", false, false, false, false, NULL, 0, NULL, NULL, NULL);
    fmi3Boolean events, end, early;
    fmi3Float64 reached, u;
    const fmi3ValueReference inputs[] = { X_1, X_2, R }, output[] = { U };
    fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0);
    fmi3ExitInitializationMode(c);
    for (int k = 0; k < 40; ++k) {
        const fmi3Float64 given[] = { 0.01 * k, 0.3 - 0.01 * k, 1.0 };
        fmi3SetFloat64(c, inputs, 3, given, 3);
        fmi3DoStep(c, k * MODEL_STEP, MODEL_STEP, false, &events, &end, &early, &reached);
        fmi3GetFloat64(c, output, 1, &u, 1);
        printf("%a\\n", u);
    }
    fmi3FreeInstance(c);
    return 0;
}
"""


@needs("gcc", "aarch64-linux-gnu-gcc", "qemu-aarch64")
@pytest.mark.full
def test_a_unit_made_on_linux_has_a_binary_for_aarch64_too(tmp_path) -> None:
    """The binary is made by the cross compiler, and in qemu its results are bit-identical to those of this machine's binary."""
    import fmpy

    path = write_units(tmp_path, *EXAMPLES[one("Mrac-free-midpoint")], SHORT, 3)["controller"]
    fmpy.extract(str(path), str(tmp_path / "unit"))
    slave = Slave(path, tmp_path)
    (tmp_path / "main.c").write_text(STEPPED)
    (binary,) = (tmp_path / "unit" / "binaries" / "aarch64-linux").glob("*.so")
    at = {"X_1": "x[1]", "X_2": "x[2]", "R": "r", "U": "u"}
    command = [
        "aarch64-linux-gnu-gcc",
        f"-I{Path(fmpy.__file__).parent / 'c-code'}",
        f"-I{tmp_path / 'unit' / 'sources'}",
        "main.c",
    ]
    command += [
        *(f"-D{name}={slave.at[of]}" for name, of in at.items()),
        str(binary),
        f"-Wl,-rpath,{binary.parent}",
        "-o",
        "main",
    ]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    emulated = ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu", "./main"]
    shown = subprocess.run(emulated, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60).stdout
    for k, line in enumerate(shown.split()):
        slave.set({"x[1]": 0.01 * k, "x[2]": 0.3 - 0.01 * k, "r": 1.0})
        slave.step(k * T, T)
        assert slave.get("u") == [float.fromhex(line)], k
    assert k == 39
    slave.close()


RESUME = """
import sys
from pathlib import Path
from export.slave import Slave

path, folder, start, stop = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
slave = Slave(path, folder)
if start:
    slave.restore((folder / "state").read_bytes())
for k in range(start, stop):
    slave.set({"r": float(k % 7), "controller[0].gamma": 5.0 + (k > 20)})
    slave.step(k * slave.size, slave.size)
print([value.hex() for value in slave.get_all("plant.x") + slave.get_all("theta_hat")])
(folder / "state").write_bytes(slave.saved())
slave.close()
"""


@needs_gcc
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.full
def test_a_state_goes_on_in_another_process(version, tmp_path) -> None:
    path = write_units(tmp_path, STATE, Sampled(controller=Mrac(gamma=5.0), sample_time=T), SHORT, version)["loop"]

    def played(folder: str, start: int, stop: int) -> str:
        (tmp_path / folder).mkdir(exist_ok=True)
        command = [sys.executable, "-c", RESUME, str(path), str(tmp_path / folder), str(start), str(stop)]
        return subprocess.run(
            command, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=True, timeout=60
        ).stdout

    played("parts", 0, 15)
    assert played("parts", 15, 40) == played("whole", 0, 40)


@needs_gcc
@pytest.mark.full
@pytest.mark.parametrize("version", [2, 3])
def test_states_are_got_set_and_freed(version, tmp_path) -> None:
    """A step is undone and repeated. Bytes of a different unit or too few bytes are rejected."""
    paths = write_units(tmp_path, *EXAMPLES[one("Mrac-state-midpoint")], SHORT, version)
    slave, other = Slave(paths["loop"], tmp_path), Slave(paths["plant"], tmp_path)
    slave.step(0.0, T)
    before = slave.saved()
    slave.step(T, T)
    after = slave.get_all("plant.x")
    slave.restore(before)
    assert slave.get_all("plant.x") != after
    slave.step(T, T)
    assert slave.get_all("plant.x") == after
    for wrong in (other.saved(), before[:-1], bytes([before[0] ^ 1]) + before[1:]):
        with pytest.raises(Exception, match=r"[Ff]ail|error|status"):
            slave.restore(wrong)
    slave.step(2 * T, T)
    slave.close()
    other.close()


@needs_gcc
@pytest.mark.parametrize("version", [2, 3])
def test_a_step_that_is_repeated_or_left_out_is_refused_however_late(version, tmp_path) -> None:
    """Such a step is rejected even after a million samples. An instant with the accumulated rounding of that many steps is
    accepted."""
    made = units(FREE, EXAMPLES[one("Mrac-free-euler")][1], SHORT, version=version)
    (path,) = (write(tmp_path / "made", {}) / name for name in made)
    path.write_bytes(made[path.name])
    slave = Slave(path, tmp_path)
    late = 1_200_000
    slave.step(0.0, late * T)
    for off in (-1, 1):
        with pytest.raises(Exception, match=r"[Ff]ail|error|status"):
            slave.step((late + off) * T, T)
    slave.step(sum([T] * late), T)
    slave.close()


@needs_gcc
@pytest.mark.full
@pytest.mark.parametrize("version", [2, 3])
def test_misuse_is_refused_and_changes_nothing(version, tmp_path) -> None:
    paths = write_units(tmp_path, *EXAMPLES[one("Mrac-state-midpoint")], SHORT, version)
    slave, right = Slave(paths["controller"], tmp_path), Slave(paths["controller"], tmp_path)
    for wrong in (
        lambda: slave.set({"u": 1.0}),  # an output
        lambda: slave.set({"controller[0].theta_hat0[0]": 1.0}),  # fixed since the start
        lambda: slave.set({"controller[0].gamma": float("nan")}),
        lambda: slave.set({"controller[0].gamma": -5.0}),
        lambda: slave.set({"controller[0].gamma": 0.0}),
        lambda: slave.set({"uncertainty.lower[0]": 3.0}),  # above the upper one
        lambda: slave.set({"uncertainty.upper[1]": -2.0, "controller[0].gamma": 6.0}),
        lambda: slave.set({"plant.input.saturation[0]": 1.0}),
        lambda: slave.set({"controller[0].gamma": 1e9}),
        lambda: slave.step(0.0, 0.4 * T),
        lambda: slave.step(0.0, 0.0),
        lambda: slave.step(0.0, -T),
        lambda: slave.step(7 * T, T),  # not where it is
    ):
        with pytest.raises(Exception, match=r"[Ff]ail|error|status"):
            wrong()
    for one_of in (slave, right):
        one_of.set({"x[1]": 0.7, "r": 1.0})
        one_of.step(0.0, T)
        one_of.step(T, 2 * T)  # several samples at once
    assert slave.get_all("u") == right.get_all("u")
    slave.set(
        {"x[1]": float("nan")}
    )  # NaN is treated as the last good sample, frozen, with the last u; the status states the reason
    right.freeze(True)
    held = slave.get_all("u")
    for one_of in (slave, right):
        one_of.step(3 * T, T)
    assert slave.get_all("u") == held == right.get_all("u")  # a law without memory of x and r has the same u for the same sample
    assert (slave.whole("status"), right.whole("status")) == (2, 0)
    right.freeze(False)
    for k, one_of in enumerate((slave, right)):
        one_of.set({"x[1]": 0.6})
        one_of.step(4 * T, T)
        assert one_of.whole("status") == 0, k
    assert slave.get_all("u") == right.get_all("u") != held
    for kept in sorted({one.partition("[")[0] for one in slave.at if one.startswith(("state.", "theta_hat["))}):
        assert slave.get_all(kept) == right.get_all(kept)
    slave.close()
    right.close()


def test_parameters_are_what_enters_as_it_is() -> None:
    """Gains, limits, bounds of the known set and initial estimates are parameters. A filter's poles, P and the sample time are
    compiled in."""
    problem, controller = EXAMPLES[one("L1Adaptive-state-midpoint")]
    opened = Opened.of(problem, controller, SHORT, tunable=True)
    names = [one.name for one in opened.parameters]
    bounds = {f"uncertainty.{side}[{i}]" for side in ("lower", "upper") for i in (0, 1)}
    assert bounds < set(names)
    assert {f"controller[0].{name}" for name in ("gamma", "theta_hat0[0]", "theta_hat0[1]")} | LIMITS | {
        "plant.theta[0]",
        "plant.x0[1]",
    } <= set(names)
    assert not any("filter" in name or "sample_time" in name or "delay" in name or "A_m" in name for name in names)
    place = {one.name: i for i, one in enumerate(opened.parameters)}
    lower, upper = (place[f"plant.input.saturation[{side}]"] for side in (0, 1))
    of_limits = {Order(lower, 0.0, strict=False), Order(0.0, upper, strict=False), Order(lower, upper, strict=True)}  # not [0, 0]
    estimates = [place[f"controller[0].theta_hat0[{i}]"] for i in (0, 1)]
    of_set = {Order(place[f"uncertainty.lower[{i}]"], estimates[i], strict=False) for i in (0, 1)}
    of_set |= {Order(estimates[i], place[f"uncertainty.upper[{i}]"], strict=False) for i in (0, 1)}
    others = {Order(0.0, place["plant.input.rate_limit"], strict=True)} & set(opened.conditions)
    assert set(opened.conditions) == of_limits | of_set | others | {Order(0.0, place["controller[0].gamma"], strict=True)}
    assert not Opened.of(problem, controller, SHORT, tunable=False).parameters
    others = {
        "Mrac-gain": "controller[0].theta_hat0[2]",
        "MracOutput-third": "controller[0].c_0_min",
        "NormalizedMrac-ball": "uncertainty.radius",
    }
    for example, name in others.items():
        opened = Opened.of(*EXAMPLES[one(example)], SHORT, tunable=True)
        assert name in [one.name for one in opened.parameters]
        assert "controller[0].theta_hat0[0]" in [one.name for one in opened.parameters]


@needs_gcc
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.short(kept=lambda version: version == 3)
@pytest.mark.dear
def test_bounds_that_exclude_the_initial_estimate_are_refused_and_all_three_can_be_moved_together(version, tmp_path) -> None:
    path = write_units(tmp_path, *EXAMPLES[one("Mrac-state-midpoint")], SHORT, version)["controller"]
    with pytest.raises(Exception, match=r"[Ff]ail|error|status"):  # where the start is left
        Slave(path, tmp_path, {"uncertainty.lower[0]": 3.0})
    slave = Slave(path, tmp_path, {"uncertainty.lower[0]": 3.0, "uncertainty.upper[0]": 4.0, "controller[0].theta_hat0[0]": 3.5})
    slave.set({"uncertainty.lower[0]": 3.25, "uncertainty.upper[0]": 6.0})
    for beyond in ({"uncertainty.lower[0]": 7.0}, {"uncertainty.lower[0]": 5.0, "uncertainty.upper[0]": 6.0}):
        with pytest.raises(Exception, match=r"[Ff]ail|error|status"):
            slave.set(beyond)
    assert slave.get("uncertainty.lower[0]", "uncertainty.upper[0]") == [3.25, 6.0]
    slave.step(0.0, T)
    assert slave.whole("status") == 0
    slave.close()


@needs_gcc
@pytest.mark.full
@pytest.mark.parametrize("name", ["Mrac-state-midpoint", "Mrac-state-euler", "NormalizedMrac-ball-midpoint", "RobustMrac-state"])
def test_a_bound_that_is_moved_past_an_estimate_brings_it_in(name, tmp_path) -> None:
    """No sample is rejected because of the new bound. After the next sample the estimate is at the new bound or inside it."""
    paths, begun = write_units(tmp_path, *EXAMPLES[one(name)], SHORT, 2), 0.1
    slave = Slave(paths["loop"], tmp_path, {"controller[0].theta_hat0[0]": begun})
    ball = "uncertainty.radius" in slave.at
    size = (lambda given: math.hypot(*given)) if ball else (lambda given: given[0])
    start = size(slave.get_all("theta_hat"))
    slave.set({"r": 1.0})
    for k in range(40):
        slave.step(k * T, T)
    before = size(slave.get_all("theta_hat"))
    assert abs(before - start) > 1e-6
    bound, above = (start + before) / 2, before > start  # between both: the set still contains the initial estimate
    slave.set({"uncertainty.radius" if ball else f"uncertainty.{'upper' if above else 'lower'}[0]": bound})
    slave.step(40 * T, T)
    assert slave.whole("status") == 0
    after = size(slave.get_all("theta_hat"))
    assert after <= bound + 1e-12 if above else after >= bound - 1e-12
    slave.close()


class BranchingEquations(PlainEquations):
    def derivative(self, state, x, x_m, r, u):
        return super().derivative(state, x if float(self.gamma) > 1.0 else -x, x_m, r, u)


class Branching(Plain):
    def bind(self, known):
        plain = super().bind(known)
        return BranchingEquations(plain.gamma, plain.P_b, plain.k_0, plain.n)


def test_of_a_strangers_settings_those_are_parameters_that_bear_a_symbol() -> None:
    for kind, expected in ((Plain, True), (Branching, False)):
        controller = Sampled(controller=kind(gamma=2.0, name="own"), sample_time=T, discretization="euler")
        opened = Opened.of(FREE, controller, SHORT, tunable=True)
        assert ("controller[0].gamma" in [one.name for one in opened.parameters]) == expected
        assert {one.name for one in opened.parameters} >= LIMITS


def test_a_measured_output_without_labels_is_y(tmp_path) -> None:
    import fmpy

    problem, controller = EXAMPLES[next(name for name in EXAMPLES if name.startswith("MracOutput-output-euler"))]
    (content,) = units(problem, controller, SHORT, version=2, compiled=False).values()
    (tmp_path / "y.fmu").write_bytes(content)
    assert "y" in {one.name for one in fmpy.read_model_description(str(tmp_path / "y.fmu")).modelVariables}


def test_units_have_units(tmp_path) -> None:
    import fmpy

    problem = replace(FREE, labels=Labels(names=("alpha", "q"), units=("rad", "rad/s"), input_units=("deg",)))
    controller = Sampled(controller=Mrac(gamma=5.0), sample_time=T)
    for version in (2, 3):
        made = units(problem, controller, SHORT, version=version, compiled=False)
        for name, content in made.items():
            (tmp_path / name).write_bytes(content)
            described = fmpy.read_model_description(str(tmp_path / name))
            found = {one.name: one.unit for one in described.modelVariables}
            assert (found["alpha"], found["q"], found["u"], found["controller[0].gamma"]) == ("rad", "rad/s", "deg", None)
            meant = {one.name: one.description for one in described.modelVariables}
            assert meant["alpha"] == "measured state x[1]" and "x[1]" not in found
            states = [one for one in ("state.held_x_m[2]", "state.held_measured[2]", "plant.x[2]") if one in found]
            assert states and all(found[one] == "rad/s" and meant[one].endswith(": q") for one in states)
            if "plant.x0[1]" in found:
                assert (found["plant.x0[1]"], meant["plant.x0[1]"]) == ("rad/s", "initial state: q")
            bases = {one.name: one.baseUnit for one in described.unitDefinitions}
            assert (bases["rad"].rad, bases["rad/s"].rad, bases["rad/s"].s, bases["deg"].rad) == (1, 1, -1, 1)
            assert math.isclose(bases["deg"].factor, math.pi / 180)
    taken = replace(FREE, labels=Labels(names=("u", "q")))  # names of other variables are unchanged
    (content,) = units(taken, controller, SHORT, version=2, compiled=False).values()
    (tmp_path / "taken.fmu").write_bytes(content)
    assert {"x[1]", "q", "u"} <= {one.name for one in fmpy.read_model_description(str(tmp_path / "taken.fmu")).modelVariables}
    spaced = replace(FREE, labels=Labels(names=("pitch", "pitch rate")))
    (content,) = units(spaced, controller, SHORT, version=2, compiled=False).values()
    (tmp_path / "spaced.fmu").write_bytes(content)
    meant = {one.name: one.description for one in fmpy.read_model_description(str(tmp_path / "spaced.fmu")).modelVariables}
    assert meant["pitch"] == "measured state x[1]" and meant["pitch_rate"] == "measured state x[2], pitch rate"


@pytest.mark.parametrize("version", [2, 3])
def test_the_integral_of_a_baseline_has_no_label(version, tmp_path) -> None:
    """The integral is a state of the problem in addition to the states of the plant, to which the labels belong."""
    import fmpy

    case, seen = load_case("aircraft-lqi"), dict[str, set[tuple[str | None, str]]]()
    made = units(case.problem, case.controllers[0], case.simulation, version=version, closed_loop=True, compiled=False)
    for name, content in made.items():
        (tmp_path / name).write_bytes(content)
        for one in fmpy.read_model_description(str(tmp_path / name)).modelVariables:
            seen.setdefault(one.name, set()).add((one.unit, one.description))
    assert seen["plant.x0[0]"] == {("rad", "initial state: alpha")} and seen["plant.x0[1]"] == {("rad/s", "initial state: q")}
    assert seen["plant.x0[2]"] == {(None, "initial state")}


@needs_gcc
@pytest.mark.parametrize("name", [CHOSEN[0], CHOSEN[3], CHOSEN[8]])
@pytest.mark.short(kept=lambda name: name == CHOSEN[0])
def test_the_loop_in_c_is_the_simulation(name, tmp_path) -> None:
    """Noise, lag, limits, rate limit, delay and disturbances belong to the plant, at every instant of the solver's steps."""
    problem, controller = EXAMPLES[name]
    if problem.plant.paths[1:] == ():
        problem = replace(problem, disturbance=Sine(amplitude=0.3, frequency=2.0))
    write(tmp_path, files(problem, controller, SHORT, closed_loop=True))
    command = ["gcc", *ISO, "-O2", *STRICT, "controller.c", "plant.c", "loop.c", "-o", "loop", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    done = subprocess.run([tmp_path / "loop"], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0 and "closed loop: 1000 samples agree in every bit" in done.stdout, done.stdout
    text = (tmp_path / "plant.c").read_text()
    broken = re.sub(r"(const double t\d+ = t\d+) \* (t\d+;)", r"\1 + \2", text, count=1)
    assert broken != text
    (tmp_path / "plant.c").write_text(broken)
    subprocess.run(["gcc", *ISO, "-O2", "-w", *command[len(ISO) + 2 + len(STRICT) :]], cwd=tmp_path, check=True, timeout=60)
    assert subprocess.run([tmp_path / "loop"], capture_output=True, check=False, timeout=60).returncode == 1


def test_what_is_refused(tmp_path, monkeypatch, capsys) -> None:
    controller = Sampled(controller=Mrac(gamma=5.0), sample_time=T)
    monkeypatch.setenv("PATH", str(tmp_path))
    said = refusal(lambda: export_controller(FREE, controller, SHORT, out=tmp_path / "a", target="fmu2"))
    assert "none of cc, gcc, clang" in said and "export only the sources" in said
    assert "always has sources" in refusal(
        lambda: export_controller(FREE, controller, SHORT, out=tmp_path / "a", sources_only=True)
    )
    asked = ["export", "first-order", "--controller", "MRAC, sampled", "--target", "fmu3", "--out", str(tmp_path / "b")]
    assert main(asked) == 2
    assert not list(tmp_path.iterdir())
    assert main([*asked, "--sources-only", "--closed-loop"]) == 0
    assert sorted(file.name for file in (tmp_path / "b").iterdir()) == [
        "mrac_sampled.fmu", "mrac_sampled_loop.fmu", "mrac_sampled_plant.fmu",
    ]  # fmt: skip
    with pytest.raises(SystemExit):
        main([*asked, "--controller-only", "--closed-loop"])
    capsys.readouterr()


def test_the_check_that_is_named_can_be_run(tmp_path, capsys) -> None:
    """The command runs literally in a shell, for one unit and for three, in a folder whose name has a space."""
    for given in ([], ["--closed-loop"]):
        asked = ["export", "first-order", "--controller", "MRAC, sampled", "--target", "fmu2", "--sources-only"]
        assert main([*asked, *given, "--out", str(tmp_path / "a folder")]) == 0
        (check,) = re.findall(r"check it with: (.*)", " ".join(capsys.readouterr().err.split()))
        stand_in = f'fmpy() {{ test $# = 2 && test -f "$2" && echo seen; }}\n{check}'
        done = subprocess.run(["sh", "-c", stand_in], capture_output=True, text=True, check=True)
        assert done.stdout.count("seen") == len(list((tmp_path / "a folder").glob("*.fmu")))


@needs_gcc
@pytest.mark.full
def test_a_jump_inside_of_a_step_ends_the_replay(tmp_path) -> None:
    """The simulation splits its step at the jump, but an exported plant does not. The jump is at t = pi, after 314 samples of
    0.01 s."""
    problem = replace(
        FREE, reference=Square(amplitude=1.0, frequency=1.0), sensor=None, plant=replace(FREE.plant, input=PlantInput())
    )
    write(tmp_path, files(problem, Sampled(controller=Mrac(gamma=5.0), sample_time=T), SHORT, closed_loop=True))
    command = ["gcc", *ISO, "-O1", *STRICT, "controller.c", "plant.c", "loop.c", "-o", "loop", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    done = subprocess.run([tmp_path / "loop"], capture_output=True, text=True, check=False, timeout=60)
    assert done.stdout == "mrac, closed loop: 314 samples agree in every bit\n"
