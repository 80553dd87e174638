"""The bus: frames, their meaning and their protection, logs of them, and the CANopen node.

The only place that imports python-can, cantools, canopen and autosar-e2e.
"""
