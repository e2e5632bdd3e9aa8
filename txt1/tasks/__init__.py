"""The robot's tasks, as the board ran them, and the state they share."""
