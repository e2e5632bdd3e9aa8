"""How the state changes by itself, and how much of that is slip, which turns tell."""

from math import inf
from typing import Final

from txt1.estimation.ekf import Drift, State

# turns over which the walk of the slip is averaged
MEMORY: Final = 5
# standard deviation of a slip that has changed
SLID: Final = 0.1
# s without a reading of the place, after which slip walks further: the time of so many readings, within these bounds
BLIND_READINGS: Final = 5
BLIND_LEAST: Final = 0.1
BLIND_MOST: Final = 0.5
# m/s by which a speed that nothing tells changes in a second; chosen
SPEED_WALK: Final = 0.5


class Walk:
    """The spectral densities of the state's random walks.

    Args:
        drift: of the state by itself.
        slip_sigma: standard deviation of the wheels' slip before anything is known of it.
        exact: the track width is known, so that turns tell of slip; else they tell of that width.

    """

    def __init__(self, drift: Drift, slip_sigma: float, *, exact: bool) -> None:
        self.slip_sigma = slip_sigma
        self._exact = exact
        x, y, theta, rolled, omega, bias, slip, width = drift.density()
        self._least: State = x, y, theta, rolled, omega, bias, slip, 0.0 if exact else width
        # much, until turns tell otherwise
        self._slips = slip_sigma**2
        self.told = self._with(self._slips)
        """The variances that a second adds, with slip as turns have told of it."""
        self.blind = self._with(SLID**2)
        """The same when no sensor tells the place any more: while one did, the slip was followed before a turn was
        over, so turns have told too little."""
        self.blind_from = inf
        """s of the run, from when on no sensor has told the place for too long."""

    def _with(self, slips: float, widths: float = 0.0) -> State:
        x, y, theta, rolled, omega, bias, usual, width = self._least
        widths = 0.0 if self._exact else max(width, widths)
        return x, y, theta, rolled, omega, bias, max(usual, slips), widths

    def placed(self, time: float, before: float | None) -> None:
        """Note that a sensor has told the place at a time, s of the run, and before."""
        waits = BLIND_READINGS * (time - before) if before is not None else BLIND_MOST
        waits = waits if waits > BLIND_LEAST else BLIND_LEAST
        self.blind_from = time + (waits if waits < BLIND_MOST else BLIND_MOST)

    def untold(self, density: State) -> State:
        """These densities when nothing tells how fast the wheels turn."""
        x, y, theta, _, omega, bias, slip, width = density
        return x, y, theta, SPEED_WALK**2, omega, bias, slip, width

    def settled(self, variance: float) -> State:
        """The densities when nothing tells of the slip that lasts, of which so much is unknown.

        It walks until it is as uncertain as at first; while a sensor told the place, it was known better.
        """
        x, y, theta, rolled, omega, bias, usual, width = self._least if self._exact else self.blind
        return x, y, theta, rolled, omega, bias, usual * max(0.0, 1.0 - variance / self.slip_sigma**2), width

    def changed(self, square: float, dt: float) -> None:
        """Adapt the slip's walk to a turn: the square of its change in dt seconds.

        Covariance matching (A. H. Mohamed and K. P. Schwarz): the excess of the innovation's square over its
        expectation is added to the expectation.
        """
        self._slips += (min(max(square, 0.0), SLID * SLID) / dt - self._slips) / MEMORY
        self.told = self._with(self._slips, self._slips)
