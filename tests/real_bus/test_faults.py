"""What happens to the service while it drives: the machine is neutral soon, and nothing starts by itself afterwards."""

import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from cruise.service.settings import CruiseSettings
from tests.real_bus import scene
from tests.real_bus.conftest import Peer
from tests.real_bus.scene import BY_WORD_WITHIN_S, NEUTRAL_WITHIN_S
from tools.vcan import players
from tools.vcan.players import Process

AGAIN_S = 14.0
COMMAND = 0xFF1211  # PGN and source address


def paused(service: Process) -> None:
    """Frozen for a second: the drive's time-out makes it neutral; afterwards old commands and old states are over."""
    service.send(signal.SIGSTOP)
    time.sleep(1.0)
    service.send(signal.SIGCONT)


@pytest.mark.parametrize(
    ("happens", "within_s", "exit_code"),
    [
        (lambda service: service.send(signal.SIGINT), BY_WORD_WITHIN_S, 0),
        (lambda service: service.send(signal.SIGHUP), BY_WORD_WITHIN_S, None),
        (lambda service: service.send(signal.SIGKILL), NEUTRAL_WITHIN_S, -signal.SIGKILL),
        (paused, NEUTRAL_WITHIN_S, None),
    ],
    ids=["stop", "reload", "kill", "pause"],
)
def test_it_is_neutral_at_once_and_stays_so(
    happens: Callable[[Process], None],
    within_s: float,
    exit_code: int | None,
    settings: CruiseSettings,
    tmp_path: Path,
    peer: Peer,
    note: Callable[[str, float], None],
    request: pytest.FixtureRequest,
):
    with players.killed_in_the_end() as start:
        service = start(lambda: players.service(settings, tmp_path / "known"))
        assert peer.hear(lambda identifier, data: identifier & 0xFFFFFF == COMMAND, 30.0) is not None
        machine = scene.begin(start, settings, tmp_path, AGAIN_S)
        machine.until_driven()
        fault_s = time.monotonic()
        happens(service)
        neutral_after_s = machine.neutral_after_s(fault_s)
        assert neutral_after_s <= within_s
        note(f"neutral_after_{request.node.callspec.id}_ms", 1000.0 * neutral_after_s)
        if exit_code is None:
            assert machine.drives_again(), "the operator can engage again"
        else:
            assert service.ended(5.0) == exit_code
