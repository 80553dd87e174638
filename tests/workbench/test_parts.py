"""The parts of the workbench that need no browser."""

import asyncio
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the extra workbench is not installed")

from nicegui.elements.upload_files import SmallFileUpload

from cruise.service.recordings import ReadingSettings, read_recording
from cruise.validation.side_by_side import side_by_side
from cruise.workbench import jobs
from cruise.workbench.downsample import extremes, window
from cruise.workbench.examples import EXAMPLES, drive, make
from cruise.workbench.found import Cells
from cruise.workbench.uploads import apart, kept, plain
from tests.validation.test_side_by_side import runs

ROOT = Path(__file__).parents[2]


def test_downsampling_keeps_every_extreme():
    rng = np.random.default_rng(3)
    time_s = np.arange(72_000) * 0.05
    values = rng.normal(size=72_000)
    values[[17, 40_003, 71_999]] = 50.0, -60.0, 70.0
    x, y = extremes(time_s, values, 1000)
    assert len(y) <= 2100
    assert {50.0, -60.0, 70.0} <= set(y)
    assert np.all(np.diff(x) > 0.0)
    buckets = values[:72_000].reshape(1000, 72)
    assert set(buckets.max(axis=1)) <= set(y)
    assert set(buckets.min(axis=1)) <= set(y)


def test_downsampling_keeps_holes_and_short_curves():
    time_s = np.arange(10_000.0)
    values = np.sin(time_s / 300.0)
    values[5_003] = np.nan
    x, y = extremes(time_s, values, 100)
    assert np.isnan(y).sum() == 1
    assert x[np.isnan(y)] == 5_003.0
    short, same = extremes(time_s[:50], values[:50], 100)
    assert len(short) == len(same) == 50


def test_a_window_holds_what_it_touches():
    time_s = np.arange(0.0, 10.0, 1.0)
    assert time_s[window(time_s, 2.5, 4.5)].tolist() == [2.0, 3.0, 4.0, 5.0]


def test_an_example_is_driven_once_and_the_same_every_time(tmp_path):
    example = EXAMPLES[0]
    path = make(example, tmp_path)
    written = path.stat().st_mtime_ns
    assert make(example, tmp_path).stat().st_mtime_ns == written
    first, again = drive(example), drive(example)
    np.testing.assert_array_equal(first.output, again.output)
    assert abs(np.nanmax(first.columns["pitch_deg"])) > 4.0


def test_two_may_make_the_same_example_at_once(tmp_path):
    example = replace(EXAMPLES[0], seconds=60.0)
    with ThreadPoolExecutor(2) as both:
        paths = [one.result() for one in [both.submit(make, example, tmp_path) for _ in range(2)]]
    assert paths[0] == paths[1]
    assert len(read_recording(paths[0], ReadingSettings())) == 1200
    assert list(paths[0].parent.iterdir()) == [paths[0]]


def shouting(times: int, show: jobs.Any) -> int:
    for k in range(times):
        show(f"word {k}", k)
    return times


def sleeping(show: jobs.Any) -> None:
    show("asleep")
    time.sleep(600.0)


def refusing(show: jobs.Any) -> None:
    raise ValueError("not like this")


def politeness(show: jobs.Any) -> int:
    return os.nice(0)


def sharing(show: jobs.Any) -> int:
    return len(set(side_by_side(lambda _: os.getpid(), range(4))) - {os.getpid()})


def asleep(_: int) -> None:
    sys.stdout.write(f"{os.getpid()}\n")
    sys.stdout.flush()
    time.sleep(600.0)


def sleeping_side_by_side(show: jobs.Any) -> None:
    show(str(os.getpid()))
    list(side_by_side(asleep, range(2)))


def breaking(show: jobs.Any) -> None:
    raise ZeroDivisionError


def ended(job: jobs.Job) -> jobs.Job:
    until = time.monotonic() + 60.0
    while job.running and time.monotonic() < until:
        job.poll()
        time.sleep(0.01)
    return job


def test_a_job_says_what_it_does_and_hands_over_what_is_there():
    job = ended(jobs.Job("", shouting, (3,), ()))
    assert job.told == ["word 0", "word 1", "word 2"]
    assert (job.part, job.result, job.fault) == (2, 3, "")


