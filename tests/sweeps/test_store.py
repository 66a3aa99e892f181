"""A store contains whole rows, resumes, and rejects foreign data. ./dev store-faults covers real faults."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from barbalat import InputError
from barbalat.cases.load import CaseText
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase
from barbalat.studies import sweep
from barbalat.sweeps import chunks, store
from barbalat.sweeps.chunks import FEWEST_MEMBERS, Chunk
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.settling import Settling
from barbalat.sweeps.spread import Axis, Uniform
from barbalat.sweeps.store import STORED_EVERY, Waiting, opened
from barbalat.sweeps.stored import INDEX_FILE, INDEX_KEY, StoredRows, read_index, row_of
from barbalat.sweeps.study import FINER_BY, RINGS, SETTLED, VERDICT, Study
from barbalat.sweeps.sweep import UNJUDGED, run_study

parquet = pytest.importorskip("pyarrow.parquet")
TEXT = CaseText.read("first-order").text
THETA = FieldPath.parse("plant.theta[0]")


def study(members=20, text=TEXT, **options):
    plan = Plan({}, {THETA: Uniform(-1.0, 1.0)}, members, **options)
    return Study(VariedCase(CaseText(text), plan.paths), plan)


def run(folder, prepared=None, **options):
    return run_study(prepared or study(), store=folder, chunk=6, bounds=False, audit=0, **options)


def test_a_store_is_one_table_and_goes_on(tmp_path):
    import pandas as pd

    folder = tmp_path / "deep" / "store"
    whole = run_study(study(), bounds=False, audit=0)
    found = run(folder)
    assert found.resumed == 0 and sorted(file.name for file in folder.iterdir()) == [
        INDEX_FILE, *(f"members-{first:012}.parquet" for first in (0, 6, 12, 18)),
    ]  # fmt: skip
    table = pd.read_parquet(folder).sort_values("member")
    assert table["member"].tolist() == list(range(20)) and list(table) == whole.rows.names
    for name in whole.rows.names:
        np.testing.assert_array_equal(table[name].to_numpy(dtype=float), whole.column(name).astype(float))
        np.testing.assert_array_equal(found.column(name), whole.column(name).astype(float))
    (folder / "members-000000000006.parquet").unlink()
    again = run(folder)
    assert again.resumed == 14 and again.as_json() | {"resumed": 0} == found.as_json()
    index = json.loads(parquet.read_schema(folder / INDEX_FILE).metadata[INDEX_KEY])
    assert index["members"] == 20 and {"barbalat", "numpy", "pyarrow"} <= index["versions"].keys()
    assert index["identity"]["case"] == TEXT and index["identity"]["plan"]["seed"] == 0


def test_a_stored_row_is_a_members_own(tmp_path):
    found = run(tmp_path / "store")
    row = found.rows.row(13)
    assert row == {name: pytest.approx(float(found.column(name)[13]), abs=0, nan_ok=True) for name in found.rows.names}


@pytest.mark.parametrize("place", ["rows", "truncated"])
def test_a_damaged_chunk_is_found_and_made_again(place, tmp_path):
    folder, told = tmp_path / "store", []
    expected = run(folder).as_json()
    file = folder / "members-000000000012.parquet"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content if place == "rows" else content[:100])
    again = run(folder, told=told.append)
    assert again.resumed == 14 and again.as_json() | {"resumed": 0} == expected
    assert told == ["damaged in the store and repeated: members-000000000012.parquet"]


@pytest.mark.parametrize(
    ("other", "what"),
    [
        (lambda: study(text=TEXT + "\n# a remark\n"), "a different case file"),
        (lambda: study(seed=1), "a different --vary, --sample"),
        (lambda: study(21), "a different --vary, --sample"),
    ],
)
def test_another_sweeps_store_is_refused_by_name(other, what, tmp_path):
    folder = tmp_path / "store"
    run(folder)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    with pytest.raises(InputError, match=f"was made with {what}"):
        run(folder, other())
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


@pytest.mark.parametrize("design", [Design.RANDOM, Design.SOBOL])
@pytest.mark.parametrize("interrupted", [False, True])
@pytest.mark.short(kept=lambda design, interrupted: interrupted == (design is Design.RANDOM))
def test_further_members_join_those_that_are_there(design, interrupted, tmp_path):
    """20 members are stored in chunks of 6. Of 33 members these 20 are present, and another file completes the short last
    chunk."""
    import pandas as pd

    folder = tmp_path / "store"
    run(folder, study(20, design=design))
    if interrupted:
        (folder / "members-000000000006.parquet").unlink()
    found, whole = run(folder, study(33, design=design)), run(tmp_path / "whole", study(33, design=design))
    assert found.resumed == (14 if interrupted else 20)
    assert found.as_json() | {"resumed": 0} == whole.as_json()
    parts = [int(one.name[8:20]) for one in sorted(folder.glob("members-*"))]
    assert parts == [0, 6, 12, 18, 20, 24, 30]
    pd.testing.assert_frame_equal(pd.read_parquet(folder), pd.read_parquet(tmp_path / "whole"))
    with pytest.raises(InputError, match="made with a different --vary, --sample, --members"):  # fewer members make another sweep
        run(folder, study(20, design=design))
    with pytest.raises(InputError, match="was made with a different --vary, --sample, --members"):
        run(folder, study(40, design=design, seed=1))


def test_other_equations_are_refused(tmp_path, monkeypatch):
    folder = tmp_path / "store"
    run(folder)
    monkeypatch.setattr(Study, "equations", lambda self: "0" * 64)
    with pytest.raises(InputError, match="was made with different equations"):
        run(folder)


def test_a_store_of_before_the_judge_is_read_and_gone_on_with(tmp_path):
    """The store has neither the judge's columns nor its version, but the equations of its runs are the same."""
    folder, prepared = tmp_path / "store", study(20, design=Design.RANDOM)
    identity = prepared.identity() | {"bounds": False}
    del identity["judge"]
    new = {f"{name}/{column}" for name in prepared.controllers for column in (VERDICT, SETTLED, RINGS, FINER_BY)}
    with opened(folder, identity, 20, 6) as old:
        for first in (0, 6):
            old.add(Chunk(first, 6), {name: one for name, one in prepared.run(first, 6).items() if name not in new})
    names = old.names
    for members in (20, 30):  # the missing members, then further ones
        found = run(folder, study(members, design=Design.RANDOM))
        assert found.resumed == (12 if members == 20 else 20) and UNJUDGED in found.evidence.notes
        assert found.rows.names == names and not new & set(names)
        assert found.evidence.shares.keys() == {"diverged", "oscillated"}
    whole = study(30, design=Design.RANDOM).run(0, 30)
    for name in names:
        np.testing.assert_array_equal(found.column(name), whole[name].astype(float))
    assert run(folder, study(30, design=Design.RANDOM)).resumed == 30
    again = run_study(study(30, design=Design.RANDOM), store=folder, bounds=False)
    assert len(again.audit.members) == 30 and again.audit.changed == 0


