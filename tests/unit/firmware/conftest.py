"""Puts the firmware's package where the tests find it."""

import sys
from pathlib import Path

PICO = Path(__file__).parents[3] / "firmware" / "pico"
sys.path.insert(0, str(PICO))
