"""The common part of the virtual sensors: a link, and readings that are sent to the host over it."""

import asyncio
from collections.abc import Callable
from typing import Any

from txt1.link.base import End, Link, connect
from txt1.link.virtual_device import VirtualDevice
from txt1.sensors.base import Reading, Sensor


class VirtualSensor(VirtualDevice):
    """A virtual device: an end of a link. `show` gives it the readings of a simulated sensor."""

    # bytes of an incomplete command
    _rest = b""

    def connected(self, link: Link) -> None:
        """Take the link; a measurement that an earlier host has started goes on."""
        self._rest = b""
        super().connected(link)

    def show(self, reading: Reading[Any]) -> None:
        """Send a reading to the host, as the device would."""
        raise NotImplementedError


class Talker(VirtualSensor):
    """A device that sends its readings unasked and has no commands; `encode` turns a reading into bytes."""

    def __init__(self, encode: Callable[[Reading[Any]], bytes]) -> None:
        self._encode = encode

    def show(self, reading: Reading[Any]) -> None:
        """Send a reading."""
        self.send(self._encode(reading))


class DeskPort:
    """A port with a virtual device behind it, in the same process and on the same clock.

    The device is made when the port is opened, and again after the port was closed. It shows the readings of a
    simulated sensor.
    """

    def __init__(self, name: str, make: Callable[[], VirtualSensor], sensor: Sensor[Any]) -> None:
        self.address, self._make, self._sensor = name, make, sensor
        self._device: VirtualSensor | None = None
        self._showing: asyncio.Task[None] | None = None

    async def open(self, end: End) -> Link:
        """Return a link to the device, made first if needed."""
        if self._device is None:
            await self._sensor.open()
            self._device = self._make()
            self._showing = asyncio.create_task(self._show(self._device))
        self._device.hang_up()
        return connect(end, self._device)[0]

    async def close(self) -> None:
        """Power the device down."""
        if self._showing is not None:
            self._showing.cancel()
            self._showing = None
        self._device = None
        await self._sensor.close()

    async def _show(self, device: VirtualSensor) -> None:
        time = asyncio.get_running_loop().time
        # the device's clock begins when it is powered up
        began = time()
        while True:
            await asyncio.sleep(self._sensor.period)
            reading = self._sensor.read(time() - began)
            if reading is not None:
                device.show(reading)
