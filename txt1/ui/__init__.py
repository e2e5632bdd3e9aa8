"""The terminal screens: drawing, keyboard driving, and the process that owns the terminal."""
