"""The bus: frames, their meaning and their protection, logs of them, and the CANopen node.

The only place that imports python-can, cantools, canopen and autosar-e2e. python-can imports asammdf wherever that is
installed, and with it pandas: up to a second of every start, for one format of logs. It is hidden from it here
until `log.py` reads such a log.
"""

import importlib
import sys
from typing import cast

if "asammdf" not in sys.modules:
    modules = cast("dict[str, object]", sys.modules)
    modules["asammdf"] = None  # an import of what is None here fails, as Python's reference has it
    try:
        importlib.import_module("can")
    finally:
        del modules["asammdf"]
