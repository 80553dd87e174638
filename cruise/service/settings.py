"""All settings of the service, as they stand in config/cruise.yaml."""

from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from cruise import settings as strict
from cruise.can.node import CanopenSettings
from cruise.can.settings import CanSettings
from cruise.control.commissioning import CommissioningSettings
from cruise.control.controller import ControlSettings
from cruise.control.plausibility import PlausibilitySettings
from cruise.control.proof import ProofSettings
from cruise.control.situation import EngagementSettings
from cruise.estimation.estimator import EstimatorSettings
from cruise.estimation.supervision import SupervisionSettings
from cruise.sampling import SamplingSettings
from cruise.service.persistence import PersistenceSettings
from cruise.signals import INPUT, SIGNALS

T = TypeVar("T", bound=msgspec.Struct)


class CruiseSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One struct per part of the program; file names are relative to the settings file."""

    model: str  # file of the factory model
    database: str  # file of the CAN database
    can: CanSettings = CanSettings()
    canopen: CanopenSettings | None = None  # None: no CANopen node
    dictionary: str = "cruise.eds"  # file of the node's object dictionary
    setpoint_from: Literal["j1939", "canopen"] = "j1939"  # whose setpoint and main switch count; never both
    sampling: SamplingSettings = SamplingSettings()
    estimator: EstimatorSettings = EstimatorSettings()
    supervision: SupervisionSettings = SupervisionSettings()
    proof: ProofSettings = ProofSettings()
    engagement: EngagementSettings = EngagementSettings()
    plausibility: PlausibilitySettings = PlausibilitySettings()
    control: ControlSettings = ControlSettings()
    commissioning: CommissioningSettings | None = None  # None: no experiments on this machine
    persistence: PersistenceSettings | None = None  # None: nothing is kept from one start to the next

    def __post_init__(self) -> None:
        if self.setpoint_from == "canopen" and self.canopen is None:
            raise ValueError(
                "setpoint_from is canopen, and there is no section canopen: no setpoint would ever come; add the "
                "section, or take j1939"
            )
        most_ma = SIGNALS[INPUT].high
        for name, part in (("control", self.control), ("commissioning", self.commissioning)):
            asked_ma = part.limits.current_max_ma if part is not None else 0.0
            if asked_ma > most_ma:
                raise ValueError(
                    f"{name}.limits.current_max_ma is {asked_ma:g}; above {most_ma:g} mA no frame is a current"
                )


def load(path: str | Path) -> CruiseSettings:
    """Read the settings; the file names in them become paths that hold from anywhere."""
    beside = Path(path).parent

    def found(settings: T, *names: str) -> T:
        return msgspec.structs.replace(settings, **{name: str(beside / getattr(settings, name)) for name in names})

    read = strict.load(path, CruiseSettings)
    commissioning, persistence = read.commissioning, read.persistence
    return msgspec.structs.replace(
        found(read, "model", "database", "dictionary"),
        commissioning=found(commissioning, "experiments") if commissioning is not None else None,
        persistence=found(persistence, "folder") if persistence is not None else None,
    )
