"""Telemetry: the table of topics, their ROS messages, and the bus that carries their values."""
