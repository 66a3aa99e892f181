"""Ctrl-C stops a command at once, even if a library ignores it."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

from barbalat.__main__ import main as start
from barbalat.commands.interrupt import RETRY_PERIOD, Terminated, interruptible
from barbalat.processes import deaf_children, undisturbed

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no timers of signals")


def test_an_interrupt_that_is_dropped_comes_again():
    """As with CasADi, the first two interrupts are lost, and a loop would continue."""
    dropped = 0
    with pytest.raises(KeyboardInterrupt), interruptible():
        for _ in range(2):
            try:
                if not dropped:
                    os.kill(os.getpid(), signal.SIGINT)
                time.sleep(20 * RETRY_PERIOD)
            except KeyboardInterrupt:
                dropped += 1
        time.sleep(20 * RETRY_PERIOD)
    assert dropped == 2
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) == signal.SIG_DFL


def test_tidying_up_is_not_interrupted_again():
    tidied = []
    with pytest.raises(KeyboardInterrupt), interruptible():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(20 * RETRY_PERIOD)
        finally:
            started = time.monotonic()
            while time.monotonic() < started + 3 * RETRY_PERIOD:
                time.sleep(RETRY_PERIOD / 10)
            tidied.append(True)
    assert tidied


def test_what_a_library_makes_of_an_interrupt_is_one():
    with pytest.raises(KeyboardInterrupt), interruptible():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(20 * RETRY_PERIOD)
        except KeyboardInterrupt:
            raise SystemError("returned a result with an exception set")  # noqa: B904 (as CasADi does)
    with pytest.raises(KeyboardInterrupt), interruptible():
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(20 * RETRY_PERIOD)
        raise NotImplementedError("Wrong number or type of arguments")  # as CasADi does, which has dropped the interrupt
    with pytest.raises(SystemError), interruptible():
        raise SystemError("another one")


def test_a_request_to_end_is_told_from_ctrl_c():
    before = signal.getsignal(signal.SIGTERM)
    for number, kind in ((signal.SIGTERM, Terminated), (signal.SIGINT, KeyboardInterrupt)):
        with pytest.raises(KeyboardInterrupt) as found, interruptible():
            os.kill(os.getpid(), number)
            time.sleep(20 * RETRY_PERIOD)
        assert found.type is kind
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.fixture
def interrupts():
    """Handle SIGINT as in a terminal. If tests run in the background, it is ignored from the start."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interrupts")
def test_an_interrupt_while_processes_start_is_kept():
    """These processes start with the signal blocked. A signal that arrives meanwhile takes effect once they have started."""
    with pytest.raises(KeyboardInterrupt):
        with deaf_children():
            os.kill(os.getpid(), signal.SIGINT)
            started = True
        time.sleep(10.0)  # another thread may receive the signal, which takes a moment
        pytest.fail("the interrupt was lost")
    assert started and signal.getsignal(signal.SIGINT) == signal.default_int_handler
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.usefixtures("interrupts")
def test_an_interrupt_within_a_library_that_would_report_it_waits():
    """SciPy's Fortran prints an exception from its callback to the terminal."""
    for _ in range(3):
        said = []
        with pytest.raises(KeyboardInterrupt), interruptible():
            with undisturbed():
                os.kill(os.getpid(), signal.SIGINT)
                for k in range(1000):
                    said.append(k)
            said.append("raised too late")
        assert said == list(range(1000))
    assert signal.getsignal(signal.SIGINT) == signal.default_int_handler


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("after", [1.0, 1.5, 2.0, 2.5, 5.0])
@pytest.mark.short(kept=lambda after, number: (after, number) in ((2.5, signal.SIGINT), (2.5, signal.SIGTERM)))
def test_reproduce_stops_at_once_and_says_one_word(after, number, tmp_path):
    """Ctrl-C also reaches the workers, whereas a termination request reaches only this process. At first the workers start, later
    they measure."""
    started = subprocess.Popen(
        [sys.executable, "-m", "barbalat", "reproduce", "--out", str(tmp_path / "out")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    time.sleep(after)
    (os.killpg if number == signal.SIGINT else os.kill)(started.pid, number)
    try:
        out, said = started.communicate(
            timeout=60
        )  # after a lost interrupt the command would run for minutes; a busy machine is not a failure
    finally:
        if started.poll() is None:
            os.killpg(started.pid, signal.SIGKILL)
    if said:  # before the command has begun there is nothing to report
        word = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}[number]
        assert (out, said) == ("", f"{word}\n") or ("KeyboardInterrupt" in said and after < 2), said
        assert started.returncode == 128 + number or after < 2
    assert not (tmp_path / "out").exists()
    for _ in range(20):  # a process that has closed its files and is about to end
        if not (left := alive(started.pid)):
            break
        time.sleep(0.1)
    assert not left, f"a worker is left: {left}"


def alive(group: int) -> list[str]:
    """The command lines of all processes of a group that have not ended."""
    table = subprocess.run(["ps", "-eo", "pgid=,stat=,args="], capture_output=True, text=True, check=True).stdout
    rows = [line.split(maxsplit=2) for line in table.splitlines()]
    return [" ".join(command) for owner, state, *command in rows if int(owner) == group and not state.startswith("Z")]


def test_an_interrupt_within_an_exec_ends_with_its_code_too(tmp_path):
    """After an interrupt within an exec, such as that of a dataclass, Python ends itself by the signal even if it was caught."""
    (tmp_path / "within_an_exec.py").write_text(
        "import sys\n"
        "from barbalat import cli\n"
        "from barbalat.commands import cases\n"
        "def execute(options): exec('raise KeyboardInterrupt')\n"
        "cases.execute = execute\n"
        "sys.exit(cli.main(['cases']))\n"
    )
    done = subprocess.run([sys.executable, "-m", "within_an_exec"], check=False, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


def test_ctrl_c_while_the_command_line_is_loaded(monkeypatch, capsys):
    class Loading:
        @property
        def main(self):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "barbalat.cli", Loading())
    assert start() == 130
    assert capsys.readouterr().err == "interrupted\n"
