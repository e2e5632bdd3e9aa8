"""A Raspberry Pi Pico as the board: a double that runs our firmware, and the installer of the firmware."""
