"""Kinds of car, a folder each: the driver, its double, its command. Each is an addition."""
