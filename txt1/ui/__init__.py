"""The terminal screens: pure drawing, keyboard driving, and the process that owns the terminal."""
