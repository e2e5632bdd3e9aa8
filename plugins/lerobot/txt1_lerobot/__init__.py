"""Recordings of txt1 as LeRobot datasets."""