def test_the_verdicts_of_another_judge_are_refused(tmp_path, monkeypatch):
    run(tmp_path / "store")
    monkeypatch.setattr(Study, "judge", lambda self: "0" * 64)
    with pytest.raises(InputError, match="was made with the verdicts of a different judge"):
        run(tmp_path / "store")


def test_equations_are_told_apart():
    plan = Plan({}, {THETA: Uniform(-1.0, 1.0)}, 4)
    versions = {
        Study(VariedCase(CaseText(text), plan.paths), plan).equations()
        for text in (
            TEXT,
            TEXT,
            TEXT.replace("gamma = 2.0", "gamma = 2.5"),
            TEXT.replace("gamma = 2.0", "gamma = 2.0\nprojection = false"),
        )
    }
    assert len(versions) == 3


def test_a_damaged_row_is_not_compared_with(tmp_path):
    folder, prepared = tmp_path / "store", study()
    run(folder, prepared)
    assert row_of(folder, prepared.identity(), 13)["member"] == 13
    file = folder / "members-000000000012.parquet"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    with pytest.raises(InputError, match="is damaged or missing: run the same command without --member"):
        row_of(folder, prepared.identity(), 13)
    assert row_of(folder, prepared.identity(), 3)["member"] == 3


def test_rows_with_bounds_and_without_do_not_mix(tmp_path):
    run(tmp_path / "store")
    with pytest.raises(InputError, match="was made with the opposite choice of --no-bounds"):
        run_study(study(), store=tmp_path / "store", chunk=6)


