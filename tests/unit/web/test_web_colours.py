"""What the page's map tells by colour, the colour-blind tell apart, too."""

from __future__ import annotations

import re
from itertools import combinations
from math import dist
from pathlib import Path

import numpy as np
import pytest

import txt1.web

STATIC = Path(txt1.web.__file__).parent / "static"
DRAWN = ("path", "robot", "other", "light", "goal", "scan")
APART = 25.0  # CIELAB; 2 is the least that an eye notices
CONTRAST = 3.0  # to the ground, as WCAG 2.2 (1.4.11) asks
CONTRAST_OF_THE_LIGHT = 2.0  # it is large and has rays
EYES = {  # linear RGB to linear RGB; Machado, Oliveira and Fernandes 2009, table 1, severity 1.0
    "trichromat": np.eye(3),
    "protanope": np.array([
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ]),
    "deuteranope": np.array([
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]),
    "tritanope": np.array([
        [1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ]),
}  # fmt: skip


def linear(colour: str) -> np.ndarray:
    """Of #rrggbb; sRGB."""
    value = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(light: np.ndarray) -> tuple[float, float, float]:
    """CIELAB of linear RGB, D65."""
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ light.clip(
        0.0, 1.0
    )
    f = [t ** (1 / 3) if t > 0.008856 else 7.787 * t + 16 / 116 for t in xyz / (0.9505, 1.0, 1.089)]
    return 116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])


def luminance(colour: str) -> float:
    return float(np.array([0.2126, 0.7152, 0.0722]) @ linear(colour))


def schemes() -> list[dict[str, str]]:
    """The light one, and the dark one by the system's wish and by the button."""
    blocks = re.findall(r":root[^{]*\{([^}]*)\}", (STATIC / "style.css").read_text())
    return [dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6});", block)) for block in blocks]


def test_the_dark_colours_are_the_same_by_wish_and_by_button() -> None:
    _, wished, pressed = schemes()
    assert wished == pressed


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_colours_are_told_apart_by_all_eyes_and_from_the_ground(scheme: int) -> None:
    colours = schemes()[scheme]
    for eye, sees in EYES.items():
        for one, other in combinations(DRAWN, 2):
            apart = dist(lab(sees @ linear(colours[one])), lab(sees @ linear(colours[other])))
            assert apart > APART, f"{eye}: {one} and {other}"
    for name in DRAWN:
        low, high = sorted((luminance(colours[name]), luminance(colours["card"])))
        assert (high + 0.05) / (low + 0.05) >= (CONTRAST_OF_THE_LIGHT if name == "light" else CONTRAST), name
