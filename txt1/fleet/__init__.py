"""Several robots as a team: in one world, over a network, and the laws by which they cooperate."""
