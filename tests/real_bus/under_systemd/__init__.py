"""Tests with systemd as process 1: `tools/vcan_machine --systemd .venv/bin/pytest tests/real_bus/under_systemd`."""