def test_a_complete_store_is_read_beside_who_holds_it(tmp_path):
    """As on a read-only disk, nothing is written and no lock is taken."""
    from filelock import FileLock

    folder = tmp_path / "store"
    found = run(folder)
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    with FileLock(folder / ".lock", timeout=0):
        again = run(folder)
        (folder / "members-000000000012.parquet").unlink()
        with pytest.raises(InputError, match="is being written by another process"):
            run(folder)
    assert again.resumed == 20 and again.as_json() | {"resumed": 0} == found.as_json()
    assert {name: time for name, time in before.items() if "12." not in name}.items() <= {
        file.name: file.stat().st_mtime_ns for file in folder.iterdir()
    }.items()


def test_a_damaged_index_is_said(tmp_path):
    folder = tmp_path / "store"
    run(folder)
    (folder / INDEX_FILE).write_bytes(b"no Parquet")
    with pytest.raises(InputError, match=r"index of the store .* is damaged"):
        run(folder)


def test_a_flipped_bit_anywhere_in_the_index_changes_nothing_or_is_said(sample, tmp_path):
    """The same holds for the names of columns, although the text and its checksum do not contain them by themselves."""
    folder = tmp_path / "store"
    run(folder)
    file = folder / INDEX_FILE
    whole, known = file.read_bytes(), StoredRows(folder, read_index(folder))
    refused, places = 0, range(0, len(whole), sample(28, 7))
    for place in places:
        content = bytearray(whole)
        content[place] ^= 1
        file.write_bytes(content)
        try:
            index = read_index(folder)
        except InputError:
            refused += 1
        else:
            assert index == known.index and StoredRows(folder, index).names == known.names
    assert refused > len(places) / 2  # the rest is padding and data unrelated to rows
    at = whole.index(b"L1/rms_e")
    file.write_bytes(whole[:at] + b"M" + whole[at + 1 :])
    with pytest.raises(InputError, match=r"index of the store .* is damaged"):
        read_index(folder)


@pytest.mark.parametrize("given", ["s3://bucket/x", Path("gs://bucket/x")])
def test_a_url_is_no_folder(given, tmp_path, monkeypatch):
    """A URL is rejected before anything runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Study, "run", None)
    with pytest.raises(InputError, match="store must be a path on this computer, not a URL"):
        sweep("first-order", vary={"controller[0].gamma": "1:10:3"}, store=given)
    with pytest.raises(InputError, match="the store must be a path"), opened(Path(given), {}, 1, 1):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="names with a colon are drives or streams there")
@pytest.mark.parametrize(
    "given",
    ["s3:", "http:x", "run:2026-11-23", "gs:x", "file:x", "./s3:x", "./s3:/x", "hdfs:x", "a=1", "./~", "x/../y", "a b%20c"],
)
@pytest.mark.short(kept=lambda given: given in ("s3:", "./~", "x/../y", "a b%20c"))
def test_any_name_of_a_local_folder_will_do(given, tmp_path, monkeypatch):
    """Arrow interprets a word with a colon as a URL, a=1 as a column's value, and ~ as the home folder."""
    monkeypatch.chdir(tmp_path)
    options = {"vary": {"controller[0].gamma": "1:10:3"}, "store": given, "bounds": False, "audit": 0}
    found = sweep("first-order", **options)
    again = sweep("first-order", **options)
    assert again.resumed == 3 and again.as_json() | {"resumed": 0} == found.as_json()
    assert (tmp_path / given / INDEX_FILE).is_file()
    index = read_index(tmp_path / given)
    assert row_of(tmp_path / given, index.identity, 2).keys() == set(found.rows.names)


def test_a_tilde_is_the_home_folder(tmp_path, monkeypatch):
    (tmp_path / "home").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    sweep("first-order", vary={"controller[0].gamma": "1:10:2"}, store="~/x", bounds=False, audit=0)
    assert (tmp_path / "home" / "x" / INDEX_FILE).is_file() and [one.name for one in tmp_path.iterdir()] == ["home"]


