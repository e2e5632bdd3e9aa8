"""Two LiPo packs behind diodes, and the cut-off circuit (thesis 3.6)."""

from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from txt1.model.battery import CUT_OFF_V, FULL_LOAD_SPEED, FULL_LOAD_W, pack_voltage
from txt1.sim.parameters import Batteries, VehicleParameters

# the packs' charge is brought up to date once in so many seconds
SETTLE_PERIOD: Final = 1.0

# a voltage reading is good for so many seconds
NOISE_PERIOD: Final = 1.0


class Packs(NamedTuple):
    """Minutes under full load that each pack has given; None where no pack is fitted.

    The voltages follow from it, so this is the whole state.
    """

    used_1: float | None = 0.0
    used_2: float | None = None

    def voltages(self) -> tuple[float, float]:
        """Voltages of the two packs, V; 0 where none is fitted."""
        return (
            0.0 if self.used_1 is None else pack_voltage(self.used_1),
            0.0 if self.used_2 is None else pack_voltage(self.used_2),
        )


def discharge(packs: Packs, full_load_s: float) -> Packs:
    """The packs after so many seconds of full load, or of a share of it for longer.

    The diodes draw from the pack with the higher voltage, from both alike when they are equal.
    """
    minutes = full_load_s / 60.0
    one, two = packs
    if one is None and two is None:
        return packs
    if two is None or (one is not None and one < two):
        assert one is not None
        return Packs(one + minutes, two)
    if one is None or two < one:
        return Packs(one, two + minutes)
    return Packs(one + minutes / 2.0, two + minutes / 2.0)


def load(batteries: Batteries, v: float, bend: float = 0.0) -> float:
    """Share of the full load that driving at `v` m/s draws, electronics and all; `bend`: curvature, as of full lock.

    A motor draws its torque's heat however slow it turns, work that grows with the speed, and what moves grease and air
    with its square. At 0.5 m/s straight on the thesis's floor it is the full load.
    """
    pace = abs(v) / FULL_LOAD_SPEED
    rolling = 1.0 - batteries.still - batteries.drag
    return batteries.idle_load + _harder(batteries, bend) * (
        batteries.still + rolling * pace + batteries.drag * pace * pace
    )


def _harder(batteries: Batteries, bend: float) -> float:
    return (1.0 - batteries.idle_load) * batteries.floor * (1.0 + batteries.turning * bend * bend)


def energy_per_metre(batteries: Batteries, v: float, bend: float = 0.0) -> float:
    """Consumption at a speed of `v` m/s, J/m."""
    return FULL_LOAD_W * load(batteries, v, bend) / abs(v)


def economical_speed(batteries: Batteries, v_max: float, bend: float = 0.0) -> float:
    """The speed up to `v_max` at which a metre costs least, m/s: slower, the electronics draw for longer.

    (a + b v + c v^2) / v is least at the root of a / c.
    """
    harder = _harder(batteries, bend)
    a, c = batteries.idle_load + harder * batteries.still, harder * batteries.drag
    return v_max if c == 0.0 else min(v_max, FULL_LOAD_SPEED * sqrt(a / c))


def range_left(batteries: Batteries, remaining: float, v_max: float) -> float:
    """Metres that `remaining` seconds under full load are good for, at the economical speed up to `v_max` m/s."""
    v = economical_speed(batteries, v_max)
    return remaining * v / load(batteries, v)


def voltage_share(vehicle: VehicleParameters, voltages: tuple[float, float]) -> float:
    """The motor's voltage, as a share of that with which `speed_gain` holds; 1 without packs.

    The diodes let the pack with the higher voltage through.
    """
    highest = max(voltages)
    return highest / vehicle.voltage if highest and vehicle.voltage else 1.0


class Supply:
    """The packs of a vehicle as they are drained, and the readings of their voltages.

    Args:
        batteries: their charge, and the load of the electronics.
        noise: of a reading, V.
        seed: repeats it.

    """

    def __init__(self, batteries: Batteries, noise: float, seed: np.random.SeedSequence) -> None:
        self.batteries = batteries
        self.packs = Packs(batteries.used_1, batteries.used_2)
        self.voltages = self.packs.voltages()
        """Of the two packs, V; 0 where none is fitted."""
        self.cut_off = False
        """Whether the cut-off circuit has opened: no pack is left above 9.25 V."""
        self.drawn = 0.0
        """Seconds of full load since they were settled."""
        self.settles = 0.0
        """When to `settle` them next, s."""
        self.readings = (0.0, 0.0)
        """Of the two packs' voltages, V, with noise; 0 where no pack is fitted."""
        self.read_until = 0.0
        """When to `read` them anew, s."""
        self._noise, self._rng = noise, np.random.default_rng(seed)
        self._noise_now = (0.0, 0.0)

    def settle(self, now: float, broken: float | None) -> None:
        """Take from the packs what was drawn since the last time; they change too slowly to do it more often.

        `broken`: a faulty converter reads this many V; None is none.
        """
        self.settles = now + SETTLE_PERIOD
        self.packs = discharge(self.packs, self.drawn)
        self.drawn = 0.0
        self.voltages = self.packs.voltages()
        self._keep_readings(broken)
        # without any, the external supply feeds us
        fitted = [voltage for voltage in self.voltages if voltage]
        self.cut_off = bool(fitted) and max(fitted) <= CUT_OFF_V

    def read(self, now: float, broken: float | None) -> None:
        """Take new readings, as often as was due, however seldom somebody looks."""
        while now >= self.read_until:
            one, two = self._rng.standard_normal(2).tolist()
            self._noise_now = one * self._noise, two * self._noise
            self.read_until += NOISE_PERIOD
            self._keep_readings(broken)

    def rewind(self, time: float) -> None:
        """Let the present time be 0, where another run begins."""
        self.settles -= time
        self.read_until -= time

    def _keep_readings(self, broken: float | None) -> None:
        """Keep them: they are looked at 61 times a second and change once, with voltages and noise."""
        (one, two), (noise_one, noise_two) = self.voltages, self._noise_now
        if broken is not None:
            one, two = (broken if one else 0.0), (broken if two else 0.0)
        self.readings = (one + noise_one if one else 0.0), (two + noise_two if two else 0.0)
