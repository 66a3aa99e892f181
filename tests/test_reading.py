"""Files that a user names: devices, pipes without an end, files that are too large, MATLAB files that unpack to far more."""

import os
import re
import struct
import sys
import threading
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from barbalat import InputError, load_case, reading
from barbalat.budget import Estimate
from barbalat.cases import user_controllers
from barbalat.cases.load import CaseText
from barbalat.reading import contents
from barbalat.signals import Recorded, recorded
from barbalat.studies import Budget

BYTE = Estimate(memory=2.0, seconds=1e-9)
READERS = {
    "case": load_case,
    "csv": Recorded.from_csv,
    "mat": Recorded.from_mat,
    "controllers": user_controllers.run,
}
needs_devices = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no such files on this system")


@needs_devices
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null"])
def test_a_device_is_no_file(reader, device):
    with pytest.raises(InputError, match=r"is a device, not a file|is not a file"):
        READERS[reader](device)


def test_a_file_as_large_as_the_budget_is_read_and_a_larger_one_is_not(tmp_path, monkeypatch):
    file = tmp_path / "data"
    file.write_bytes(b"x" * 101)
    with Budget(memory=202.0):
        assert contents(file, "the file", BYTE) == b"x" * 101
    monkeypatch.setattr(Path, "open", lambda *_: pytest.fail("it was opened"))
    with Budget(memory=201.0), pytest.raises(InputError) as refused:
        contents(file, "the file", BYTE)
    assert re.search(r"data' has 101 bytes and would take .*: at most 100 bytes would do; --budget", str(refused.value))
    with Budget(seconds=1.005e-7), pytest.raises(InputError, match="at most 100 bytes"):
        contents(file, "the file", BYTE)


def test_a_budget_beyond_any_memory_asks_for_no_more_than_the_file_has(tmp_path):
    file = tmp_path / "data"
    file.write_bytes(b"x" * 325)
    with Budget(memory=1e19, seconds=1e9):
        assert contents(file, "the file", BYTE) == b"x" * 325


@needs_devices
@pytest.mark.parametrize("endless", [False, True])
def test_a_pipe_is_read_up_to_what_the_budget_allows(tmp_path, endless):
    """An endless writer is disconnected, and the bytes that it wrote are counted."""
    pipe, written = tmp_path / "pipe", []
    os.mkfifo(pipe)

    def write() -> None:
        with pipe.open("wb", buffering=0) as file:
            try:
                while endless or not written:
                    written.append(file.write(b"name = 1\n" * 1000))
            except BrokenPipeError:
                return

    writer = threading.Thread(target=write)
    writer.start()
    with Budget(memory=200_000.0):
        if endless:
            with pytest.raises(InputError, match=r"has more than 100000 bytes and would take .*: at most 100000 bytes would do"):
                contents(pipe, "the file", BYTE)
        else:
            assert contents(pipe, "the file", BYTE) == b"name = 1\n" * 1000
    writer.join()
    assert sum(written) < 400_000  # the buffers of the pipe and of Python are in addition to what was read


@needs_devices
def test_a_case_may_come_from_a_pipe(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    text = CaseText.read("paper").text
    writer = threading.Thread(target=pipe.write_text, args=(text,))
    writer.start()
    assert load_case(pipe).name == load_case("paper").name
    writer.join()


@needs_devices
@pytest.mark.parametrize("given", [b"", b"name"])
def test_who_waits_for_a_pipe_is_told(tmp_path, monkeypatch, given):
    """The writer waits until the sentence is printed, so the test waits no longer than necessary."""
    pipe, told, said = tmp_path / "pipe", [], threading.Event()
    os.mkfifo(pipe)
    monkeypatch.setattr(reading, "WAITED_SECONDS", 0.05)

    def tell(sentence: str) -> None:
        told.append(sentence)
        said.set()

    def write() -> None:
        if not given:
            said.wait(60)
        with pipe.open("wb", 0) as file:
            file.write(given)
            said.wait(60)
            file.write(b" = 1")

    writer = threading.Thread(target=write)
    writer.start()
    with Budget(told=tell):
        assert contents(pipe, "the file", BYTE) == given + b" = 1"
    writer.join()
    here = "4 bytes of it received" if given else "nothing received yet"
    assert told == [f"waiting for the file {str(pipe)!r}: {here}; Ctrl-C ends the wait"]


def test_nothing_is_said_of_a_file_that_was_read(tmp_path, monkeypatch):
    file, calls = tmp_path / "data", []
    file.write_bytes(b"x")
    monkeypatch.setattr(threading.Timer, "start", lambda *_: calls.append("start"))
    monkeypatch.setattr(threading.Timer, "cancel", lambda *_: calls.append("cancel"))
    with Budget(told=pytest.fail):
        assert contents(file, "the file", BYTE) == b"x"
    assert calls == ["start", "cancel"]


@needs_devices
def test_a_tilde_in_a_case_file_is_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "own.csv").write_text("0,1\n1,2\n")
    text = CaseText.read("first-order").text
    (tmp_path / "case.toml").write_text(
        re.sub(r"(?ms)^\[reference\]\n.*?^(?=\[)", '[reference]\nkind = "csv"\nfile = "~/own.csv"\n', text)
    )
    assert load_case("~/case.toml").problem.reference(np.array([1.0])) == 2.0


