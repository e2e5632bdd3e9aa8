"""Draws docs/firmware-wiring.svg from the firmware's default pins: `python firmware/draw_wiring.py`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

HERE: Final = Path(__file__).parent
FILE: Final = HERE.parent / "docs" / "firmware-wiring.svg"
ROW: Final = 34
LEFT, RIGHT, WIDTH = 250, 430, 860

PARTS: Final = (
    ("motor_pin", "ESC, signal wire (white or orange)"),
    ("front_pin", "front steering servo, signal"),
    ("rear_pin", "rear steering servo, signal"),
    ("pwm4_pin", "free servo 4, signal"),
    ("pwm5_pin", "free servo 5, signal"),
    ("right_pin", "right encoder A; B on the next pin"),
    ("left_pin", "left encoder A; B on the next pin"),
    ("battery1_pin", "middle of the divider 38 kOhm : 10 kOhm over the pack"),
    ("atx_pin", "MOSFET or relay of the 5 V supply"),
    ("esc_pin", "MOSFET or relay in the ESC's supply"),
    ("buzzer_pin", "active buzzer, by a transistor"),
    ("receive_led_pin", "LED with 1 kOhm: receive"),
    ("transmit_led_pin", "LED with 1 kOhm: transmit"),
)
POWER: Final = (
    ("VSYS", "5 V of the ESC's BEC or of a regulator, by a Schottky diode"),
    ("GND", "common ground: pack, ESC, servos, encoders, Pico"),
    ("3V3", "encoders, if they are 3.3 V types"),
)


def drawing(pins: dict[str, Any]) -> str:
    """Return the drawing as SVG, for settings as `txt1pico.store.DEFAULTS` has them."""
    rows = [(f"GP{pins[name]}", about, "#0072b2") for name, about in PARTS]
    rows += [(name, about, "#d55e00") for name, about in POWER]
    height = ROW * (len(rows) + 2)
    out = [
        '<svg xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="14" '
        f'viewBox="0 0 {WIDTH} {height}">',
        "<title>Raspberry Pi Pico: which pin goes where</title>",
        f'<rect width="{WIDTH}" height="{height}" fill="white"/>',
        f'<rect x="60" y="{ROW}" width="{LEFT - 60}" height="{height - ROW - 12}" rx="10" '
        'fill="#e8f2ea" stroke="#333"/>',
        f'<text x="{(60 + LEFT) // 2}" y="{ROW + 22}" text-anchor="middle" font-weight="bold">Raspberry Pi Pico</text>',
    ]
    for k, (pin, about, colour) in enumerate(rows):
        y = ROW * (k + 2) + 8
        out += [
            f'<circle cx="{LEFT}" cy="{y}" r="6" fill="{colour}"/>',
            f'<text x="{LEFT - 14}" y="{y + 5}" text-anchor="end">{pin}</text>',
            f'<line x1="{LEFT}" y1="{y}" x2="{RIGHT - 100}" y2="{y}" stroke="{colour}" stroke-width="2"/>',
            f'<text x="{RIGHT - 92}" y="{y + 5}">{about}</text>',
        ]
    return "\n".join([*out, "</svg>"]) + "\n"


if __name__ == "__main__":
    sys.path.insert(0, str(HERE / "pico"))
    from txt1pico.store import DEFAULTS

    FILE.write_text(drawing(DEFAULTS))
