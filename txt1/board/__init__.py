"""The virtual board: a simulated vehicle behind a line, with txt1's firmware or as a board of 2011, and its command."""
