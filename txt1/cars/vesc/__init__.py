"""A VESC that drives a car: its HAL and its double."""
