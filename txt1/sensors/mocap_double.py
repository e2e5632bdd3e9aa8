"""A virtual motion capture system: a VRPN server that tracks a subject, in millimetres like Vicon's."""

from txt1.errors import HalError
from txt1.link.base import Link
from txt1.sensors import vrpn
from txt1.sensors.base import Reading
from txt1.sensors.double import Double
from txt1.sensors.mocap_vrpn import MILLIMETRE
from txt1.sensors.readings import TrackerReading

# the server's numbers for the subject, for the types, and for itself
SENDER, POSE, PONG, CONTROL = 1, 1, 2, 0


class FakeVicon(Double):
    """The server's end of a connection."""

    def __init__(self, subject: str = "txt01") -> None:
        super().__init__()
        self._subject = subject
        self._splitter: vrpn.Splitter | None = None
        self._names = vrpn.Names()

    def connected(self, link: Link) -> None:
        """Greet a client, and send it the names of the numbers."""
        self._splitter, self._names = vrpn.Splitter(), vrpn.Names()
        super().connected(link)
        names = (
            (vrpn.SENDER_NAME, CONTROL, "VRPN Control"),
            (vrpn.SENDER_NAME, SENDER, self._subject),
            (vrpn.TYPE_NAME, POSE, vrpn.POSE_TYPE),
            (vrpn.TYPE_NAME, PONG, vrpn.PONG_TYPE),
        )
        self.send(vrpn.COOKIE + b"".join(vrpn.pack(vrpn.name_message(*each)) for each in names))

    def received(self, data: bytes) -> None:
        """Answer pings; a client that does not speak VRPN is ignored."""
        if self._splitter is None:
            return
        try:
            messages = self._splitter.feed(data)
        except HalError:
            self._splitter = None
            return
        for message in messages:
            if self._names.note(message) or self._names.types.get(message.type) != vrpn.PING_TYPE:
                continue
            if self._names.senders.get(message.sender) == self._subject:
                self.send(vrpn.pack(vrpn.VrpnMessage(message.time, SENDER, PONG, b"")))

    def show(self, reading: Reading[TrackerReading]) -> None:
        """Send a pose."""
        value = reading.value
        place = (each / MILLIMETRE for each in (value.x, value.y, value.z))
        body = vrpn.POSE.pack(0, 0, *place, *value.orientation)
        self.send(vrpn.pack(vrpn.VrpnMessage(reading.time, SENDER, POSE, body)))
