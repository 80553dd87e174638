"""A machine that the cruise control drives when something happens to it, and what the machine does then."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cruise.service.course import Drive, FieldRow, OperatorRow
from cruise.service.settings import CruiseSettings
from tools.vcan import players
from tools.vcan.players import Process

NEUTRAL_WITHIN_S = 0.3  # of whatever happened
BY_WORD_WITHIN_S = 0.12  # a command says so: sooner than the time-out of 0.2 s since the last one could
ENGAGE_S = 6.0  # s from the beginning to the operator's `set`
PATIENCE_S = 2.0  # s until he presses it again: one press may be refused on a machine that is late
SEED = 7


@dataclass(frozen=True)
class Scene:
    """Combine and operator on the bus; all times are of the kernel's monotonic clock."""

    begin_s: float
    again_s: float  # when the operator sets out to engage again: main switch off and on, lever, `set`
    truth: Path

    def until_driven(self) -> None:
        """Wait until the cruise control has driven for a while. Raises AssertionError."""
        self.sleep_until(self.begin_s + ENGAGE_S + PATIENCE_S + 2.0)
        driven = self.driven_s()
        assert len(driven), "the cruise control never drove"
        assert driven[0] > self.begin_s + ENGAGE_S - 0.1, "it engaged by itself"

    def driven_s(self) -> np.ndarray:
        """Return the instants at which the cruise control's command counted until now."""
        columns = players.read(self.truth, players.TRUTH)
        return columns["time_s"][columns["by_cruise"] == 1.0]

    def neutral_after_s(self, fault_s: float) -> float:
        """Return how long it drove on after `fault_s`, until the operator acts again: by itself, never."""
        self.sleep_until(self.again_s)
        driven = self.driven_s()
        assert driven[-1] > fault_s - 1.0, "it had let go before"
        return driven[-1] - fault_s

    def drives_again(self) -> bool:
        """Whether it drives after the operator's second `set`."""
        self.sleep_until(self.again_s + 8.0 + PATIENCE_S)
        return bool(self.driven_s()[-1] > self.again_s + 6.0 + PATIENCE_S)

    @staticmethod
    def sleep_until(time_s: float) -> None:
        """Until then on the monotonic clock."""
        time.sleep(max(time_s - time.monotonic(), 0.0))


def begin(
    start: Callable[[Callable[[], object]], Process], settings: CruiseSettings, folder: Path, again_s: float
) -> Scene:
    """Put combine and operator on the bus; the operator engages, and again `again_s` after the beginning."""
    begin_s = time.monotonic() + 2.0
    drive = Drive(
        seconds=0.0,  # until it is ended
        field=(FieldRow(at_s=0.0, engine_speed_setpoint_rpm=2100.0, gear=2, rolling_resistance=0.05),),
        operator=(
            OperatorRow(at_s=0.2, cruise_enable=1.0),
            OperatorRow(at_s=0.5, over_s=1.0, lever_pct=50.0),
            OperatorRow(at_s=ENGAGE_S, press="set"),
            OperatorRow(at_s=ENGAGE_S + PATIENCE_S, press="set"),
            OperatorRow(at_s=again_s + 0.2, cruise_enable=0.0),
            OperatorRow(at_s=again_s + 0.8, cruise_enable=1.0),
            OperatorRow(at_s=again_s + 1.0, over_s=0.5, lever_pct=60.0),
            OperatorRow(at_s=again_s + 5.5, press="set"),
            OperatorRow(at_s=again_s + 5.5 + PATIENCE_S, press="set"),
        ),
    )
    scene = Scene(begin_s, begin_s + again_s, folder / "truth")
    start(lambda: players.combine(settings, drive, SEED, begin_s, scene.truth))
    start(lambda: players.operator(settings, drive, begin_s))
    return scene
