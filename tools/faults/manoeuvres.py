"""Random manoeuvres: an approach by hand, a press of `resume`, and what field and operator do while cruise drives.

Fourth gear is the road's: nothing is harvested, the ground is firm, slopes are longer. On soft soil uphill it could not
move the machine at all: the relief valve opens.
"""

from dataclasses import dataclass
from random import Random
from typing import Final

import msgspec

from cruise.plant.road import RoadSettings
from cruise.service.course import FieldRow, OperatorRow, value_at

SECONDS: Final = 22.0  # s of one trial
USUAL_MPS: Final = {1: 0.75, 2: 1.25, 3: 2.1, 4: 3.6}  # at half a lever
GEARS: Final = (1, 2, 2, 2, 2, 3, 3, 4)  # harvesting is done in second
ROAD_GEAR: Final = 4
LONGER: Final = 3.0  # a road's slopes


@dataclass(frozen=True)
class Manoeuvre:
    """Rows of field and operator, as of a drive (cruise.service.course)."""

    seed: int
    field: tuple[FieldRow, ...]
    operator: tuple[OperatorRow, ...]
    engage_s: float
    undulation_deg: float
    seconds: float = SECONDS

    def setpoint_mps(self, now_s: float) -> float:
        """What the operator asks for."""
        return value_at(self.operator, "setpoint_mps", 0.0, now_s)

    def road(self, road: RoadSettings) -> RoadSettings:
        """The ground."""
        return msgspec.structs.replace(road, undulation_deg=self.undulation_deg)


def manoeuvre(seed: int, seconds: float = SECONDS) -> Manoeuvre:
    """The manoeuvre of a seed; a longer one goes on in the same way."""
    rng = Random(seed)
    gear = rng.choice(GEARS)
    usual_mps = USUAL_MPS[gear]
    engage_s = round(rng.uniform(5.0, 6.5), 2)
    field = [
        FieldRow(
            at_s=0.0,
            gear=gear,
            engine_speed_setpoint_rpm=rng.choice((2100.0, 2100.0, 1900.0)),
            rolling_resistance=rng.uniform(0.03, 0.08),
            crop_power_kw=rng.choice((0.0, 20.0, 50.0)),
        )
    ]
    operator = [
        OperatorRow(at_s=0.2, cruise_enable=1.0, setpoint_mps=round(usual_mps * rng.uniform(0.85, 1.15), 2)),
        OperatorRow(at_s=0.5, over_s=1.5, lever_pct=round(rng.uniform(48.0, 62.0), 1)),
        OperatorRow(at_s=engage_s, press="resume"),
    ]
    at_s = engage_s
    while (at_s := at_s + rng.uniform(3.0, 7.0)) < seconds:
        operator.append(OperatorRow(at_s=at_s, setpoint_mps=round(usual_mps * rng.uniform(0.75, 1.3), 2)))
    at_s = engage_s
    while (at_s := at_s + rng.uniform(4.0, 10.0)) < seconds:
        over_s = rng.uniform(2.0, 5.0)
        field.append(
            rng.choice(
                (
                    FieldRow(at_s=at_s, over_s=over_s, grade_deg=rng.uniform(-4.0, 4.0)),
                    FieldRow(at_s=at_s, over_s=over_s, engine_speed_setpoint_rpm=rng.uniform(1700.0, 2100.0)),
                    FieldRow(at_s=at_s, over_s=over_s, rolling_resistance=rng.uniform(0.03, 0.11)),
                    FieldRow(at_s=at_s, over_s=over_s, crop_power_kw=rng.uniform(0.0, 90.0)),
                )
            )
        )
    undulation_deg = rng.choice((0.0, 0.0, 0.5))
    if gear == ROAD_GEAR:
        field = [_on_road(row) for row in field]
    return Manoeuvre(seed, tuple(field), tuple(operator), engage_s, undulation_deg, seconds)


def _on_road(row: FieldRow) -> FieldRow:
    resistance, power_kw = row.rolling_resistance, row.crop_power_kw
    return msgspec.structs.replace(
        row,
        over_s=row.over_s * (LONGER if row.grade_deg is not None else 1.0),
        rolling_resistance=None if resistance is None else 0.4 * resistance + 0.01,  # 0.02 to 0.05
        crop_power_kw=None if power_kw is None else 0.0,
    )
