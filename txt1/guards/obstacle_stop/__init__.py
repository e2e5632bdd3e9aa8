"""The obstacle stop: the laser's say in the safety gate."""
