"""The roll-over guard: the IMU's say in the safety gate."""