@pytest.mark.skipif(sys.platform == "win32", reason="no such places there")
@pytest.mark.parametrize("given", ["/dev/null", "/dev/null/x", "/proc/x", "deep/file/x", "deep/" + 300 * "x"])
def test_a_place_that_holds_no_store_is_refused_before_anything_runs(given, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Study, "run", None)
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "file").touch()
    with pytest.raises(InputError, match=r"the store '.*' cannot be (written|read): "):
        sweep("first-order", vary={"controller[0].gamma": "1:10:3"}, store=given)
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["deep", "file"]


@pytest.mark.skipif(sys.platform == "win32", reason="its permissions are others")
def test_an_index_that_cannot_be_opened_is_not_called_damaged(tmp_path):
    (tmp_path / INDEX_FILE).mkdir()
    with pytest.raises(InputError, match=r"cannot be read: Is a directory"):
        read_index(tmp_path)


def test_folders_that_are_no_store(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"contains other files, such as 'notes.txt'"):
        run(tmp_path)
    with pytest.raises(InputError, match="is a file"):
        run(tmp_path / "notes.txt")
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_a_second_writer_is_refused(tmp_path):
    folder, prepared = tmp_path / "store", study()
    script = "import sys, filelock as f; lock = f.FileLock(sys.argv[1]); lock.acquire(); print(flush=True); sys.stdin.read()"
    folder.mkdir()
    arguments = [sys.executable, "-c", script, str(folder / ".lock")]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        with pytest.raises(InputError, match="is being written by another process"):
            run(folder, prepared)
        other.stdin.close()
        other.wait()
    assert run(folder, prepared).resumed == 0


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of resources")
def test_a_full_disk_keeps_what_is_stored(tmp_path, monkeypatch):
    """A limit on the size of files simulates the full disk. ./dev store-faults fills a tmpfs."""
    import resource

    folder, prepared = tmp_path / "store", study()
    with opened(folder, prepared.identity(), 20, 6) as store:
        store.add(store.chunks[0], prepared.run(*store.chunks[0]))
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python would leave half of a module's code for the next process
    given = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, given[1]))
    try:
        with pytest.raises(OSError, match="too large"):
            run(folder, prepared)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, given)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
    assert run(folder, prepared).resumed == 6


def test_what_interrupts_a_chunk_leaves_the_others(tmp_path, monkeypatch):
    folder, prepared, simulated = tmp_path / "store", study(), Settling.run

    def stopping(self, numbers, **options):
        if numbers[0] == 12:
            raise KeyboardInterrupt
        return simulated(self, numbers, **options)

    monkeypatch.setattr(Settling, "run", stopping)
    with pytest.raises(KeyboardInterrupt):
        run(folder, prepared)
    monkeypatch.undo()
    assert not (folder / ".writing").exists() and run(folder, prepared).resumed == 12


class Clock:
    """A clock for which each member takes a tenth of a second."""

    def __init__(self, monkeypatch, each=0.1):
        self.now, simulated = 0.0, Settling.run
        for module in (chunks, store):
            monkeypatch.setattr(module.time, "perf_counter", lambda: self.now)

        def running(prepared, numbers, **options):
            self.begins(numbers[0])
            self.now += each * len(numbers)
            return simulated(prepared, numbers, **options)

        monkeypatch.setattr(Settling, "run", running)

    def begins(self, first):
        pass


def slow(members=600):
    """One nominal chunk would take a minute."""
    return run_study, study(members, TEXT.replace("t_end = 60.0", "t_end = 0.6"))


def test_what_is_complete_is_stored_every_few_seconds(tmp_path, monkeypatch):
    """Whenever the writer is killed, it loses only a few seconds: the waiting members and those that are running."""
    folder, clock = tmp_path / "store", Clock(monkeypatch)
    lost = []

    def begins(first):
        index = read_index(folder) if folder.exists() else None
        stored = 0 if index is None else sum(file["count"] for file in index.files.values())
        lost.append(0.1 * (first - stored))

    clock.begins = begins
    whole, prepared = slow()
    found = whole(prepared, store=folder, bounds=False, audit=0)
    assert max(lost) <= STORED_EVERY + FEWEST_MEMBERS * 0.1  # and the unit that runs: a second, or the fewest members
    files = read_index(folder).files
    assert 600 * 0.1 / (STORED_EVERY + 3.2) <= len(files) <= 600 * 0.1 / STORED_EVERY + 2
    monkeypatch.undo()
    assert found.as_json() == whole(prepared, bounds=False, audit=0).as_json()


