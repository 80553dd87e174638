"""What a column may be by its name alone."""

import pytest

from cruise.signals import CONTEXT
from cruise.usual_names import guessed


@pytest.mark.parametrize(
    ("column", "signal"),
    [
        ("EngSpeed [rpm]", "engine_speed_rpm"),
        ("EngLoad", "engine_load_pct"),
        ("T_oil [degC]", "oil_temperature_c"),
        ("WheelBasedSpeed", "wheel_speed_mps"),
        ("HST_Pressure", "line_pressure_bar"),
        ("header_height", ""),
    ],
)
def test_what_a_column_may_be_by_its_name(column, signal):
    assert guessed([column], [*CONTEXT]).get(column, "") == signal
