"""A kernel with CAN for every machine: the one at hand, or Debian's in a virtual machine that sees the same files."""

import os
import sys

# On a bus the program runs as installed: without the extras, one of which python-can would load.
if "CRUISE_VCAN" in os.environ:
    sys.modules.setdefault("asammdf", None)  # pyright: ignore[reportArgumentType]
