"""Gamepads: the process that reads them, the meaning of their buttons and axes, and the command that shows them."""
