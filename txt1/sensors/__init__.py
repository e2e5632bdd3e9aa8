"""Sensors that are not part of the hardware layer: each has a name, a period, and readings with time stamps."""

from txt1.sensors.base import Reading, Sensor, Setup, reading_topic

__all__ = ["Reading", "Sensor", "Setup", "reading_topic"]