def test_a_job_is_stopped_at_once():
    job = jobs.Job("", sleeping, (), ())
    until = time.monotonic() + 60.0
    while not job.told and time.monotonic() < until:
        job.poll()
        time.sleep(0.01)
    begin = time.monotonic()
    job.cancel()
    assert time.monotonic() - begin < 5.0
    assert not job.running
    assert job.result is None


def test_the_page_comes_before_a_job():
    mine = os.nice(0)
    assert ended(jobs.Job("", politeness, (), ())).result == min(mine + jobs.NICER, 19)
    assert os.nice(0) == mine


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two cores")
def test_a_job_works_on_all_cores():
    assert ended(jobs.Job("", sharing, (), ())).result >= 1


SERVER = """
import sys, time
from cruise.workbench import jobs
from tests.workbench.test_parts import sleeping_side_by_side
job = jobs.Job("", sleeping_side_by_side, (), ())
while not job.told:
    job.poll()
    time.sleep(0.01)
print(job.told[0], flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("killed", [False, True])
def test_a_job_ends_with_the_server_however_that_ends(killed):
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert server.stdin is not None
    assert server.stdout is not None
    pids = [int(server.stdout.readline()) for _ in range(1 + min(len(os.sched_getaffinity(0)), 2))]
    if killed:
        server.kill()
    server.stdin.close()
    server.wait(30.0)
    server.stdout.close()
    until = time.monotonic() + 10.0
    while any(runs(pid) for pid in pids) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(runs(pid) for pid in pids)


def test_mistakes_of_the_user_are_said_and_bugs_are_shown():
    assert ended(jobs.Job("", refusing, (), (ValueError,))).fault == "not like this"
    assert "ZeroDivisionError" in ended(jobs.Job("", breaking, (), (ValueError,))).fault


@pytest.mark.parametrize(
    ("name", "bare"),
    [
        ("../../etc/passwd.csv", "passwd.csv"),
        ("C:\\temp\\drive one.csv", "drive one.csv"),
        ("Fahrt über Bö\u0308den (2).csv", "Fahrt über Bö\u0308den (2).csv"),
        ("a:b\n|c?.csv", "a_b__c_.csv"),
        ("..", "recording"),
        (".hidden.csv", "hidden.csv"),
        ("/", "recording"),
    ],
)
def test_an_upload_never_leaves_its_folder(name, bare):
    assert plain(name) == bare
    assert "/" not in plain(name)


def test_a_long_name_keeps_its_ending_and_fits_a_file_system():
    name = plain("ü" * 300 + ".csv")
    assert name.endswith("ü.csv")
    assert len(name.encode()) < 255


def test_files_that_are_sent_together_stay_apart():
    assert apart(["a.csv", "b.csv"]) == ["a.csv", "b.csv"]
    assert apart(["__.csv", "__.csv", "2-__.csv", "__.csv"]) == ["__.csv", "2-__.csv", "2-2-__.csv", "3-__.csv"]


def test_an_upload_leaves_an_earlier_one_of_the_same_name_as_it_is(tmp_path):
    paths = []
    for text in (b"first", b"second"):
        file = SmallFileUpload("drive.csv", "text/csv", text)
        with ThreadPoolExecutor(1) as aside:
            paths += aside.submit(lambda file=file: asyncio.run(kept([file], tmp_path))).result()
    assert [path.read_bytes() for path in paths] == [b"first", b"second"]
    assert [path.name for path in paths] == ["drive.csv", "drive.csv"]


def cells(quantity: tuple[str, str], labels: tuple[str, ...]) -> Cells:
    """A map of one row that is sorted by nothing."""
    none = np.zeros((1, len(labels)))
    return Cells(("change of current", ""), ("rising",), quantity, labels, none, none, none, ())


@pytest.mark.parametrize(
    ("quantity", "label", "words"),
    [
        (("steering", ""), "-3 to -1", "steering -3 to -1"),
        (("steering", ""), "1 to 3", "steering 1 to 3"),
        (("steering", ""), "< -3", "steering < -3"),
        (("slope", "deg"), "-3 to -1", "slope -3 to -1 deg"),
        (("gear", ""), "gear -1", "gear -1"),
    ],
)
def test_a_cell_is_spoken_of_with_its_quantity(quantity, label, words):
    assert cells(quantity, (label,)).words(0, 0) == f"{words}, rising"
