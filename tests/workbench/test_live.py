"""Watching a service: a listener on its bus, a machine that changes under way, and from there to a diagnosis."""

import math
import threading
import time
from pathlib import Path

import msgspec
import pytest
import yaml

pytest.importorskip("nicegui", reason="the extra workbench is not installed")

from cruise import settings as strict
from cruise.can.bus import open_bus
from cruise.can.codec import Codec
from cruise.cli.places import CONFIG
from cruise.plant import Combine, PlantSettings
from cruise.service import course, demo
from cruise.service import settings as service_settings
from cruise.service.combine_node import CombineNode
from cruise.service.course import Drive, FieldRow, OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.loop import Together, serve
from cruise.service.operator_node import OperatorNode
from cruise.workbench.live import Live, Row, watch_bus, worse_since
from tests.workbench.test_walk import go

CHANNEL = "watched"
PATIENCE_S = 180.0  # a machine that is busy with other things steers late, and the operator tries again
SEED = 1
CHANGE_S = 150.0


def on_the_virtual_bus(folder: Path) -> Path:
    """The settings of the service, on a bus within this process."""
    text = (CONFIG / "cruise.yaml").read_text()
    told = yaml.safe_load(text)
    told["can"] = (told.get("can") or {}) | {"bus": "virtual", "channel": CHANNEL}
    told |= {"database": str(CONFIG / "cruise.dbc"), "dictionary": str(CONFIG / "cruise.eds")}
    told["model"] = str(CONFIG / told["model"])
    path = folder / "cruise.yaml"
    path.write_text(yaml.safe_dump(told))
    return path


def test_a_listener_sees_what_a_running_service_does_and_says_nothing(tmp_path):
    """`cruise plant`, `cruise run` and the workbench on one bus, in real time; without SocketCAN as three threads."""
    config = on_the_virtual_bus(tmp_path)
    settings = service_settings.load(config)
    codec = Codec.load(settings.database, settings.can)
    drive = Drive(
        seconds=1e9,
        operator=(
            OperatorRow(at_s=0.5, cruise_enable=1.0),
            OperatorRow(at_s=1.0, over_s=3.0, lever_pct=55.0),
            *(OperatorRow(at_s=8.0 + 3.0 * k, press="set") for k in range(60)),
        ),
    )
    combine = Combine(strict.load(CONFIG / "plant.yaml", PlantSettings), SEED)
    machine = Together([CombineNode(combine, codec, drive.field, drive.operator), OperatorNode(codec, drive.operator)])
    service = CruiseNode.load(settings)
    going = threading.Event()
    going.set()

    def run(node) -> None:
        with open_bus(settings.can) as bus:
            serve(node, bus, going.is_set)

    live = Live()
    live.running = True
    threads = [threading.Thread(target=run, args=(node,)) for node in (machine, service)]
    threads.append(threading.Thread(target=watch_bus, args=(live, config, tmp_path / "live")))
    for thread in threads:
        thread.start()
    try:
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until and not any(row.engaged for row in list(live.rows)):
            time.sleep(0.2)
        time.sleep(2.0)
    finally:
        live.stop()
        going.clear()
        for thread in threads:
            thread.join(30)
    rows = list(live.rows)
    assert any(row.engaged for row in rows), "the service engaged, and the listener has not seen it"
    last = rows[-1]
    told = service.status(last.time_s)
    assert last.setpoint_mps == pytest.approx(told.setpoint_mps, abs=0.1)
    assert last.speed_mps == pytest.approx(told.speed_mps, abs=0.3)
    assert 0.5 < last.speed_mps < 3.0
    assert last.current_ma > 100.0
    assert live.taken(tmp_path / "taken").stat().st_size > 10_000


def test_a_machine_that_changes_makes_the_model_worse_and_the_time_is_told(tmp_path):
    settings = service_settings.load(CONFIG / "cruise.yaml")
    settings = msgspec.structs.replace(settings, model=str(CONFIG / settings.model))
    plant = strict.load(CONFIG / "plant.yaml", PlantSettings)
    usual = course.load(CONFIG / "demo.yaml")
    changed = Drive(
        seconds=CHANGE_S + 60.0,
        field=(usual.field[0], FieldRow(at_s=CHANGE_S, over_s=2.0, rolling_resistance=0.3, grade_deg=8.0)),
        operator=tuple(row for row in usual.operator if row.at_s < 70.0),
    )
    live = Live()
    live.begin("made up", tmp_path, settings)
    demo.run(settings, plant, changed, SEED, changed.seconds, show=lambda now_s, result: live.see(now_s, result.node))
    rows = list(live.rows)
    assert worse_since([row for row in rows if row.time_s < CHANGE_S]) is None
    since = worse_since([row for row in rows if row.time_s < CHANGE_S + 20.0])
    assert since is not None
    assert CHANGE_S < since < CHANGE_S + 15.0


def test_a_bus_on_which_nobody_speaks_is_no_good_model():
    live = Live()
    live.running = True
    live.rows.extend(Row(0.2 * k, math.nan, math.nan, math.nan, 0.0, math.nan, math.nan, math.nan) for k in range(50))
    words, bad = live.doing()
    assert words.startswith("Nothing is heard")
    assert bad
    live.rows.append(Row(10.2, math.nan, 1.0, 700.0, 0.0, math.nan, math.nan, math.nan))
    assert live.doing() == ("The model has not been judged yet.", False)


def test_from_watching_straight_into_a_diagnosis(visit):
    page = visit()
    go(page, "Live")
    page.get_by_role("button", name="Watch the combine").click()
    page.get_by_text("Watching the virtual combine").wait_for()
    page.get_by_text("The model is as good as usual.").wait_for()
    diagnose = page.get_by_role("button", name="Diagnose the last")
    diagnose.wait_for()
    page.wait_for_function("!document.querySelector('.q-btn[disabled]')?.innerText?.includes('Diagnose')")
    diagnose.click()
    page.locator(".chip").first.wait_for()  # read, compared, the search has begun
    page.locator("nav").get_by_text("the last 15 minutes").wait_for()
    page.get_by_role("button", name="Stop", exact=True).click()
    again = page.get_by_role("button", name="What is missing?")
    again.wait_for()
    again.evaluate("button => button.dataset.drawn = 'once'")
    page.wait_for_timeout(1000)
    assert again.get_attribute("data-drawn") == "once"  # a second drawing would lose what is pressed meanwhile
    go(page, "Live")
    page.get_by_role("button", name="Stop watching").click()
    page.get_by_role("button", name="Forget it").click()
    page.get_by_role("button", name="Watch the combine").wait_for()
