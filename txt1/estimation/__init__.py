"""Where the robot is and how it moves, from all its sensors together."""
