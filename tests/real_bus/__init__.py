"""Tests on a kernel's own CAN bus, CRUISE_VCAN: `tools/vcan_machine .venv/bin/pytest tests/real_bus` gives one."""
