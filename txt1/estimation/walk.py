"""How the state changes by itself, and how much of that is slip, which turns tell."""

from typing import Final

from txt1.estimation.ekf import Drift, Seven

# turns over which the walk of the slip is averaged
MEMORY: Final = 5
# standard deviation of a slip that has changed
SLID: Final = 0.1


class Walk:
    """The spectral densities of the state's random walks.

    Args:
        drift: of the state by itself.
        slip_sigma: standard deviation of the wheels' slip before anything is known of it.

    """

    def __init__(self, drift: Drift, slip_sigma: float) -> None:
        self.slip_sigma = slip_sigma
        self._least: Seven = drift.density()
        # much, until turns tell otherwise
        self._slips = slip_sigma**2
        self.told = self._with(self._slips)
        """The variances that a second adds, with slip as turns have told of it."""
        self.blind = self._with(SLID**2)
        """The same when no sensor tells the place any more: while one did, the slip was followed before a turn was
        over, so turns have told too little."""

    def _with(self, slips: float) -> Seven:
        x, y, theta, rolled, omega, bias, usual = self._least
        return x, y, theta, rolled, omega, bias, max(usual, slips)

    def settled(self, variance: float) -> Seven:
        """The densities when nothing tells of the slip that lasts, of which so much is unknown.

        It walks until it is as uncertain as at first.
        """
        x, y, theta, rolled, omega, bias, usual = self._least
        return x, y, theta, rolled, omega, bias, usual * max(0.0, 1.0 - variance / self.slip_sigma**2)

    def changed(self, square: float, dt: float) -> None:
        """Adapt the slip's walk to a turn: the square of its change in dt seconds.

        Covariance matching (A. H. Mohamed and K. P. Schwarz): the excess of the innovation's square over its
        expectation is added to the expectation.
        """
        self._slips += (min(max(square, 0.0), SLID * SLID) / dt - self._slips) / MEMORY
        self.told = self._with(self._slips)
