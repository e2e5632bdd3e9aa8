"""Two LiPo packs behind diodes, and the cut-off circuit (thesis 3.6)."""

from math import sqrt
from random import Random
from typing import Final, NamedTuple

from txt1.model.battery import CUT_OFF_V, FULL_LOAD_SPEED, FULL_LOAD_W, OVERVOLTAGE_V, pack_voltage
from txt1.sim.parameters import Batteries, VehicleParameters

# s between two updates of the packs' charge
SETTLE_PERIOD: Final = 1.0

# s for which a voltage reading is valid
NOISE_PERIOD: Final = 1.0


class Packs(NamedTuple):
    """Minutes under full load that each pack has given; None for a pack that is not connected.

    The voltages follow from it, so this is the whole state.
    """

    used_1: float | None = 0.0
    used_2: float | None = None

    def voltages(self) -> tuple[float, float]:
        """Return the voltages of the two packs, V; 0 for a pack that is not connected."""
        return (
            0.0 if self.used_1 is None else pack_voltage(self.used_1),
            0.0 if self.used_2 is None else pack_voltage(self.used_2),
        )


def discharge(packs: Packs, full_load_s: float) -> Packs:
    """Return the packs after `full_load_s` seconds of full load, or of a share of it for longer.

    The diodes draw from the pack with the higher voltage; from both equally at equal voltages.
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
    """Return the share of the full load that driving at `v` m/s draws, with the electronics; `bend`: curvature,
    as of full lock.

    A motor's load has three parts: the heat of its torque, at any speed; work, which grows with the speed; and losses
    in grease and air, which grow with its square. At 0.5 m/s straight on the thesis's floor the sum is the full load.
    """
    pace = abs(v) / FULL_LOAD_SPEED
    rolling = 1.0 - batteries.still - batteries.drag
    return batteries.idle_load + _harder(batteries, bend) * (
        batteries.still + rolling * pace + batteries.drag * pace * pace
    )


def _harder(batteries: Batteries, bend: float) -> float:
    return (1.0 - batteries.idle_load) * batteries.floor * (1.0 + batteries.turning * bend * bend)


def energy_per_metre(batteries: Batteries, v: float, bend: float = 0.0) -> float:
    """Return the energy per distance at a speed of `v` m/s, J/m."""
    return FULL_LOAD_W * load(batteries, v, bend) / abs(v)


def economical_speed(batteries: Batteries, v_max: float, bend: float = 0.0) -> float:
    """Return the speed up to `v_max` with the least energy per metre, m/s: at lower speeds the electronics draw
    for longer.

    (a + b v + c v^2) / v is least at the root of a / c.
    """
    harder = _harder(batteries, bend)
    a, c = batteries.idle_load + harder * batteries.still, harder * batteries.drag
    return v_max if c == 0.0 else min(v_max, FULL_LOAD_SPEED * sqrt(a / c))


def range_left(batteries: Batteries, remaining: float, v_max: float) -> float:
    """Return the distance in m for `remaining` seconds under full load, at the economical speed up to `v_max` m/s."""
    v = economical_speed(batteries, v_max)
    return remaining * v / load(batteries, v)


def voltage_share(vehicle: VehicleParameters, voltage: float) -> float:
    """Return `voltage` as a share of the voltage for which `speed_gain` holds; 1 if either is 0, unknown."""
    return voltage / vehicle.voltage if voltage and vehicle.voltage else 1.0


class Supply:
    """The packs of a vehicle while they are drained, and the readings of their voltages.

    Args:
        batteries: their charge, and the load of the electronics.
        noise: standard deviation of a reading, V.
        rng: draws the noise.

    """

    def __init__(self, batteries: Batteries, noise: float, rng: Random) -> None:
        self.batteries = batteries
        self.packs = Packs(batteries.used_1, batteries.used_2)
        self.voltages = self.packs.voltages()
        """Voltages of the two packs, V; 0 for a pack that is not connected."""
        self.voltage = max(*self.voltages, batteries.external or 0.0)
        """Voltage behind the diodes, V; 0: an external supply of an unknown voltage feeds a robot without packs."""
        self.cut_off = False
        """Whether the cut-off circuit has opened, as this voltage is not between 9.25 and 14 V."""
        self.drawn = 0.0
        """Seconds of full load since the last `settle`."""
        self.settles = 0.0
        """Time of the next `settle`, s."""
        self.readings = (0.0, 0.0)
        """Readings of the two packs' voltages, V, with noise; 0 for a pack that is not connected."""
        self.read_until = 0.0
        """Time of the next `read`, s."""
        self._noise, self._rng = noise, rng
        self._noise_now = (0.0, 0.0)

    def settle(self, now: float, broken: float | None) -> None:
        """Discharge the packs by the load since the last call. They change too slowly for more calls.

        `broken`: reading of a faulty converter, V; None for an intact converter.
        """
        self.settles = now + SETTLE_PERIOD
        if self.voltage in self.voltages:
            self.packs = discharge(self.packs, self.drawn)
        self.drawn = 0.0
        self.voltages = self.packs.voltages()
        self.voltage = max(*self.voltages, self.batteries.external or 0.0)
        self._keep_readings(broken)
        self.cut_off = self.voltage != 0.0 and not CUT_OFF_V < self.voltage <= OVERVOLTAGE_V

    def read(self, now: float, broken: float | None) -> None:
        """Take new readings, as many as were due since the last call."""
        while now >= self.read_until:
            self._noise_now = self._noise * self._rng.gauss(), self._noise * self._rng.gauss()
            self.read_until += NOISE_PERIOD
            self._keep_readings(broken)

    def rewind(self, time: float) -> None:
        """Set the present time to 0, for another run."""
        self.settles -= time
        self.read_until -= time

    def _keep_readings(self, broken: float | None) -> None:
        """Store the readings: they are used 61 times a second and change once, with voltages and noise."""
        (one, two), (noise_one, noise_two) = self.voltages, self._noise_now
        if broken is not None:
            one, two = (broken if one else 0.0), (broken if two else 0.0)
        self.readings = (one + noise_one if one else 0.0), (two + noise_two if two else 0.0)