def test_parts_that_come_in_any_order_wait_for_each_other(tmp_path, monkeypatch):
    """As with a cluster, a chunk of 6 is written to one file once it is complete, and the remaining members at the end."""
    monkeypatch.setattr(store.time, "perf_counter", lambda: 0.0)
    with opened(tmp_path / "store", {}, 20, 6) as found:
        waiting = Waiting(found)
        files = []
        for first, size in ((4, 2), (8, 2), (0, 2), (6, 2), (2, 2), (18, 2), (10, 2), (14, 1)):
            waiting.add(Chunk(first, size), {"member": np.arange(first, first + size)})
            files.append(sorted((one["first"], one["count"]) for one in found.index.files.values()))
        waiting.put()
        assert files[3] == [] and files[4] == [(0, 6)] and files[5] == [(0, 6), (18, 2)] and files[6][1] == (6, 6)
        assert found.missing == [(12, 2), (15, 3)] and found.rows().column("member").tolist() == [*range(12), 14, 18, 19]


def test_a_store_of_many_files_is_written_less_often(tmp_path):
    with opened(tmp_path / "store", {}, 10, 10) as found:
        waiting = Waiting(found)
        pauses = []
        for files in (0, 1024, 1536, 4096):
            found.index.files.update({str(i): {} for i in range(files)})
            pauses.append(waiting.pause)
    assert pauses == [STORED_EVERY, STORED_EVERY, 2 * STORED_EVERY, 64 * STORED_EVERY]


def test_an_interrupt_stores_what_waits(tmp_path, monkeypatch):
    folder, clock = tmp_path / "store", Clock(monkeypatch, each=0.0)

    def begins(first):
        if first >= 100:
            raise KeyboardInterrupt

    clock.begins = begins
    whole, prepared = slow()
    with pytest.raises(KeyboardInterrupt):
        whole(prepared, store=folder, bounds=False, audit=0)
    monkeypatch.undo()
    again = whole(prepared, store=folder, bounds=False, audit=0)
    assert again.resumed == 32 + 256  # the first unit, and the next one
    assert again.as_json() | {"resumed": 0} == whole(prepared, bounds=False, audit=0).as_json()


def test_a_file_that_no_index_names_is_not_read_twice(tmp_path):
    """A writer was killed before it wrote the index, and the next writer divides the members differently."""
    import pandas as pd

    folder, prepared = tmp_path / "store", study()
    with opened(folder, prepared.identity() | {"bounds": False}, 20, 6) as found:
        found.add(Chunk(0, 6), prepared.run(0, 6))
        index = (folder / INDEX_FILE).read_bytes()
        found.add(Chunk(8, 4), prepared.run(8, 4))
    (folder / INDEX_FILE).write_bytes(index)
    run(folder, prepared)
    assert pd.read_parquet(folder)["member"].tolist() == list(range(20))


def test_what_is_missing_is_what_no_file_holds(tmp_path):
    columns = {"member": np.arange(4)}
    with opened(tmp_path / "store", {}, 20, 6) as found:
        found.add_all([(Chunk(4, 4), columns), (Chunk(14, 4), columns)])
        assert found.missing == [(0, 4), (8, 4), (12, 2), (18, 2)] and found.stored == 8


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_is_read_only(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written"):
        run(tmp_path / "store")


def test_python_says_what_the_command_says(tmp_path):
    gains = Axis(1.0, 10.0, 3, True)
    found = sweep(
        "first-order", vary={"controller[0].gamma": gains}, sample={"plant.theta[0]": "uniform:-1:1"}, members=4,
        require=["max_abs_e < 100"], store=tmp_path / "store",
    )  # fmt: skip
    assert len(found) == 12 and "12 members" in repr(found) and len(found.to_pandas()) == 12
    assert found.as_json()["shares"]["max_abs_e < 100"].keys() == set(found.controllers)
    assert found.plot().axes
