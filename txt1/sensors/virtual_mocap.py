"""A virtual motion capture system: a VRPN server that tracks a subject, in millimetres like Vicon's."""

from txt1.errors import HalError
from txt1.link.base import Link
from txt1.sensors import vrpn_protocol
from txt1.sensors.base import Reading
from txt1.sensors.mocap_vrpn import MILLIMETRE
from txt1.sensors.readings import TrackerReading
from txt1.sensors.virtual_sensor import VirtualSensor

# the server's numbers for the subject, for the types, and for itself
SENDER, POSE, PONG, CONTROL = 1, 1, 2, 0


class VirtualVicon(VirtualSensor):
    """The server's end of a connection."""

    def __init__(self, subject: str = "txt01") -> None:
        super().__init__()
        self._subject = subject
        self._splitter: vrpn_protocol.Splitter | None = None
        self._names = vrpn_protocol.Names()

    def connected(self, link: Link) -> None:
        """Greet a client, and send it the names of the numbers."""
        self._splitter, self._names = vrpn_protocol.Splitter(), vrpn_protocol.Names()
        super().connected(link)
        names = (
            (vrpn_protocol.SENDER_NAME, CONTROL, "VRPN Control"),
            (vrpn_protocol.SENDER_NAME, SENDER, self._subject),
            (vrpn_protocol.TYPE_NAME, POSE, vrpn_protocol.POSE_TYPE),
            (vrpn_protocol.TYPE_NAME, PONG, vrpn_protocol.PONG_TYPE),
        )
        self.send(
            vrpn_protocol.COOKIE + b"".join(vrpn_protocol.pack(vrpn_protocol.name_message(*each)) for each in names)
        )

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
            if self._names.note(message) or self._names.types.get(message.type) != vrpn_protocol.PING_TYPE:
                continue
            if self._names.senders.get(message.sender) == self._subject:
                self.send(vrpn_protocol.pack(vrpn_protocol.VrpnMessage(message.time, SENDER, PONG, b"")))

    def show(self, reading: Reading[TrackerReading]) -> None:
        """Send a pose."""
        value = reading.value
        place = (each / MILLIMETRE for each in (value.x, value.y, value.z))
        body = vrpn_protocol.POSE.pack(0, 0, *place, *value.orientation)
        self.send(vrpn_protocol.pack(vrpn_protocol.VrpnMessage(reading.time, SENDER, POSE, body)))
