"""Calibration: a dialogue with the vehicle's operator that finds out how the vehicle is wired and moves."""
