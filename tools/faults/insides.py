"""What goes wrong inside: the actuator and the machine, the program's turn and clock, its memory and its files."""

import math
from collections import deque
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import msgspec
import numpy as np

from cruise.can.frame import Frame
from cruise.can.ring import Ring, RingSettings
from cruise.model import files
from cruise.model.model import Model
from cruise.plant import Inputs
from cruise.service.black_box import BlackBox
from cruise.service.chronicle import Chronicle
from cruise.service.cruise_node import CruiseNode
from cruise.service.persistence import Keeper, PersistenceSettings, StateFile, fingerprint
from cruise.settings import SettingsError

from .bed import Bed, Fault, Wire, codec, cruise_settings, factory_model, plant_settings


class Current(Fault):
    """The current that flows is not the one that was commanded: stuck, off, scaled or late."""

    def __init__(self, scale: float = 1.0, offset_ma: float = 0.0, stuck: bool = False, late_s: float = 0.0) -> None:
        self.scale, self.offset_ma, self.stuck = scale, offset_ma, stuck
        self.kept: deque[float] = deque(maxlen=max(round(late_s / 0.01), 1))

    def inputs(self, inputs: Inputs, now_s: float) -> Inputs:
        """What flows instead; nothing flows where nothing was commanded, but for what is stuck."""
        wanted_ma = inputs.pump_current_ma
        if self.stuck:
            self.kept.append(self.kept[0] if self.kept else wanted_ma)
        else:
            self.kept.append(self.scale * wanted_ma + (self.offset_ma if wanted_ma else 0.0))
        return replace(inputs, pump_current_ma=min(max(self.kept[0], -1200.0), 1200.0))


class Held(Fault):
    """Brake or clutch act though their switch says nothing."""

    def __init__(self, brake: float = 0.0, clutch: bool = False) -> None:
        self.brake, self.clutch = brake, clutch

    def inputs(self, inputs: Inputs, now_s: float) -> Inputs:
        """What acts on the wheels."""
        return replace(inputs, brake=max(inputs.brake, self.brake), clutch=inputs.clutch or self.clutch)


class Plugged(Fault):
    """The drum takes more power than the engine has left."""

    def __init__(self, power_kw: float) -> None:
        self.power_kw = power_kw

    def inputs(self, inputs: Inputs, now_s: float) -> Inputs:
        """So much more crop."""
        return replace(inputs, crop_power_kw=inputs.crop_power_kw + self.power_kw)


class Worn(Fault):
    """The pump has lost, or gained, displacement."""

    def __init__(self, share: float) -> None:
        self.share = share

    def begin(self, bed: Bed) -> None:
        """Another pump."""
        self._change(bed, self.share)

    def end(self, bed: Bed) -> None:
        """As it was."""
        self._change(bed, 1.0)

    def _change(self, bed: Bed, share: float) -> None:
        plant = plant_settings()
        pump = msgspec.structs.replace(plant.pump, displacement_cm3=share * plant.pump.displacement_cm3)
        bed.machine.change(msgspec.structs.replace(plant, pump=pump, road=bed.manoeuvre.road(plant.road)))


class Paused(Fault):
    """The process gets no turn at all."""

    def turn(self, bed: Bed, now_s: float) -> bool:
        """None."""
        return False


class Starved(Fault):
    """The process gets its turn seldom, at random."""

    def __init__(self, rng: Random, share: float) -> None:
        self.dice, self.share = Random(rng.random()), share

    def turn(self, bed: Bed, now_s: float) -> bool:
        """Dice."""
        return self.dice.random() < self.share


class Clock(Fault):
    """The clock of the service jumps, for itself and for what it hears."""

    def __init__(self, by_s: float) -> None:
        self.by_s = by_s

    def begin(self, bed: Bed) -> None:
        """Jump; there is no way back."""
        self.clock_off_s = self.by_s


