"""An R/C car on a Raspberry Pi: its HAL, the guard of its outputs, and a virtual bus."""
