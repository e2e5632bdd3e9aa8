"""The messages between the computer and the board."""
