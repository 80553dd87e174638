"""Poles of a drive in a slow gear and in a fast one, over the frames in which an observer sees it."""

POLE, FRAME_S = 0.8, 0.05
HIGH_POLE, HIGH_PACE = 0.97, 0.15  # fourth gear
