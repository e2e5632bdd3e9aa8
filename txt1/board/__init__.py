"""The virtual board: the simulated vehicle behind a line, as ours or as those of 2011, and the command that is one."""
