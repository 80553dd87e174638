"""A CANopen panel on the same bus: its setpoint and switch count where the settings say so, NMT stop means neutral.

And a master, played by canopen's own client, that writes settings by SDO.
"""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import canopen
import msgspec
import pytest

from cruise.can.bus import open_bus
from cruise.can.codec import Codec
from cruise.can.frame import Frame
from cruise.cli.places import CONFIG
from cruise.control.engagement import ExitReason, State
from cruise.plant import Combine, PlantSettings
from cruise.service import settings as service_settings
from cruise.service.combine_node import CombineNode
from cruise.service.course import OperatorRow
from cruise.service.cruise_node import CruiseNode
from cruise.service.daemon import Daemon
from cruise.service.loop import Lockstep, Together
from cruise.service.notify import Notifier
from cruise.service.operator_node import OperatorNode
from cruise.service.persistence import PersistenceSettings
from cruise.service.settings import CruiseSettings
from cruise.service.station import Station

STOP_S = 30.0
ROWS = (
    OperatorRow(at_s=0.5, cruise_enable=1.0, setpoint_mps=1.9),  # the J1939 panel asks for another speed
    OperatorRow(at_s=2.0, over_s=4.0, lever_pct=55.0),
    OperatorRow(at_s=12.0, press="resume"),
)


class CanopenPanel:
    """Starts the node, then sends setpoint 1.2 m/s and switch on (RPDO 1 of node 17), and stops the node at STOP_S."""

    period_s = 0.1

    def __init__(self) -> None:
        self.heard: dict[int, list[tuple[float, bytes]]] = {}

    def receive(self, frame: Frame) -> None:
        if not frame.is_extended_id:
            self.heard.setdefault(frame.arbitration_id, []).append((frame.timestamp, bytes(frame.data)))

    def tick(self, now_s: float) -> list[Frame]:
        def frame(identifier: int, data: bytes) -> Frame:
            return Frame(now_s, identifier, is_extended_id=False, data=data)

        if abs(now_s - 1.0) < 0.05:
            return [frame(0x000, bytes([1, 17]))]
        if abs(now_s - STOP_S) < 0.05:
            return [frame(0x000, bytes([2, 17]))]
        return [frame(0x211, (1200).to_bytes(2, "little") + b"\x01")]


@pytest.fixture(scope="module")
def drive():
    settings = service_settings.load(CONFIG / "cruise.yaml")
    can = msgspec.structs.replace(settings.can, bus="virtual", channel="canopen")
    settings = msgspec.structs.replace(settings, can=can, setpoint_from="canopen")
    node, panel = CruiseNode.load(settings), CanopenPanel()
    combine = Combine(PlantSettings(), 3)
    machine = CombineNode(combine, Codec.load(settings.database, can), (), ROWS)
    operator = OperatorNode(Codec.load(settings.database, can), ROWS)
    buses = [open_bus(can) for _ in range(4)]
    loop = Lockstep(list(zip((machine, operator, panel, node), buses, strict=True)))
    loop.run(STOP_S - 0.2)
    before = (node.engagement.state, node.engagement.setpoint_mps, combine.truth.ground_speed_mps)
    loop.run(STOP_S + 0.2)
    yield node, panel, before
    for bus in buses:
        bus.close()


def test_it_drives_at_the_canopen_setpoint(drive):
    _, _, (state, setpoint_mps, speed_mps) = drive
    assert state is State.ENGAGED
    assert setpoint_mps == pytest.approx(1.2)
    assert speed_mps == pytest.approx(1.2, abs=0.06)


def test_heartbeat_and_status_are_on_the_bus(drive):
    _, panel, _ = drive
    beats = panel.heard[0x711]
    assert {data[0] for _, data in beats} >= {0x00, 0x7F, 0x05}  # boot-up, pre-operational or operational
    status = [data for time_s, data in panel.heard[0x191] if time_s < STOP_S - 1.0]
    assert int.from_bytes(status[-1][2:4], "little") == pytest.approx(1200, abs=1)


def test_nmt_stop_means_neutral(drive):
    node, _, _ = drive
    assert node.engagement.state is State.OFF
    assert node.engagement.exit_reason is ExitReason.RELEASED
    assert node.command.current_ma == 0.0


