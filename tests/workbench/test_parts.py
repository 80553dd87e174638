"""The parts of the workbench that need no browser."""

import asyncio
import os
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from threading import Lock
from urllib.parse import quote

import numpy as np
import pyarrow as pa
import pytest
from asammdf import MDF, Signal
from pyarrow import parquet

pytest.importorskip("nicegui", reason="the extra workbench is not installed")

from nicegui import Client
from nicegui.elements.upload_files import SmallFileUpload
from nicegui.page import page

from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.can.log import LogWriter, read_log
from cruise.can.settings import CanSettings
from cruise.cli.places import CONFIG
from cruise.columns import ColumnSettings
from cruise.service.course import Drive, FieldRow, OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.recordings import ReadingSettings, read_recording
from cruise.service.recordings.names import names_in
from cruise.service.settings import CruiseSettings
from cruise.signals import INPUT, OUTPUT
from cruise.workbench import jobs
from cruise.workbench.downsample import extremes, window
from cruise.workbench.examples import EXAMPLES, drive, make
from cruise.workbench.found import Cells
from cruise.workbench.guard import Guard, cookie_of
from cruise.workbench.live import KEPT_S, Live, Row, Twin, again_and_again, worse_since
from cruise.workbench.uploads import apart, kept, plain
from cruise.workbench.views.mapping import AS_IT_IS, AS_SET, TIME, _choice, guessed, known, reading_of


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


def test_mistakes_of_the_user_are_said_and_bugs_are_shown():
    assert ended(jobs.Job("", refusing, (), (ValueError,))).fault == "not like this"
    assert "ZeroDivisionError" in ended(jobs.Job("", breaking, (), (ValueError,))).fault


@pytest.mark.parametrize(
    ("name", "bare"),
    [
        ("../../etc/passwd.csv", "passwd.csv"),
        ("C:\\temp\\drive one.csv", "drive_one.csv"),
        ("..", "recording"),
        (".hidden.csv", "hidden.csv"),
        ("/", "recording"),
    ],
)
def test_an_upload_never_leaves_its_folder(name, bare):
    assert plain(name) == bare
    assert "/" not in plain(name)


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


PORT = 8080


def asked(token: str, host: str, query: str = "", cookie: str = "", kind: str = "http", method="GET", length="0"):
    """What a request gets, and whether it came through."""
    sent, through = [], []

    async def app(scope, receive, send):
        through.append(scope)
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive():
        return {}

    async def send(message):
        sent.append(message)

    headers = [(b"host", host.encode()), (b"cookie", cookie.encode()), (b"content-length", length.encode())]
    scope = {"type": kind, "method": method, "headers": headers, "query_string": query.encode()}
    with ThreadPoolExecutor(1) as aside:  # a browser that other tests drive has its loop in this thread
        aside.submit(lambda: asyncio.run(Guard(app, token, PORT, 1000)(scope, receive, send))).result()
    return sent, bool(through)


MINE = cookie_of("secret", PORT)


def test_from_outside_only_the_token_opens():
    assert asked("secret", "10.0.0.7:8080")[0][0]["status"] == 401
    assert not asked("secret", "10.0.0.7:8080", "token=guess")[1]
    sent, through = asked("secret", "10.0.0.7:8080", "token=secret")
    assert through
    assert dict(sent[0]["headers"])[b"set-cookie"] == f"{MINE}; HttpOnly; SameSite=Strict; Path=/".encode()
    assert asked("secret", "10.0.0.7:8080", cookie=MINE)[1]
    assert not asked("secret", "10.0.0.7:8080", cookie=f"{MINE[:-1]}x", kind="websocket")[1]


