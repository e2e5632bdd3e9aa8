"""The live view: the topics of a recording over the Foxglove protocol, and driving from its teleop panel."""

import asyncio
import json
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from threading import Thread
from typing import Any, Final

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, ClientChannel, ServerListener

from txt1.commands import is_loopback
from txt1.control.hand import Hand
from txt1.errors import CommandRefused, ConfigError
from txt1.kernel.clock import RealClock, seconds
from txt1.record.mcap_records import Block
from txt1.tasks.fields import LOG
from txt1.tasks.inputs import COMMAND
from txt1.telemetry.bus import Bus
from txt1.telemetry.messages import schema_name, schema_text
from txt1.telemetry.topics import Rule, Topic

# lines of the event log that a client who comes late is told
LATEST: Final = 20
# s that the server has to let go of its clients
STOPS: Final = 1.0

Drive = Callable[[float, float, float], object]
"""Takes a speed (m/s), a yaw rate (rad/s) and how long ago a client's message with them came, s."""

# clients know nothing of virtual time
_CLOCK: Final = RealClock()


class LiveView:
    """A sink that serves every block to whoever is connected; with `control` clients may drive.

    `host` has to be a loopback address, as the protocol has neither a password nor encryption; `port` is 0 for any that
    is free. Raises ConfigError: the address is not a loopback one, or cannot be listened on.
    """

    def __init__(self, host: str, port: int, *, control: bool) -> None:
        if not is_loopback(host):
            raise ConfigError(
                f"--view {host}: not a loopback address, and the whole network could watch and drive; use 127.0.0.1, "
                "and from elsewhere 'ssh -L 8765:127.0.0.1:8765 ROBOT', or the web page (--web)"
            )
        # kept: its channels close when it goes
        self._context = context = foxglove.Context()
        # with the latest messages
        self._channels: dict[str, tuple[foxglove.Channel, deque[tuple[int, bytes]]]] = {}
        self._listener = _Listener()
        try:
            self._server = foxglove.start_server(
                name="txt1",
                host=host,
                port=port,
                capabilities=[Capability.ClientPublish] if control else [],
                supported_encodings=["json"] if control else None,
                server_listener=self._listener,
                context=context,
            )
        except RuntimeError as error:
            raise ConfigError(f"--view {host}:{port}: cannot listen there: {error}; choose another port") from None
        port = self._server.port
        self.address = f"ws://[{host}]:{port}" if ":" in host else f"ws://{host}:{port}"

    def drive(self, drive: Drive, hand: Hand) -> None:
        """Hand the velocities that clients ask for to `drive`, in the loop that is running now.

        A turn alone is driven as the car can, which `hand` knows.
        """
        loop = asyncio.get_running_loop()

        def drive_or_turn(v: float, omega: float, received_ns: int) -> None:
            # counted by the safety gate
            with suppress(CommandRefused):
                drive(*hand.on_the_spot(v, omega), seconds(_CLOCK.now_ns() - received_ns))

        def asked(v: float, omega: float) -> None:
            # the loop has just been closed
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(drive_or_turn, v, omega, _CLOCK.now_ns())

        self._listener.asked = asked

    def write(self, block: Block) -> int:
        """Send a block; a client that is too slow loses the oldest, which is its own affair."""
        for name in self._listener.newcomers():
            if name in self._channels:
                channel, latest = self._channels[name]
                for time, data in latest:
                    channel.log(data, log_time=time)
        for (name, topic), time, data in block.messages():
            # of the others those that are told
            if name not in self._channels:
                self._advertise(name, topic)
            channel, latest = self._channels[name]
            channel.log(data, log_time=time)
            if topic.rule is not Rule.CYCLE:
                latest.append((time, data))
        return 0

    def advertise(self, bus: Bus) -> None:
        """Advertise all topics at the start: Foxglove's server may refuse a subscription while a topic is new."""
        for topic in (*bus.offered, COMMAND, LOG):
            self._advertise(bus.full_name(topic), topic)

    def _advertise(self, name: str, topic: Topic[Any]) -> None:
        schema = foxglove.Schema(
            name=schema_name(topic.message), encoding="ros2msg", data=schema_text(topic.message).encode()
        )
        channel = foxglove.Channel(name, schema=schema, message_encoding="cdr", context=self._context)
        self._channels[name] = channel, deque(maxlen=LATEST if topic is LOG else 1)

    def close(self, dropped: int) -> None:
        """Let go of the clients."""
        del dropped
        self._listener.asked = lambda v, omega: None
        # The server waits without end for a client that has connected and never says a word.
        stopping = Thread(target=self._server.stop, daemon=True)
        stopping.start()
        stopping.join(STOPS)


class _Listener(ServerListener):
    """Takes clients' messages; called in the server's threads."""

    def __init__(self) -> None:
        self.asked: Callable[[float, float], None] = lambda v, omega: None
        """Called with the speed (m/s) and yaw rate (rad/s) that a client asks for."""
        self._driving: set[tuple[int, int]] = set()
        self._subscribed: deque[str] = deque()

    def newcomers(self) -> Iterator[str]:
        """Yield the topics with new subscribers since the last call, so that rare topics are sent again."""
        while self._subscribed:
            yield self._subscribed.popleft()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._subscribed.append(channel.topic)

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        if channel.topic == COMMAND.name and channel.encoding == "json":
            self._driving.add((client.id, channel.id))

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        self._driving.discard((client.id, client_channel_id))

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        if (client.id, client_channel_id) in self._driving and (twist := velocity(data)) is not None:
            self.asked(*twist)


def velocity(data: bytes) -> tuple[float, float] | None:
    """Speed (m/s) and yaw rate (rad/s) of a Twist or TwistStamped in JSON; None when it is none."""
    try:
        message: Any = json.loads(data)
        twist = message.get("twist", message)
        return float(twist["linear"]["x"]), float(twist["angular"]["z"])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return None
