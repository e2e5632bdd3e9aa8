"""Mapping: maps of rooms from a laser's scans, and the robot's pose on them."""