@pytest.mark.parametrize("token", ["a+b/c=", "x&y", "schl\u00fcssel", "geheim wort", "a;b", 'a"b', "\u20ac1", "100%"])
def test_any_token_opens_by_the_address_and_by_the_cookie_after_it(token):
    sent, through = asked(token, "10.0.0.7:8080", f"token={quote(token, safe='')}")
    assert through
    cookie = dict(sent[0]["headers"])[b"set-cookie"].decode("ascii").partition("; HttpOnly")[0]
    assert asked(token, "10.0.0.7:8080", cookie=cookie)[1]


def test_cookies_of_other_programs_and_ports_are_in_nobodys_way():
    assert asked("secret", "10.0.0.7:8080", cookie=f'prefs={{"a":1}}; {MINE}; x')[1]
    assert not asked("secret", "10.0.0.7:8080", cookie=cookie_of("secret", PORT + 1))[1]


def test_on_this_machine_no_page_of_another_site_gets_in():
    assert asked("", "127.0.0.1:8080")[1]
    assert asked("", "[::1]:8080")[1]
    assert not asked("", "evil.example:8080")[1]
    assert asked("", "evil.example", kind="websocket")[0] == [{"type": "websocket.close", "code": 1008}]


@pytest.mark.parametrize(("length", "status"), [("1000", None), ("1001", 413), ("", 411), ("-1", 411)])
def test_more_than_the_page_takes_is_refused_before_it_is_read(length, status):
    sent, through = asked("", "127.0.0.1", method="POST", length=length)
    assert through == (status is None)
    assert status is None or sent[0]["status"] == status


def test_columns_are_guessed_and_meant():
    names = ["time_s", "pump_curent_ma", "v", "engine_speed_rpm"]
    found = guessed(names, ["time_s", "pump_current_ma", "ground_speed_mps", "engine_speed_rpm"])
    assert found == {"time_s": "time_s", "pump_curent_ma": "pump_current_ma", "engine_speed_rpm": "engine_speed_rpm"}
    meant = {
        "t": ("time_s", "ms"),
        "I": ("pump_current_ma", "A"),
        "v": ("ground_speed_mps", "km/h"),
        "n": ("engine_speed_rpm", "rpm"),
        "x": (AS_IT_IS, "-"),
    }
    reading = reading_of(ReadingSettings(), meant)
    assert (reading.time, reading.input, reading.output) == ("t", "I", "v")
    assert reading.columns["v"] == ColumnSettings(scale=1 / 3.6)
    assert reading.columns["n"] == ColumnSettings(signal="engine_speed_rpm")
    assert "x" not in reading.columns


def test_every_kind_of_file_says_how_its_columns_are_called(tmp_path):
    settings = ReadingSettings(database=str(CONFIG / "cruise.dbc"))
    numbers = np.arange(20.0)
    (tmp_path / "a.csv").write_text("t; I ;v\n0;1;2\n")
    parquet.write_table(pa.table({"t": numbers, "I": numbers}), tmp_path / "a.parquet")
    with MDF() as file:
        file.append([Signal(numbers, numbers, name="I")])
        file.append([Signal(numbers, numbers, name="v")])
        file.save(tmp_path / "a.mf4")
    codec = Codec.load(CONFIG / "cruise.dbc", CanSettings())
    frame = codec.encode("DriveFeedback", {INPUT: 700.0, OUTPUT: 2.0}, 5.0)
    with closing(LogWriter.create(tmp_path / "a.log")) as log:
        log.write(frame)
        log.write(Frame(timestamp=5.1, arbitration_id=0x18FEEE00, data=bytes(8)))
    assert names_in(tmp_path / "a.csv", settings) == ["t", "I", "v"]
    assert names_in(tmp_path / "a.parquet", settings) == ["t", "I"]
    assert names_in(tmp_path / "a.mf4", settings) == ["I", "v"]
    assert {INPUT, OUTPUT} <= set(names_in(tmp_path / "a.log", settings))
    assert names_in(tmp_path / "a.log", ReadingSettings()) == [], "nobody has said what the frames mean"


