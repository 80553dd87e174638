"""Tests on a kernel's own CAN bus, CRUISE_VCAN: `tools/vcan_machine .venv/bin/pytest tests/real_bus` gives one."""

import os
import sys

if "CRUISE_VCAN" in os.environ:  # as installed: without the extras, which python-can would load
    sys.modules.setdefault("asammdf", None)  # pyright: ignore[reportArgumentType]
