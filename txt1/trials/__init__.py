"""Many trials: their order, their processes or cluster, their results as they come, how they end and resume."""