def test_an_sdo_request_is_answered_at_once_by_loop_station_and_node():
    settings = service_settings.load(CONFIG / "cruise.yaml")
    can = msgspec.structs.replace(settings.can, bus="virtual", channel="sdo")
    station = Station(CruiseNode.load(msgspec.structs.replace(settings, can=can)), can)
    with open_bus(can) as bus, open_bus(can) as client:
        loop = Lockstep([(Together([station]), bus)])
        loop.run(0.1)  # a tick, which ends the boot-up
        client.drain()
        client.send(Frame(0.1, 0x611, is_extended_id=False, data=bytes.fromhex("4017100000000000")))
        loop.run(0.11)  # no tick yet
        assert [(frame.arbitration_id, frame.data.hex()) for frame in client.drain()] == [(0x591, "4b171000f4010000")]


def test_nmt_stop_and_start_lead_out_of_no_fault():
    settings = service_settings.load(CONFIG / "cruise.yaml")
    node = CruiseNode.load(settings)
    panel = Codec.load(settings.database, settings.can)

    def after(command: int | None, enable: float = 1.0) -> State:
        for k in range(5):
            now_s = 0.1 * (node.ticks + 1)
            switches = dict.fromkeys(("cruise_set", "cruise_resume", "cruise_accelerate", "cruise_coast"), 0.0)
            node.receive(panel.encode("CCVS", switches | {"cruise_enable": enable}, now_s))
            if command is not None and k == 0:
                node.receive(Frame(now_s, 0, is_extended_id=False, data=bytes([command, 17])))
            node.tick(now_s)
        return node.engagement.state

    assert after(None) is State.STANDBY
    assert after(2) is State.OFF
    assert after(1) is State.STANDBY
    node.engagement.state = State.FAULT
    assert after(2) is State.FAULT
    assert after(1) is State.FAULT
    assert after(2, enable=0.0) is State.OFF, "the operator's own switch"
    assert after(None) is State.OFF, "as long as the node is stopped"
    assert after(1) is State.STANDBY


STORE, RESTORE, SETTINGS = 0x1010, 0x1011, 0x2F00
CANNOT_NOW, CANNOT, TOO_LONG, OUT_OF_RANGE = 0x08000022, 0x08000020, 0x06070012, 0x06090030
SLOWER = b"engagement: {speed_max_mps: 6.0}"
WAIT_S = 20.0


class Service:
    """What `cruise run` does with one file of settings, in a thread; a run after a reload is one more of `daemons`."""

    def __init__(self, settings: CruiseSettings) -> None:
        self.settings = settings
        self.said: list[str] = []
        self.daemons: list[Daemon] = []
        self.states: set[State] = set()
        self.held: State | None = None  # a state that is kept up whatever the node says
        self._stopped = self._again = False
        self._thread = threading.Thread(target=self._work)
        self._thread.start()
        self.wait_for_run(1)

    def reload(self) -> None:
        self._again = True

    def close(self) -> None:
        self._stopped = True
        self._thread.join()

    def wait_for_run(self, number: int) -> CruiseSettings:
        """Wait until run `number` is on the bus, and return its settings."""
        wait_until(lambda: len(self.daemons) >= number)
        assert len(self.daemons) == number
        return self.daemons[-1].settings

    def _work(self) -> None:
        changes = None
        while not self._stopped:
            self._again = False
            daemon = Daemon(self.settings, Notifier(""), self.said.append, changes, self.reload)
            daemon.run(lambda: not (self._stopped or self._again), lambda now_s, daemon=daemon: self._tick(daemon))
            changes = daemon.changes

    def _tick(self, daemon: Daemon) -> None:
        self.states.add(daemon.node.engagement.state)
        if self.held is not None:
            daemon.node.engagement.state = self.held
        if daemon not in self.daemons:
            self.daemons.append(daemon)


def wait_until(true: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.fixture
def settings(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CruiseSettings:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "kept"))
    found = service_settings.load(CONFIG / "cruise.yaml")
    can = msgspec.structs.replace(found.can, bus="virtual", channel=request.node.name)
    return msgspec.structs.replace(found, can=can, persistence=PersistenceSettings(machine="A1"))


