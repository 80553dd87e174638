"""The bus: frames, their meaning and their protection, logs of them, and the CANopen node.

The only place that imports python-can, cantools, canopen and autosar-e2e. python-can imports asammdf wherever that is
installed, and with it pandas: up to a second of every start, for one format of logs. It is hidden from it here
until `log.py` reads such a log.
"""

import sys

if "asammdf" not in sys.modules:
    sys.modules["asammdf"] = None  # type: ignore[assignment]  # documented: an import of it fails
    try:
        import can  # noqa: F401
    finally:
        del sys.modules["asammdf"]
