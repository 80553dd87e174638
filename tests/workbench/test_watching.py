"""What watching a service is made of: the rows, the twin, the drive that goes on, and what is kept."""

from pathlib import Path
from threading import Lock

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="the extra workbench is not installed")


from cruise.can.frame import Frame
from cruise.can.log import read_log
from cruise.service.course import Drive, FieldRow, OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.settings import CruiseSettings
from cruise.workbench.live import KEPT_S, Live, Row, Twin, again_and_again, worse_since


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
