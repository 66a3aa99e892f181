"""Chunks on a cluster: bit-identical results on any processor, workers that die, and a scheduler that is missing or
disappears."""

from __future__ import annotations

import contextlib
import os
import pickle
import shutil
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

import barbalat
from barbalat.cases.load import CaseText
from barbalat.cli import main
from barbalat.open_numbers.varied import VariedCase
from barbalat.sweeps import cluster
from barbalat.sweeps.cluster import SOURCES, Scheduler, Tabulated, WorkerTask, digest_of, figures, versions
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.settling import Settling
from barbalat.sweeps.study import Study
from independent import refusal

ANOTHER_PROCESSOR = {"OPENBLAS_CORETYPE": "Prescott", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX2_Usable"}
"""Settings with which LAPACK and the C library compute as they would on a processor of 2004."""
NOISY = "\n[sensor]\nnoise = { std = 0.01, sample_time = 0.01 }\n[simulation]"


def study(members: int = 40, t_end: float = 0.5, noise: bool = False) -> Study:
    text = CaseText.read("paper").text.replace("t_end = 60.0", f"t_end = {t_end}").replace("dt = 1e-4", "dt = 1e-3")
    text = CaseText(text.replace("\n[simulation]", NOISY) if noise else text)
    plan = Plan({}, sampled(text, [("plant.theta", "known-set"), ("controller[1].filter.kappa", "uniform:0.01:0.03")]), members)
    return Study(VariedCase(text, plan.paths), plan)


def same(one, other):
    assert set(one) == set(other)
    assert not [name for name in one if one[name].tobytes() != other[name].tobytes()]


def work_of(given):
    """The work of a chunk of its members."""
    settling = Settling(given)
    return lambda chunk: settling.work(np.arange(chunk.first, chunk.first + chunk.size))


WORKER = """
import pickle, sys
from barbalat.sweeps.cluster import figures
sent, tables = pickle.load(sys.stdin.buffer)
sys.stdout.buffer.write(pickle.dumps(figures(sent, tables)))
"""


@pytest.mark.parametrize("noise", [False, True])
def test_a_worker_on_another_processor_gives_the_clients_bits(noise):
    here = study(noise=noise)
    parts = list(here.parts(0, 40))
    found = []
    for part in parts:
        given = pickle.dumps((WorkerTask.of(part), Tabulated.of(part)))
        environment = os.environ | ANOTHER_PROCESSOR
        done = subprocess.run([sys.executable, "-c", WORKER], input=given, capture_output=True, env=environment, check=True)
        found.append(pickle.loads(done.stdout))
    same(here.columns(0, 40, parts, found), study(noise=noise).run(0, 40))


def test_a_worker_that_would_make_other_bits_refuses():
    (part,) = study().parts(0, 4)
    sent, tables = WorkerTask.of(part), Tabulated.of(part)
    assert len(figures(sent, tables)) == 3
    other = replace(sent, made_by=sent.made_by | {"numpy": "1.0"})
    assert "a worker's versions differ from the client's: numpy" in refusal(lambda: figures(other, tables))
    changed = replace(sent, made_by=sent.made_by | {SOURCES: "0123456789abcdef"})
    assert f"versions differ from the client's: {SOURCES} {versions()[SOURCES]}, not 0123" in refusal(
        lambda: figures(changed, tables)
    )


def test_a_worker_whose_sources_differ_refuses(tmp_path):
    """The worker has a copy of the package with a factor of 2 in the metrics, as on another machine. Its version number is the
    same."""
    (part,) = study().parts(0, 4)
    given = pickle.dumps((WorkerTask.of(part), Tabulated.of(part)))
    copy = tmp_path / "barbalat"
    shutil.copytree(Path(barbalat.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", WORKER]
    done = subprocess.run(command, input=given, capture_output=True, env=environment, check=True)
    assert len(pickle.loads(done.stdout)) == 3  # equal parts may be at different addresses
    metrics = copy / "run" / "kernel" / "metrics.py"
    changed = metrics.read_text().replace("max_abs_e=finite_only(", "max_abs_e=2 * finite_only(")
    assert changed != metrics.read_text()
    metrics.write_text(changed)
    done = subprocess.run(command, input=given, capture_output=True, env=environment, check=False)
    assert done.returncode and "versions differ from the client's: barbalat's sources" in done.stderr.decode()


def test_sources_are_the_same_whatever_the_ends_of_their_lines(tmp_path):
    for name, content in (("unix", b"a = 1\nb = 2\n"), ("windows", b"a = 1\r\nb = 2\r\n"), ("other", b"a = 1\nb = 3\n")):
        (tmp_path / name / "room").mkdir(parents=True)
        (tmp_path / name / "room" / "file.py").write_bytes(content)
    unix, windows, other = (digest_of(tmp_path / name) for name in ("unix", "windows", "other"))
    assert unix == windows != other


@pytest.mark.parametrize("address", ["localhost:8786", "tcp://host", "http://h:1", "local:", "local:-1", ""])
def test_addresses_that_are_none(address):
    assert "--scheduler must be tcp://HOST:PORT" in refusal(lambda: Scheduler.parse(address))


def test_a_scheduler_that_does_not_answer(monkeypatch, capsys):
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "ANSWER_SECONDS", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        sweep = ["sweep", "first-order", "--vary", "controller[0].gamma=1:2:2", "--no-bounds", "--scheduler", address]
        assert main(sweep) == 2
    assert "does not answer within 0.3 s" in capsys.readouterr().err


def test_a_web_server_is_no_scheduler(capsys):
    """Dask reads the first eight bytes of its response as a length of 3 EB."""
    pytest.importorskip("distributed")
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
                connection.recv(4096)

        Thread(target=answer, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        sweep = ["sweep", "first-order", "--vary", "controller[0].gamma=1:2:2", "--no-bounds", "--scheduler", address]
        assert main(sweep) == 2
    found = capsys.readouterr().err
    assert "does not answer" in found and "Traceback" not in found


@pytest.mark.full
def test_workers_that_join_and_die_and_a_scheduler_that_goes(tmp_path):
    distributed = pytest.importorskip("distributed")
    processes = []

    def start(*command: str, **environment: str) -> subprocess.Popen[bytes]:
        arguments = [sys.executable, "-m", "distributed.cli." + command[0], *command[1:], "--no-dashboard"]
        found = subprocess.Popen(arguments, env=os.environ | environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        processes.append(found)
        return found

    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    port = address.rsplit(":", 1)[1]
    try:
        scheduler = start("dask_scheduler", "--host", "127.0.0.1", "--port", port)
        workers = [start("dask_worker", address, "--no-nanny", "--nthreads", "1", **ANOTHER_PROCESSOR) for _ in range(2)]
        while True:
            with contextlib.suppress(ConnectionRefusedError), socket.create_connection(("127.0.0.1", int(port)), timeout=60):
                break
            assert scheduler.poll() is None
            time.sleep(0.2)
        with cluster.connected(Scheduler(address=address)) as client:
            client.wait_for_workers(2, timeout=60)
            here, given = study(400, t_end=20.0), cluster.Workers(work_of(study(400, t_end=20.0)), client)
            chunks = [cluster.Chunk(first, 40) for first in range(0, 400, 40)]
            found = {}
            for i, (chunk, columns) in enumerate(given.run(chunks)):
                found[chunk.first] = columns
                if i == 1:
                    workers[0].send_signal(signal.SIGKILL)
                    workers.append(start("dask_worker", address, "--no-nanny", "--nthreads", "1"))
            assert sorted(found) == list(range(0, 400, 40))
            together = {name: np.concatenate([found[first][name] for first in sorted(found)]) for name in found[0]}
            same(together, Settling(here).run(np.arange(400)))
            with pytest.raises(cluster.SchedulerLostError):
                for _ in cluster.Workers(work_of(study(400, t_end=20.0)), client).run(chunks):
                    scheduler.send_signal(signal.SIGKILL)
    finally:
        for process in processes:
            process.kill()
            process.wait()
    assert distributed.__version__


@pytest.mark.full
def test_a_worker_that_computes_other_bits_with_the_same_sources_is_found():
    pytest.importorskip("distributed")

    def double_the_errors():
        from barbalat.sweeps import cluster

        right = cluster.figured

        def wrong(*given):
            found = right(*given)
            return found._replace(metrics=replace(found.metrics, max_abs_e=2 * found.metrics.max_abs_e))

        cluster.figured = wrong

    chunks = [cluster.Chunk(0, 8), cluster.Chunk(8, 8)]
    with cluster.connected(Scheduler(workers=1)) as client:
        found = dict(cluster.Workers(work_of(study(16)), client).run(chunks))
        assert set(found) == set(chunks)
        client.run(double_the_errors)
        (worker,) = client.nthreads()
        message = refusal(lambda: list(cluster.Workers(work_of(study(16)), client).run(chunks)))
    assert message.startswith(
        f"the worker {worker} does not reproduce this computer's results bit for bit for the same 4 members"
    )


@pytest.mark.full
def test_leaving_a_local_cluster_waits_for_no_chunk():
    """Dask would wait for the worker, and once more at the end of the process."""
    pytest.importorskip("distributed")
    from distributed.deploy.spec import SpecCluster

    with cluster.connected(Scheduler(workers=1)) as client:
        (pid,) = client.run(os.getpid).values()
        given = client.submit(time.sleep, 600.0, pure=False)
        while not any(client.processing().values()):
            assert given.status == "pending"
            time.sleep(0.05)
        (local,) = (
            one for one in SpecCluster._instances if one.status.name == "running"
        )  # a closed one may not be collected yet
    assert not local.shutdown_on_close
    with contextlib.suppress(ProcessLookupError, FileNotFoundError):
        while True:  # gone, or dead and not yet waited for; Dask alone would leave it for ten minutes
            os.kill(pid, 0)
            if "State:\tZ" in Path(f"/proc/{pid}/status").read_text():
                break
            time.sleep(0.05)


@pytest.mark.full
def test_an_interrupt_ends_a_local_cluster_within_two_seconds(tmp_path):
    pytest.importorskip("distributed")
    sweep = [sys.executable, "-m", "barbalat", "sweep", "paper", "--sample", "plant.theta=known-set", "--members", "4000"]
    process = subprocess.Popen(
        [*sweep, "--no-bounds", "--scheduler", "local:2", "--store", str(tmp_path / "s")], stderr=subprocess.PIPE, text=True
    )
    while not list(tmp_path.glob("s/members-*")) and process.poll() is None:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 130 and "run the same command again to continue" in said
