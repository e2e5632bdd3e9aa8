"""Sensors beside those of the hardware layer: each a name, a period and readings with time stamps of their own."""

from txt1.sensors.base import Reading, Sensor, Setup, reading_topic

__all__ = ["Reading", "Sensor", "Setup", "reading_topic"]
