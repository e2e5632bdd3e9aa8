"""A Raspberry Pi Pico as the board: a virtual Pico that runs txt1's firmware, and the firmware's installer."""
