"""A VESC that drives a car: its HAL and a virtual VESC."""
