"""The roll-over guard: a guard of the safety gate with an IMU."""
