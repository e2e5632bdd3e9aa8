"""Places on the earth as metres on the UTM grid, relative to a datum. Uses the library `utm`."""

from math import atan, pi, radians, sin, tan

from txt1.errors import ConfigError, MissingExtra


class UtmGrid:
    """The UTM grid around a datum (degrees). It stays in the datum's zone, however far a place is.

    Raises MissingExtra without the library, ConfigError for a datum outside all zones.
    """

    def __init__(self, latitude: float, longitude: float) -> None:
        try:
            import utm
        except ImportError:
            raise MissingExtra("a position on the UTM grid", "devices") from None
        self.latitude, self.longitude = latitude, longitude
        self._utm = utm
        try:
            self._east, self._north, self.zone, self.letter = utm.from_latlon(latitude, longitude)
        except ValueError as error:
            raise ConfigError(f"datum {latitude:g}, {longitude:g}: {error}; UTM covers 80 S to 84 N") from None
        # longitude of the zone's middle, degrees
        self._meridian = 6.0 * self.zone - 183.0

    def place(self, latitude: float, longitude: float) -> tuple[float, float]:
        """Return the metres east and north of the datum, for a place in degrees."""
        east, north, _, _ = self._utm.from_latlon(latitude, longitude, self.zone, self.letter)
        return float(east - self._east), float(north - self._north)

    def earth(self, x: float, y: float) -> tuple[float, float]:
        """Return latitude and longitude, degrees, of a place in metres east and north of the datum."""
        latitude, longitude = self._utm.to_latlon(self._east + x, self._north + y, self.zone, self.letter, strict=False)
        return float(latitude), float(longitude)

    def convergence(self, latitude: float, longitude: float) -> float:
        """Return the bearing of grid north, rad clockwise from true north, on a sphere: atan(tan(lon - middle)
        sin(lat)).
        """
        return atan(tan(radians(longitude - self._meridian)) * sin(radians(latitude)))

    def direction(self, track: float, latitude: float, longitude: float) -> float:
        """Return the direction on the grid, rad anticlockwise from east, of a track in degrees clockwise from
        true north.
        """
        return 0.5 * pi - (radians(track) - self.convergence(latitude, longitude))

    def track(self, theta: float, latitude: float, longitude: float) -> float:
        """Return the track, degrees clockwise from true north in [0, 360), of a direction on the grid."""
        return ((0.5 * pi - theta + self.convergence(latitude, longitude)) * 180.0 / pi) % 360.0
