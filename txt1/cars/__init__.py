"""Kinds of car, a folder each: the driver, the virtual device, the command. Each is an addition."""
