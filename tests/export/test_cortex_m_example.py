"""The example on a microcontroller compiles for an emulated Cortex-M4F, and its interrupt flies what the page simulates."""

import re
import subprocess
from pathlib import Path

import pytest
from targets import needs

from barbalat import L1Adaptive, ParameterBox, Plant, Problem, ReferenceModel, Sampled, Simulation, input_filter, simulate
from barbalat.exports import export_controller
from barbalat.plants import PlantInput
from barbalat.signals import Constant

BOARD = Path(__file__).parents[2] / "examples" / "cortex-m"
PROBLEM = Problem(
    plant=Plant(A=[[0, 1], [0, -2]], b=[0, 5], A_m=[[0, 1], [-9, -4.2]], input=PlantInput(saturation=[-4, 4])),
    reference_model=ReferenceModel(k_0=9 / 5),
    reference=Constant(amplitude=1),
    uncertainty=ParameterBox(lower=[0, -1], upper=[3, 2]),
)
CONTROLLER = Sampled(controller=L1Adaptive(gamma=1e3, filter=input_filter(kappa=0.02)), sample_time=1e-3)
SIMULATION = Simulation(t_end=1, dt=1e-3)


def output(folder: Path, program: str, timing: str = "") -> str:
    """What the program prints if it is built and run by the commands of the export's README."""
    readme = (folder / "law_README.md").read_text()
    build, run = re.search(r"    (arm-none-eabi-gcc .*?)\n    (qemu-system-arm .*?)\n", readme, re.DOTALL).groups()
    for command in (build.replace("law_selftest.c", f"{program} -Wall -Wextra -Werror"), run + timing):
        done = subprocess.run(command, cwd=folder, shell=True, capture_output=True, text=True, check=True, timeout=60)
    return done.stdout


def flown(folder: Path, app: str) -> tuple[int, int, int, float]:
    """Samples, wrong times, other statuses and the final x[0] of this application; an emulated instruction takes 32 ns."""
    (folder / "app.c").write_text(app)
    printed = output(folder, "app.c", " -icount shift=5")
    samples, wrong, others, x = re.fullmatch(r"(\d+) samples, (\d+) at .*?, (\d+) with .*?, x = (.*)\n", printed).groups()
    return int(samples), int(wrong), int(others), float(x)


@pytest.mark.full
@needs("arm-none-eabi-gcc", "qemu-system-arm")
def test_the_example_on_a_microcontroller_flies_and_measures_its_timer(tmp_path) -> None:
    """The commands of the README run the self-test. The emulated loop, which starts at rest with a fade of 0.1 s and takes Euler
    steps of the plant, ends near the simulated one. With a timer that is 0.4 % slow, every step reports a wrong sample time.
    """
    folder = export_controller(PROBLEM, CONTROLLER, SIMULATION, out=tmp_path / "made", float32=True, name="law")
    for name in ("startup.c", "memory.ld"):
        (folder / name).write_text((BOARD / name).read_text())
    assert "agree in every bit" in output(folder, "law_selftest.c")
    app = (BOARD / "app.c").read_text()
    samples, wrong, others, x = flown(folder, app)
    assert (samples, wrong, others) == (1000, 0, 0)
    simulated = simulate(PROBLEM, [CONTROLLER], SIMULATION)["L1"].x[-1, 0]
    assert abs(x - simulated) < 0.02 * simulated
    slow = app.replace("SYST_RVR = PERIOD - 1u", "SYST_RVR = PERIOD + 99u")
    assert slow != app and flown(folder, slow)[:3] == (1000, 1000, 0)