@pytest.fixture
def start(settings: CruiseSettings) -> Iterator[Callable[[CruiseSettings], Service]]:
    """Starts a service, and stops the one before."""
    running: list[Service] = []

    def start(settings: CruiseSettings) -> Service:
        if running:
            running[-1].close()
        running.append(Service(settings))
        return running[-1]

    yield start
    running[-1].close()


@pytest.fixture
def master(settings: CruiseSettings) -> Iterator[canopen.RemoteNode]:
    network = canopen.Network()
    network.connect(interface="virtual", channel=settings.can.channel)
    node = network.add_node(17, str(CONFIG / "cruise.eds"))
    assert isinstance(node, canopen.RemoteNode)
    node.sdo.RESPONSE_TIMEOUT = WAIT_S
    yield node
    network.disconnect()


def abort_code(act: Callable[[], None]) -> int:
    with pytest.raises(canopen.SdoAbortedError) as aborted:
        act()
    return aborted.value.code


def test_a_setting_that_is_written_counts_in_the_next_run_and_engages_nothing(settings, start, master):
    service = start(settings)
    with open_bus(settings.can) as far:
        master.sdo.download(SETTINGS, 0, SLOWER)
        assert service.wait_for_run(2).engagement.speed_max_mps == 6.0
        assert service.daemons[-1].node.engagement.settings.speed_max_mps == 6.0, "the node drives by it"
        assert b"speed_max_mps: 6.0" in master.sdo.upload(SETTINGS, 0)
        master.sdo.download(SETTINGS, 0, b"control:\n  limits:\n    current_max_ma: 1000\nsetpoint_from: canopen\n")
        found = service.wait_for_run(3)
        codec = Codec.load(settings.database, settings.can)
        heard = [one for one in map(codec.decode, far.drain()) if one.message == "PumpCurrentCommand"]
    limits = msgspec.structs.replace(settings.control.limits, current_max_ma=1000.0)
    assert found == msgspec.structs.replace(
        settings,
        engagement=msgspec.structs.replace(settings.engagement, speed_max_mps=6.0),
        control=msgspec.structs.replace(settings.control, limits=limits),
        setpoint_from="canopen",
    ), "both writes, and nothing else"
    assert service.states == {State.OFF}
    assert {(reading.name, reading.value) for one in heard for reading in one.readings} == {
        ("pump_current_command_ma", 0.0),
        ("command_active", 0.0),
    }
    service.reload()  # as by SIGHUP
    assert service.wait_for_run(4) == found
    assert service.said == []


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (b"engagement: {speed_max_mps: -6.0}", OUT_OF_RANGE),
        (b"engagement: {speed_max_mps: .nan}", OUT_OF_RANGE),
        (b"engagement: {speed_max_mps: fast}", OUT_OF_RANGE),
        (b"engagement: {speed_max_mps: 6.0}\ncontrol: {limits: {current_min_ma: 1300}}", OUT_OF_RANGE),  # one is right
        (b"control: {frame_s: 0.07}", OUT_OF_RANGE),  # right by itself, but does not fit the model
        (b"estimator: {gain_range: 1.0, pole_max: 0.01}", OUT_OF_RANGE),  # what was learned does not fit it
        (b"engagement: {speed_max_mps: 30.0}", OUT_OF_RANGE),
        (b"engagement: {overspeed_mps: 5.0}", OUT_OF_RANGE),  # these six would switch off what guards the drive
        (b"plausibility: {jump_mps: 5.0}", OUT_OF_RANGE),
        (b"control: {frame_s: 0.2}", OUT_OF_RANGE),
        (b"sampling: {stale_after_s: {brake_pedal: 5.0}}", OUT_OF_RANGE),
        (b"sampling: {stale_after_s: {brake_pedl: 0.5}}", OUT_OF_RANGE),
        (b"control: {limits: {current_max_ma: 5000.0}}", OUT_OF_RANGE),
        (b"control: {limits: {current_max_ma: 1.2}}", OUT_OF_RANGE),  # in A
        (b"control: {limits: {current_max_ma: 1700.0}}", OUT_OF_RANGE),  # more than the frame of the command holds
        (b"engagement: {speed_mx_mps: 6.0}", OUT_OF_RANGE),
        (b"speed_max_mps: 6.0", OUT_OF_RANGE),
        (b"can: {channel: other}", OUT_OF_RANGE),  # these four are the file's alone
        (b"model: /etc/passwd", OUT_OF_RANGE),
        (b"commissioning: {experiments: experiments.yaml}", OUT_OF_RANGE),
        (b"persistence: {machine: other}", OUT_OF_RANGE),
        (b"engagement: {{{{", OUT_OF_RANGE),
        (b"engagement", OUT_OF_RANGE),
        (bytes(range(128, 256)), OUT_OF_RANGE),
        (b"", OUT_OF_RANGE),
        (SLOWER + b" " * 2000, TOO_LONG),
    ],
)
def test_what_is_wrong_is_refused_and_changes_nothing(settings, start, master, text: bytes, code: int):
    service = start(settings)
    before = master.sdo.upload(SETTINGS, 0)
    assert abort_code(lambda: master.sdo.download(SETTINGS, 0, text, force_segment=True)) == code
    assert master.sdo.upload(SETTINGS, 0) == before
    assert service.daemons[-1].changes == {}
    service.reload()
    assert service.wait_for_run(2) == settings
    assert service.said == []


