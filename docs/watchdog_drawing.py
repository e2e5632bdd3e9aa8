"""Draws docs/hal-pi-watchdog.svg, the watchdog of a servo board's outputs: `python -m docs.watchdog_drawing`."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from txt1.cars.pi.virtual_pi import MONOSTABLE_TIME

FILE: Final = Path(__file__).parent / "hal-pi-watchdog.svg"
FACTOR: Final = 0.5
"""Width of a 74HC123's pulse over R C, at 3.3 V; data sheets say 0.48 at 2 V and 0.55 at 5 V (Philips, 1998)."""
CAPACITOR: Final = 2.2e-6  # F
BLUE, RED, BLACK = "#0072b2", "#d55e00", "#333"
BOXES: Final = (
    (30, 70, 150, 270, "Raspberry Pi"), (300, 70, 190, 270, "74HC123, one half"), (640, 70, 190, 270, "PCA9685 board"),
)  # fmt: skip
PINS: Final = (
    (180, 120, "end", "3.3 V (pin 1)"), (180, 220, "end", "GPIO 22 (pin 15)"), (180, 310, "end", "GND (pin 6)"),
    (300, 120, "start", "VCC, clear"), (300, 220, "start", "B"), (300, 310, "start", "GND, A"),
    (490, 220, "end", "Q inverted"), (490, 120, "end", "R/C"), (490, 160, "end", "C"),
    (640, 120, "start", "VCC"), (640, 220, "start", "OE (low: on)"), (640, 310, "start", "GND"),
)  # fmt: skip
WIRES: Final = (
    (RED, "180,120 300,120"),
    (BLUE, "180,220 300,220"),
    (BLACK, "180,310 300,310"),
    (BLUE, "490,220 640,220"),
    (RED, "240,120 240,44 610,44 610,120 640,120"),
    (BLACK, "240,310 240,366 600,366 600,310 640,310"),
    (BLACK, "490,120 530,120 530,160 490,160"),
    (RED, "530,120 530,44"),
)


def drawing() -> str:
    """Return the drawing as SVG."""
    resistor = MONOSTABLE_TIME / (FACTOR * CAPACITOR)
    out = [
        '<svg xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="14" viewBox="0 0 860 440">',
        "<title>A watchdog on the output-enable pin of a servo board</title>",
        '<rect width="860" height="440" fill="white"/>',
    ]
    for x, y, width, height, name in BOXES:
        out += [
            f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="10" fill="#e8f2ea" stroke="{BLACK}"/>',
            f'<text x="{x + width // 2}" y="{y + 22}" text-anchor="middle" font-weight="bold">{name}</text>',
        ]
    out += [f'<polyline points="{way}" fill="none" stroke="{colour}" stroke-width="2"/>' for colour, way in WIRES]
    for x, y, anchor, name in PINS:
        away = x - 12 if anchor == "end" else x + 12
        out += [
            f'<circle cx="{x}" cy="{y}" r="5" fill="{BLACK}"/>',
            f'<text x="{away}" y="{y + 5}" text-anchor="{anchor}">{name}</text>',
        ]
    # resistor and capacitor lie across their wires
    out += [
        f'<rect x="523" y="66" width="14" height="36" fill="white" stroke="{BLACK}" stroke-width="2"/>',
        f'<text x="544" y="90">{resistor / 1e3:.0f} kOhm</text>',
        '<rect x="524" y="136" width="12" height="8" fill="white"/>',
        f'<path d="M518 136 H542 M518 144 H542" stroke="{BLACK}" stroke-width="2"/>',
        f'<text x="548" y="145">{CAPACITOR * 1e6:g} uF</text>',
        '<text x="30" y="396">A rising edge at B holds the inverted output low for about '
        f"{MONOSTABLE_TIME:g} s (R C times {FACTOR:g}), and each further edge begins that anew.</text>",
        '<text x="30" y="420">The guard makes 25 edges a second. Without them, or stuck at a level, OE goes high: '
        "no pulse comes out.</text>",
        "</svg>",
    ]
    return "\n".join(out) + "\n"


if __name__ == "__main__":
    FILE.write_text(drawing())