def test_what_was_said_of_columns_is_known_again():
    names, meanings = ["t", "I", "v", "engine_speed_rpm", "x"], [TIME, INPUT, OUTPUT, "engine_speed_rpm", "pitch_deg"]
    meant = {"t": (TIME, "ms"), "I": (INPUT, "A"), "v": (OUTPUT, "km/h"), "x": ("pitch_deg", "rad")}
    assert known(reading_of(ReadingSettings(), meant), names, meanings) == meant | {
        "engine_speed_rpm": ("engine_speed_rpm", "rpm")
    }


def test_what_the_settings_say_holds_on_where_nothing_else_is_said():
    usual = ReadingSettings(
        input="I",
        output="v",
        columns={
            "v": ColumnSettings(scale=0.277778),
            "I": ColumnSettings(scale=7.5),  # of no unit here
            "header": ColumnSettings(scale=0.1),
            "sp": ColumnSettings(signal="setpoint_mps", scale=0.277778),
            "slope": ColumnSettings(signal="pitch_deg", scale=2.0),
            "grade": ColumnSettings(signal="pitch_deg"),
        },
    )
    names, meanings = ["time_s", "I", "v", "header", "sp", "slope"], [TIME, INPUT, OUTPUT, "pitch_deg"]
    meant = known(usual, names, meanings)
    assert meant["v"] == (OUTPUT, "km/h")
    assert meant["slope"] == ("pitch_deg", AS_SET)
    asked = {name: meant.get(name, (AS_IT_IS, "-")) for name in names}
    again = reading_of(usual, asked).columns
    assert again["v"].scale == pytest.approx(0.277778, rel=1e-5)
    assert {name: again[name] for name in ("I", "header", "sp", "slope")} == {
        name: usual.columns[name] for name in ("I", "header", "sp", "slope")
    }
    assert "grade" not in again, "another column is the slope now"
    assert "slope" not in reading_of(usual, asked | {"slope": (AS_IT_IS, "-")}).columns, "it goes by its own name"


@pytest.mark.parametrize(
    ("name", "meaning", "unit"),
    [
        ("ground_speed_kmh", OUTPUT, "km/h"),
        ("Radar [km/h]", OUTPUT, "km/h"),
        ("wheel_speed_kmh", "wheel_speed_mps", "km/h"),
        ("pitch_rad", "pitch_deg", "rad"),
        ("oil_temperature_f", "oil_temperature_c", "degF"),
        ("line_pressure_psi", "line_pressure_bar", "psi"),
        ("machine_mass_t", "machine_mass_kg", "t"),
        ("engine_speed_rps", "engine_speed_rpm", "1/s"),
        ("pump_current_a", INPUT, "A"),
        ("pump_current_pct", INPUT, "%"),
        ("time_ms", TIME, "ms"),
        ("pitch_s", "pitch_deg", "deg"),  # no unit of a slope
    ],
)
def test_the_name_of_a_column_says_its_unit(name, meaning, unit):
    assert known(ReadingSettings(input="I", output="Radar [km/h]"), [name], [meaning]) == {name: (meaning, unit)}


@pytest.mark.parametrize("name", ["pump_pct", "I"])
def test_a_share_of_the_current_is_read_as_the_command_line_reads_it(name, tmp_path):
    """Its unit is known by its size, with a note, as long as nobody says another."""
    path = tmp_path / "share.csv"
    time_s = 0.1 * np.arange(200)
    share_pct = 50.0 + 50.0 * np.sin(time_s)
    table = np.column_stack([time_s, share_pct, 0.02 * share_pct])
    np.savetxt(path, table, delimiter=",", header=f"time_s,{name},ground_speed_mps", comments="")
    usual = ReadingSettings(input=name)
    meant = known(usual, ["time_s", name, OUTPUT], [TIME, INPUT, OUTPUT])
    reading = reading_of(usual, meant)
    assert reading == usual
    told = read_recording(path, reading)
    assert told.input.max() == pytest.approx(10.0 * share_pct.max())
    assert any("read as per cent" in note for note in told.notes)
    in_ma = read_recording(path, reading_of(usual, meant | {name: (INPUT, "mA")}))
    assert in_ma.input.max() == pytest.approx(share_pct.max())


