"""The CANopen node of the running service, seen by the library's own client on the same bus."""

import json
import time
from collections.abc import Iterator
from pathlib import Path

import canopen
import pytest

from cruise.cli.places import CONFIG
from cruise.service.settings import CruiseSettings
from tests.real_bus.conftest import BUS, Peer, serve

NODE, PANEL = 17, 33
STORE, RESTORE, SETTINGS, LEARNED, STATISTICS = 0x1010, 0x1011, 0x2F00, 0x2F01, 0x2F02
WAIT_S = 5.0


@pytest.fixture(scope="module")
def remote(in_process, settings: CruiseSettings) -> Iterator[canopen.RemoteNode]:
    """The node, as a master sees it."""
    in_process(lambda: serve(settings))
    network = canopen.Network()
    network.connect(interface="socketcan", channel=BUS)
    node = network.add_node(NODE, str(CONFIG / "cruise.eds"))
    assert isinstance(node, canopen.RemoteNode)
    node.sdo.RESPONSE_TIMEOUT = WAIT_S
    node.nmt.wait_for_heartbeat(30.0)
    yield node
    network.disconnect()


def test_it_starts_pre_operational_and_a_master_starts_it(remote: canopen.RemoteNode, peer: Peer):
    assert remote.nmt.state == "PRE-OPERATIONAL"
    remote.nmt.state = "OPERATIONAL"
    operational = peer.hear(lambda identifier, data: (identifier, data) == (0x700 + NODE, b"\x05"), WAIT_S)
    assert operational is not None, "the master's own idea of the state is no proof: the node has to say it"
    status = peer.hear(lambda identifier, data: identifier == 0x180 + NODE, WAIT_S)
    assert status is not None
    assert len(status[1]) == 7


def test_nmt_stop_silences_it_but_for_the_heartbeat(remote: canopen.RemoteNode, peer: Peer):
    def heartbeat(state: bytes) -> bool:
        return peer.hear(lambda identifier, data: (identifier, data) == (0x700 + NODE, state), WAIT_S) is not None

    remote.nmt.state = "STOPPED"
    assert heartbeat(b"\x04")
    assert peer.hear(lambda identifier, data: identifier == 0x180 + NODE, 0.5) is None
    remote.nmt.state = "PRE-OPERATIONAL"
    assert heartbeat(b"\x7f")


def test_settings_parameters_and_statistics_are_read_by_sdo(remote: canopen.RemoteNode):
    begin_s = time.monotonic()
    text = remote.sdo.upload(SETTINGS, 0)
    assert b"panel_node_id: 33" in text
    assert time.monotonic() - begin_s < 0.02 * len(text) / 7, "segments of 7 bytes, not one in each tick of 50 ms"
    assert len(json.loads(remote.sdo.upload(LEARNED, 0))) > 3
    statistics = json.loads(remote.sdo.upload(STATISTICS, 0))
    assert (statistics["starts"], statistics["engaged_s"]) == (1, 0.0)
    with pytest.raises(canopen.SdoAbortedError) as read_only:
        remote.sdo.download(LEARNED, 0, b"{}")
    assert read_only.value.code == 0x06010002


def test_save_and_load_take_their_signature_only(remote: canopen.RemoteNode, settings: CruiseSettings):
    assert settings.persistence is not None
    state = Path(settings.persistence.folder) / "state"
    for index in (STORE, RESTORE):
        with pytest.raises(canopen.SdoAbortedError) as wrong:
            remote.sdo.download(index, 1, b"evas")
        assert wrong.value.code == 0x08000020
    assert not state.exists()
    remote.sdo.download(STORE, 1, b"save")
    deadline_s = time.monotonic() + WAIT_S
    while not state.exists() and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert json.loads(state.read_bytes().partition(b"\n")[2])["machine"] == "A1"
    remote.sdo.download(RESTORE, 1, b"load")


def test_the_loss_of_the_panels_heartbeat_is_an_emergency_until_it_is_back(remote: canopen.RemoteNode, peer: Peer):
    def emergency(within_s: float) -> tuple[int, int] | None:
        found = peer.hear(lambda identifier, data: identifier == 0x80 + NODE, within_s)
        return None if found is None else (int.from_bytes(found[1][:2], "little"), found[1][2])

    for _ in range(5):
        peer.send(0x700 + PANEL, b"\x05")
        assert emergency(0.1) is None
    gone_s = time.monotonic()
    assert emergency(WAIT_S) == (0x8130, 0x11)
    assert time.monotonic() - gone_s < 0.5, "300 ms and a tick"
    assert remote.sdo.upload(0x1001, 0) == b"\x11"
    peer.send(0x700 + PANEL, b"\x05")
    assert emergency(WAIT_S) == (0, 0)
    remote.sdo.download(0x1016, 1, bytes(4))  # nobody is watched any more
    assert emergency(0.6) is None
