"""Mapping: maps of rooms from a laser's scans, and where the robot is on them."""
