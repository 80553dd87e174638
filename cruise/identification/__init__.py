"""Offline: from whole recordings to models."""
