"""Cruise control for combine harvesters: learn the drive while driving, drive with what was learned."""
