"""Calibration: a dialogue with the operator that finds the vehicle's wiring and its motion."""
