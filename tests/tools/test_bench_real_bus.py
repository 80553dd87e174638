"""What tools/bench shows of a real bus: every figure that the tests there keep, and a share of the processor."""

import re
from pathlib import Path

from tools.benchmarks import real_bus

TESTS = Path(__file__).parents[1] / "real_bus"


def test_every_figure_that_is_shown_is_kept_by_a_test():
    """By name only: the tests themselves need a bus. In braces stands what they fill in."""
    text = "".join(file.read_text(encoding="utf-8") for file in TESTS.rglob("test_*.py"))
    patterns = [
        re.sub(r"\\\{.*?\\\}", "[a-z0-9_]+", re.escape(name)) for name in re.findall(r'note\(f?"([^"]+)"', text)
    ]
    shown = [key for key, *_ in real_bus.ON_THE_BUS] + [
        f"{who}_{name}" for who in ("drive", "demo") for name in real_bus.DRIVE
    ]
    assert patterns
    assert [key for key in shown if not any(re.fullmatch(pattern, key) for pattern in patterns)] == []


def test_the_node_takes_a_small_share_of_a_core():
    assert 0.0 < real_bus.share(10.0) < 0.5
