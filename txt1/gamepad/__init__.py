"""Gamepads: a process that looks at them, the meaning of their buttons and axes, and the command that shows them."""
