"""The sensors: what the machine shows of itself, each at its own rate, late, noisy and in steps.

    shown(t_k) = round((truth(t_k - delay) + bias + noise) / resolution) resolution,    t_k = phase + k / rate + jitter

Pitch is the exception in what it looks at: an inclinometer hangs in the sum of gravity and inertia, so that it shows
slope + atan(a / g): 1 m/s2 looks like 5.8 degrees.

The generator's numbers are drawn in blocks, from one stream per sensor: another rate of one sensor leaves the others'
noise as it was.

Source: the rates are those of the messages (SAE J1939-71, ISO 11783-7); noise and delay as stated beside each number.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Final, NamedTuple

import numpy as np
from msgspec import Meta, Struct

from cruise.plant.bounds import NotNegative
from cruise.signals import Reading

BLOCK = 1024
LONGEST_DELAY_S = 1.0

TRUTH: Final = (
    "ground_speed_mps",
    "pump_current_ma",
    "wheel_speed_mps",
    "engine_speed_rpm",
    "engine_load_pct",
    "gear",
    "pitch_deg",
    "oil_temperature_c",
    "machine_mass_kg",
    "line_pressure_bar",
)
"""Order of the values in one entry of the history that the sensors read."""

HELD: Final = frozenset({"gear"})
"""Signals that have no values in between."""

Rate = Annotated[float, Meta(ge=0.1, le=100)]
Delay = Annotated[float, Meta(ge=0, le=LONGEST_DELAY_S)]


class ChannelSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One value of a sensor; noise (standard deviation), resolution and bias are in the unit of the signal's name."""

    noise: NotNegative = 0.0
    resolution: NotNegative = 0.0
    bias: float = 0.0
    delay_s: Delay = 0.0


