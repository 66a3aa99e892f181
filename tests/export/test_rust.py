"""``--target rust``: a crate whose own test replays the simulation; compiled where cargo is installed."""

from __future__ import annotations

import subprocess

import pytest

from barbalat import InputError
from barbalat.exports import export_controller
from export.examples import SIMULATION
from export.targets import ISO, STRICT, needs, needs_gcc
from export.test_bit_identical import EXAMPLES
from export.test_shell import SHELLS, surrounded

KINDS = ("Mrac-several-euler", "LinearOutput-output", "Mrac-state-midpoint")


def crate(beginning, folder, **given):
    found = next(name for name in EXAMPLES if name.startswith(beginning))
    return export_controller(*EXAMPLES[found], SIMULATION, out=folder, target="rust", **given)


@needs("cargo")
@pytest.mark.parametrize("float32", [False, True])
@pytest.mark.parametrize("beginning", KINDS)
@pytest.mark.short(kept=lambda beginning, float32: beginning == KINDS[0] and not float32)
def test_the_crate_computes_the_simulations_bits(beginning, float32, tmp_path) -> None:
    crate(beginning, tmp_path, float32=float32, name="roll")
    done = subprocess.run(["cargo", "test", "--offline"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout and "warning" not in done.stderr


@needs("cargo")
@pytest.mark.dear
def test_a_crate_with_parameters_sets_them(tmp_path) -> None:
    """The crate sets everything that the C accepts, and a different gain gives different controls."""
    crate(KINDS[2], tmp_path, parameters=True, name="roll")
    text = (tmp_path / "lib.rs").read_text()
    tested = text.replace(
        "#[test]",
        """#[test]
    fn another_gain_makes_other_controls() {
        let (mut controller, mut other) = (Controller::new(), Controller::new());
        assert_eq!(other.set(SET_GAMMA, 0.5, 0), 0);
        assert_eq!(other.set(SET_GAMMA, -0.5, 0), 512);
        let differ = SAMPLES.iter().filter(|row| {
            let row = row.map(f64::from_bits);
            let (measured, r) = (row[..MEASURED].try_into().unwrap(), row[MEASURED..MEASURED + COMMANDS].try_into().unwrap());
            controller.step(SAMPLE_TIME, measured, r, false).u != other.step(SAMPLE_TIME, measured, r, false).u
        });
        assert!(differ.count() > 50);
    }

    #[test]""",
        1,
    )
    (tmp_path / "lib.rs").write_text(tested)
    done = subprocess.run(["cargo", "test", "--offline"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed" in done.stdout and "warning" not in done.stderr


@needs("cargo")
@pytest.mark.dear
def test_a_crate_whose_fallback_acts_at_once_passes_its_test(tmp_path) -> None:
    """The controller's output is not held if a measurement is lost."""
    problem, controller = surrounded(KINDS[2], SHELLS["at once"])
    export_controller(problem, controller, SIMULATION, out=tmp_path, target="rust")
    done = subprocess.run(["cargo", "test", "--offline"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@needs_gcc
def test_its_functions_of_plain_arguments_compile_without_a_warning(tmp_path) -> None:
    crate(KINDS[1], tmp_path)
    subprocess.run(["gcc", *ISO, *STRICT, "-c", "plain.c"], cwd=tmp_path, check=True, timeout=60)


def test_the_closed_loop_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="the rust target exports only the controller"):
        crate(KINDS[1], tmp_path, closed_loop=True)