def test_a_measurement_is_told_the_share_that_its_reader_does_not_look_for():
    meant = {"pump_pct": (INPUT, "%"), "v": (OUTPUT, "m/s")}
    assert reading_of(ReadingSettings(), meant).columns["pump_pct"] == ColumnSettings(scale=10.0)


def test_what_a_column_is_called_is_never_read_as_properties():
    name = 'speed "GPS" innerHTML="<img src=x>'
    with Client(page(""), request=None):
        meaning, unit = _choice(name, [TIME], TIME, "s")
    assert meaning.props["aria-label"] == f"meaning of {name}"
    assert unit.props["aria-label"] == f"unit of {name}"
    assert "innerHTML" not in meaning.props


def rows(errors: list[float]) -> list[Row]:
    return [Row(float(k), 1.0, 1.0, 500.0, 1.0, error, error, 0.3) for k, error in enumerate(errors)]


def test_a_model_that_has_become_worse_is_noticed_with_its_time():
    assert worse_since(rows([0.05] * 100)) is None
    assert worse_since(rows([0.05] * 100 + [0.2] * 20)) == 100.0
    assert worse_since(rows([0.05] * 50 + [0.2] * 10 + [0.05] * 50)) is None, "it has become good again"
    assert worse_since(rows([0.2] * 30)) is None, "nothing is usual yet"


def test_the_demo_drives_on_and_on():
    drive = Drive(
        seconds=100.0,
        field=(FieldRow(at_s=10.0, grade_deg=3.0),),
        operator=(OperatorRow(at_s=1.0, press="set"), OperatorRow(at_s=30.0, setpoint_mps=1.4)),
    )
    longer = again_and_again(drive, 3)
    assert longer.seconds == 300.0
    assert [row.at_s for row in longer.field] == [10.0, 110.0, 210.0]
    assert [row.at_s for row in longer.operator] == [1.0, 30.0, 130.0, 230.0]


def test_the_twin_listens_and_sends_nothing(tmp_path):
    class Service(CruiseNode):
        period_s = 0.05

        def __init__(self):
            self.ticks = 0

        def tick(self, now_s):
            self.ticks += 1
            return [Frame(timestamp=now_s, arbitration_id=1, data=b"forward")]

    service = Service()
    twin = Twin(service, tmp_path / "live.log", Lock())
    assert twin.tick(0.05) == []
    assert service.ticks == 1
    twin.writer.close()
    assert Path(tmp_path / "live.log").exists()


def test_a_watch_keeps_what_can_be_diagnosed_and_no_more_than_twice_as_much(tmp_path):
    class Deaf(CruiseNode):
        period_s = 10.0

        def __init__(self):
            pass

        def receive(self, frame):
            return []

        def tick(self, now_s):
            return []

    live = Live()
    log = live.begin("a bus", tmp_path / "live", CruiseSettings(model="", database=""))
    twin = Twin(Deaf(), log, live.turning)
    times_s = np.arange(1000.0, 1000.0 + 4.5 * KEPT_S, 10.0).tolist()
    for now_s in times_s:
        twin.receive(Frame(timestamp=now_s, arbitration_id=1, data=b"12"))
        twin.tick(now_s)
    twin.writer.flush()
    heard_s = np.array([frame.timestamp for frame in read_log(live.taken(tmp_path / "taken"))])
    assert heard_s[-1] == times_s[-1]
    assert np.all(np.diff(heard_s) == 10.0)
    assert KEPT_S <= heard_s[-1] - heard_s[0] <= 2.0 * KEPT_S
    assert len(list(log.parent.iterdir())) == 2
    twin.writer.close()
