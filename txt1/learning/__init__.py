"""Learning to find the light (thesis 5): what the four sensors tell, how to act on it, and what to remember."""
