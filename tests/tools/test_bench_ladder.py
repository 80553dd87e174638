"""tools/bench ladder: the demo is driven with the model before an effect was added and with the one after."""

import json
import math
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_both_models_drive_and_the_fit_is_better_with_the_effect(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT))
    measured = import_module("tools.benchmarks.ladder").measure(seeds=(0,), recorded_s=240.0, demo_s=42.0)
    json.dumps(measured.as_json(), allow_nan=False)
    found = {figure.key: figure.value for figure in measured.figures}
    assert all(math.isfinite(value) for value in found.values())
    assert found["model_error_after_mps"] < 0.8 * found["model_error_before_mps"]
    assert found["rms_error_before_mps"] != found["rms_error_after_mps"]