@pytest.mark.parametrize("state", [state for state in State if state.drives])
def test_nothing_is_written_or_restored_while_it_drives(settings, start, master, state: State):
    service = start(settings)
    service.held = state
    wait_until(lambda: service.daemons[-1].node.engagement.state is state)
    assert abort_code(lambda: master.sdo.download(SETTINGS, 0, SLOWER)) == CANNOT_NOW
    assert abort_code(lambda: master.sdo.download(RESTORE, 1, b"load")) == CANNOT_NOW
    service.held = None
    service.reload()
    assert service.wait_for_run(2) == settings


def test_what_is_stored_is_there_after_a_restart_and_gone_when_restored(settings, start, master):
    def speed_max_mps(found: CruiseSettings) -> float:
        return found.engagement.speed_max_mps

    service = start(settings)
    master.sdo.download(SETTINGS, 0, SLOWER)
    assert speed_max_mps(service.wait_for_run(2)) == 6.0
    service = start(settings)
    assert service.wait_for_run(1) == settings, "not stored, so gone"
    master.sdo.download(SETTINGS, 0, SLOWER)
    service.wait_for_run(2)
    master.sdo.download(STORE, 1, b"save")
    master.sdo.download(SETTINGS, 0, b"engagement: {speed_max_mps: 4.0}")
    assert speed_max_mps(service.wait_for_run(3)) == 4.0
    service = start(settings)
    assert speed_max_mps(service.wait_for_run(1)) == 6.0, "the last that was stored"
    assert speed_max_mps(start(settings).wait_for_run(1)) == 6.0, "and after a run that nobody stored"
    service = start(msgspec.structs.replace(settings, setpoint_from="canopen"))
    found = service.wait_for_run(1)
    assert (speed_max_mps(found), found.setpoint_from) == (6.0, "canopen"), "all else is the file's"
    master.sdo.download(RESTORE, 1, b"load")
    assert speed_max_mps(service.wait_for_run(2)) == speed_max_mps(settings)
    assert start(settings).wait_for_run(1) == settings


def test_a_file_that_no_longer_agrees_with_what_is_stored_counts_alone(settings, start, master):
    service = start(settings)
    master.sdo.download(SETTINGS, 0, b"control: {limits: {current_min_ma: 500.0}}")
    assert service.wait_for_run(2).control.limits.current_min_ma == 500.0
    master.sdo.download(STORE, 1, b"save")
    limits = msgspec.structs.replace(settings.control.limits, current_max_ma=400.0)
    file = msgspec.structs.replace(settings, control=msgspec.structs.replace(settings.control, limits=limits))
    service = start(file)
    assert service.wait_for_run(1) == file
    assert "current_min_ma has to be at least 0 and below current_max_ma" in service.said[0]
    assert start(settings).wait_for_run(1).control.limits.current_min_ma == 500.0, "it was not thrown away"


def test_without_persistence_nothing_can_be_stored(settings, start, master):
    start(msgspec.structs.replace(settings, persistence=None))
    assert abort_code(lambda: master.sdo.download(STORE, 1, b"save")) == CANNOT