class SensorSettings(ChannelSettings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A sensor of one value with its own rate."""

    rate_hz: Rate


class DriveFeedbackSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The drive's own frame: speed and current of the same instants, at 5 to 100 Hz (the paper, section II.B)."""

    rate_hz: Annotated[float, Meta(ge=5, le=100)] = 50.0
    # Hall sensor on the gearbox: pulses and tread ripple, 0.005..0.03 m/s; averaging over pulses, 0.01..0.1 s.
    ground_speed_mps: ChannelSettings = ChannelSettings(noise=0.015, resolution=0.001, delay_s=0.02)
    # Shunt of the output stage with the rest of the dither: 0.3..5 mA.
    pump_current_ma: ChannelSettings = ChannelSettings(noise=1.0, resolution=0.05, delay_s=0.005)


class SensorsSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Every sensor of the machine."""

    pitch_inertia_share: NotNegative = 1.0  # 1: feels acceleration in full; 0: a gyroscope corrects it; 0..1
    jitter_s: Annotated[float, Meta(ge=0, le=0.004)] = 0.001  # of a controller's sampling instants: 0..0.003
    drive_feedback: DriveFeedbackSettings = DriveFeedbackSettings()
    # Radar: noise 0.01..0.05 m/s, filter 0.05..0.3 s; resolution of SPN 1859.
    ground_speed_mps: SensorSettings = SensorSettings(rate_hz=10.0, noise=0.02, resolution=0.001, delay_s=0.1)
    # Gearbox pulses: 0.003..0.02 m/s; resolution of SPN 1862.
    wheel_speed_mps: SensorSettings = SensorSettings(rate_hz=10.0, noise=0.008, resolution=0.001, delay_s=0.03)
    # Crankshaft pulses over a turn: 1..5 rpm; resolution of SPN 190.
    engine_speed_rpm: SensorSettings = SensorSettings(rate_hz=50.0, noise=2.0, resolution=0.125, delay_s=0.01)
    # From the injected quantity: 0.5..2 %; resolution of SPN 92.
    engine_load_pct: SensorSettings = SensorSettings(rate_hz=20.0, noise=0.8, resolution=1.0, delay_s=0.05)
    gear: SensorSettings = SensorSettings(rate_hz=10.0, resolution=1.0, delay_s=0.05)
    # Inclinometer on a shaking chassis: 0.1..0.5 deg; resolution of SPN 4976 is 1 / 32768 deg.
    pitch_deg: SensorSettings = SensorSettings(rate_hz=100.0, noise=0.25, resolution=1.0 / 32768.0, delay_s=0.01)
    # Thermistor in the suction line: 0.1..0.5 degC; resolution of SPN 1638.
    oil_temperature_c: SensorSettings = SensorSettings(rate_hz=1.0, noise=0.2, resolution=1.0, delay_s=0.5)
    # From the level of grain in the bin: 50..300 kg.
    machine_mass_kg: SensorSettings = SensorSettings(rate_hz=1.0, noise=80.0, resolution=10.0, delay_s=0.5)
    # Two 600 bar transducers: 0.5 % of the range, 1..3 bar.
    line_pressure_bar: SensorSettings = SensorSettings(rate_hz=20.0, noise=1.5, resolution=0.5, delay_s=0.005)


class SensorReading(Reading, frozen=True, gc=False):
    """A reading and the sensor that gave it: two sensors show the ground speed."""

    sensor: str


@dataclass(slots=True)
class Stream:
    """Random numbers of one sensor, drawn in blocks."""

    generator: np.random.Generator
    normal: list[float] = field(default_factory=list)
    uniform: list[float] = field(default_factory=list)

    def next_normal(self) -> float:
        """Standard normal number."""
        if not self.normal:
            self.normal = self.generator.standard_normal(BLOCK).tolist()
        return self.normal.pop()

    def next_uniform(self) -> float:
        """Uniform number in [-1, 1)."""
        if not self.uniform:
            self.uniform = self.generator.uniform(-1.0, 1.0, BLOCK).tolist()
        return self.uniform.pop()


@dataclass(slots=True)
class SensorState:
    """Random numbers and next sampling instant of one sensor, without and with its jitter."""

    stream: Stream
    nominal_s: float
    due_s: float


class Channel(NamedTuple):
    """One value of a sensor: the signal, where the truth stands in the history, and its settings unpacked."""

    signal: str
    place: int
    held: bool
    noise: float
    resolution: float
    bias: float
    delay_s: float


@dataclass(frozen=True, slots=True)
class Sensor:
    """Values that are sampled together."""

    name: str
    period_s: float
    channels: tuple[Channel, ...]


def sensors(settings: SensorsSettings) -> tuple[Sensor, ...]:
    """The sensors in a fixed order: that of their random streams."""
    drive = settings.drive_feedback
    together = (
        _channel("ground_speed_mps", drive.ground_speed_mps),
        _channel("pump_current_ma", drive.pump_current_ma),
    )
    alone: dict[str, SensorSettings] = {
        "ground_speed_mps": settings.ground_speed_mps,
        "wheel_speed_mps": settings.wheel_speed_mps,
        "engine_speed_rpm": settings.engine_speed_rpm,
        "engine_load_pct": settings.engine_load_pct,
        "gear": settings.gear,
        "pitch_deg": settings.pitch_deg,
        "oil_temperature_c": settings.oil_temperature_c,
        "machine_mass_kg": settings.machine_mass_kg,
        "line_pressure_bar": settings.line_pressure_bar,
    }
    return (
        Sensor("drive_feedback", 1.0 / drive.rate_hz, together),
        *(Sensor(name, 1.0 / one.rate_hz, (_channel(name, one),)) for name, one in alone.items()),
    )


def start(settings: SensorsSettings, seed: int, time_s: float) -> list[SensorState]:
    """State of the sensors of `sensors(settings)`, each with a phase of its own."""
    states = []
    for index, sensor in enumerate(sensors(settings)):
        stream = Stream(np.random.default_rng([seed, index]))
        # The first instant lies within the first period, and no jitter takes it before the start.
        nominal_s = time_s + settings.jitter_s + sensor.period_s * 0.5 * (1.0 + stream.next_uniform())
        states.append(SensorState(stream, nominal_s, nominal_s + settings.jitter_s * stream.next_uniform()))
    return states


def sample(
    suite: Sequence[Sensor],
    states: Sequence[SensorState],
    jitter_s: float,
    history: Sequence[Sequence[float]],
    now_s: float,
    step_s: float,
    readings: list[Reading],
) -> None:
    """Appends what falls due up to `now_s`, the time of the last entry of `history` (one entry per `step_s`)."""
    oldest = len(history) - 2
    for sensor, state in zip(suite, states, strict=True):
        due_s = state.due_s
        if due_s > now_s:
            continue
        name, stream = sensor.name, state.stream
        while due_s <= now_s:
            age_now = (now_s - due_s) / step_s
            for signal, place, held, noise, resolution, bias, delay_s in sensor.channels:
                age = age_now + delay_s / step_s
                back = int(age)
                if back > oldest:
                    back = age = oldest
                value = history[-2 - back][place]
                if not held:
                    newer = history[-1 - back][place]
                    value = newer + (age - back) * (value - newer) + bias + noise * stream.next_normal()
                if resolution > 0.0:
                    value = round(value / resolution) * resolution
                readings.append(SensorReading(signal, due_s, value, name))
            state.nominal_s += sensor.period_s
            state.due_s = due_s = state.nominal_s + jitter_s * stream.next_uniform()


def _channel(signal: str, settings: ChannelSettings) -> Channel:
    return Channel(
        signal=signal,
        place=TRUTH.index(signal),
        held=signal in HELD,
        noise=settings.noise,
        resolution=settings.resolution,
        bias=settings.bias,
        delay_s=settings.delay_s,
    )
