"""The far ends of our drivers' lines: devices on the desk that behave as the real ones do."""