@pytest.mark.parametrize("reader", READERS)
def test_every_reader_asks_the_budget(reader, tmp_path):
    file = tmp_path / "large.py"
    file.write_bytes(b"#" * 10_000)
    with (
        Budget(memory=10_000.0),
        pytest.raises(InputError, match=r"large\.py' has 10000 bytes and would take .* at most \d+ bytes"),
    ):
        READERS[reader](str(file))


def test_a_file_of_controllers_is_not_run_before_it_is_measured(tmp_path):
    file = tmp_path / "own.py"
    file.write_text("raise SystemExit('it was run')\n" + "#" * 1000)
    with Budget(memory=1000.0), pytest.raises(InputError, match="bytes would do"):
        user_controllers.run(file)


def test_a_packed_matlab_file_is_measured_unpacked(tmp_path):
    file = tmp_path / "packed.mat"
    t = np.arange(200_000.0)
    savemat(file, {"t": t, "r": 0 * t}, do_compression=True)
    large = 2 * t.nbytes
    assert file.stat().st_size < large / 4
    inside = recorded._unpacked(file.read_bytes())
    assert large < inside < large + 1000  # tags and names beside the numbers
    assert (Recorded.from_mat(file).times == t).all()
    with (
        Budget(memory=recorded.FILE_BYTE.memory * large),
        pytest.raises(InputError, match=rf"holds {inside} bytes when unpacked, and"),
    ):
        Recorded.from_mat(file)


def test_an_unpacked_matlab_file_is_measured_as_it_is(tmp_path):
    file = tmp_path / "plain.mat"
    savemat(file, {"t": np.arange(1000.0), "r": np.ones(1000)})
    assert 16_000 < recorded._unpacked(file.read_bytes()) < file.stat().st_size


def test_a_matlab_file_that_only_says_that_it_is_large_is_refused(tmp_path):
    """The file announces a text of 2^40 blanks and contains none."""

    def tagged(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    flags, shape = tagged(6, struct.pack("<II", 4, 0)), tagged(5, struct.pack("<ii", 2**20, 2**20))
    array = tagged(14, flags + shape + tagged(1, b"t") + struct.pack("<II", 16, 0))
    file = tmp_path / "blank.mat"
    for packed in (array, struct.pack("<II", 15, len(zlib.compress(array))) + zlib.compress(array)):
        file.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM" + packed)
        with pytest.raises(InputError, match="holds 8796093022208 bytes when unpacked"):
            Recorded.from_mat(file)


@pytest.mark.parametrize("cut", [130, 140, 200])
def test_a_matlab_file_that_is_cut_short_is_no_matlab_file(tmp_path, cut):
    file = tmp_path / "cut.mat"
    savemat(file, {"t": np.arange(1000.0), "r": np.ones(1000)}, do_compression=True)
    file.write_bytes(file.read_bytes()[:cut])
    with pytest.raises(InputError, match=r"cannot be read: it is not a MATLAB file|has no variable"):
        Recorded.from_mat(file)


@pytest.mark.skipif(sys.platform == "win32", reason="no such file there")
def test_a_file_that_does_not_know_its_size_is_read():
    """Files that the system generates while they are read report a size of zero."""
    file = Path("/proc/self/status")
    if file.exists():
        assert file.stat().st_size == 0
        assert b"Name:" in contents(file, "the file", BYTE)