class Stamps(Fault):
    """Frames carry times of a clock that was set, as a driver of the bus may give them."""

    def __init__(self, by_s: float) -> None:
        self.by_s = by_s

    def frame(self, sender: str, message: str, frame: Frame, wire: object) -> bool:
        """As if sent at another time."""
        frame.timestamp += self.by_s
        return True


class FullDisk(Fault):
    """What is kept of the machine, and a recorder beside it, are written to a disk that has no room.

    The kernel's own full device stands for the disk; what it answers ends the service where nobody takes it.
    """

    def begin(self, bed: Bed) -> None:
        """Chronicle and black box as `cruise run` and `cruise record --ring` have them."""
        self.folder = TemporaryDirectory()
        place = Path(self.folder.name)
        kept = PersistenceSettings(machine="1", folder=str(place), every_s=0.2)
        self.keeper = Keeper(StateFile(place / "state", kept.machine, fingerprint(bed.node.estimator.factory)))
        self.chronicle = Chronicle(bed.node, kept, None, self.keeper)
        self.box = BlackBox(codec(), Ring(place, RingSettings(segment_s=0.5), "can0"), lambda line: None)
        for name in ("state.new", *(f"log-{number:07}.log.gz" for number in range(2, 100))):
            (place / name).symlink_to("/dev/full")

    def turn(self, bed: Bed, now_s: float) -> bool:
        """Both get their turn, as they do in their loops."""
        try:
            self.chronicle.step(now_s)
            self.box.tick(now_s)
        except (OSError, ValueError) as error:
            bed.died = f"{type(error).__name__}: {error}"
        return not bed.died

    def frame(self, sender: str, message: str, frame: Frame, wire: Wire) -> bool:
        """The recorder hears all."""
        self.box.receive(frame)
        return True

    def end(self, bed: Bed) -> None:
        """There is room again."""
        self.keeper.close()
        self.folder.cleanup()


class ModelFile(Fault):
    """The service starts with another parameter file: cut off, or of another machine."""

    def __init__(self, cut: float = 1.0, gain: float = 1.0) -> None:
        self.cut, self.gain = cut, gain

    def begin(self, bed: Bed) -> None:
        """Start as `cruise run` does; a file that cannot be used is no start."""
        text = Path(cruise_settings().model).read_text(encoding="utf-8")
        with TemporaryDirectory() as folder:
            path = Path(folder) / "model.yaml"
            path.write_text(text[: round(self.cut * len(text))], encoding="utf-8")
            try:
                model = files.load(path)
            except SettingsError as error:
                bed.started, bed.died = False, f"does not start: {error}"
                return
        bed.node = CruiseNode(cruise_settings(), scaled(model, self.gain), codec())


class Nonsense(Fault):
    """The estimator believes nonsense, and is sure of it."""

    def __init__(self, gain: float) -> None:
        self.gain = gain

    def begin(self, bed: Bed) -> None:
        """The parameters of another machine, without doubt."""
        rls = bed.node.estimator.rls
        rls.theta = np.array(scaled(factory_model(), self.gain).theta)
        rls.root = rls.root * 1e-3


class Upset(Fault):
    """A bit of the memory flips: the model that drives, the disturbance, or the limits' own past."""

    def __init__(self, gain: float = 1.0, disturbance_mps: float = 0.0, last_ma: float = 0.0) -> None:
        self.gain, self.disturbance_mps, self.last_ma = gain, disturbance_mps, last_ma

    def begin(self, bed: Bed) -> None:
        """Once."""
        controller = bed.node.controller
        if self.gain != 1.0:
            controller.adopt(scaled(factory_model(), self.gain))
        if self.disturbance_mps:
            controller.observer.disturbance_mps = self.disturbance_mps
        if self.last_ma:
            controller.limits.last_ma = self.last_ma


def scaled(model: Model, gain: float) -> Model:
    """The model with its gain, and what adds to it, times so much; NaN gives NaN."""
    a, b, loads, c_0 = model.split(model.theta)
    by = gain if math.isfinite(gain) else math.nan
    return model.with_theta([*a, *(by * one for one in b), *(by * one for one in loads), by * c_0])
