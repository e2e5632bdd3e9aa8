"""Everything the robot tells: one table of topics, the messages they become, and the bus that carries them."""
