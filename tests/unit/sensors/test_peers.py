"""Programs of others at the other end: gpsd reads our receiver, our driver gpsd, and VRPN's own client our Vicon."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from math import cos, sin
from pathlib import Path

import pytest

from rigs.ports import free_port
from tests.patience import LIMIT, until
from txt1.link.tcp import listen_tcp
from txt1.sensors.base import Reading
from txt1.sensors.gps_gpsd import GpsdDecoder
from txt1.sensors.readings import FixReading, TrackerReading, fix_topic
from txt1.sensors.stream import Streamed
from txt1.sensors.virtual_gps import nmea
from txt1.sensors.virtual_mocap import VirtualVicon

GPSFAKE = shutil.which("gpsfake")
GPSD = shutil.which("gpsd", path="/usr/sbin:/usr/local/sbin:/usr/bin")
DATUM = (35.0844, -106.6504)
PATIENCE = 5.0  # s that a program has to end
TRACKED = (0.5, -0.25, 0.1)  # m


@asynccontextmanager
async def process(*command: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """A program that is ended with the block."""
    pipe = asyncio.subprocess.PIPE
    started = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, stderr=pipe)
    try:
        yield started
    finally:
        if started.returncode is None:
            started.terminate()
            # gpsfake catches the signal, and now and then waits for a gpsd that has ended already
            try:
                await asyncio.wait_for(started.wait(), PATIENCE)
            except TimeoutError:
                started.kill()
                await started.wait()


def listens(port: int) -> bool:
    """Whether a program serves a port of this computer."""
    with socket.socket() as knock:
        return knock.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.skipif(not (GPSFAKE and GPSD), reason="needs Debian's gpsd and gpsfake: apt-get install gpsd gpsd-clients")
async def test_gpsd_reads_our_receiver_and_we_read_gpsd(tmp_path: Path) -> None:
    pytest.importorskip("utm")
    from txt1.sensors.geodesy import UtmGrid

    grid = UtmGrid(*DATUM)
    log = tmp_path / "drive.nmea"
    with log.open("wb") as file:
        for k in range(400):  # 1 m/s eastwards on the grid, 5 times a second
            x = 0.2 * k
            fix = FixReading(*grid.earth(x, 0.0), x, 0.0, 1600.0, 0.0, 1.0, 3, 1.0, 1.0)
            file.write(nmea(Reading(0.2 * k, fix)))
    port = free_port()
    assert GPSFAKE is not None
    fed = [GPSFAKE, "-1", "-q", "-c", "0.01", "-P", str(port), str(log)]
    sensor = Streamed(fix_topic("peer_gps"), 0.1, f"socket://127.0.0.1:{port}", lambda: GpsdDecoder(DATUM))
    async with process(*fed):
        await until(lambda: listens(port))
        await sensor.open()
        begun, found = asyncio.get_running_loop().time(), []
        while len(found) < 20 and asyncio.get_running_loop().time() < begun + LIMIT:
            await asyncio.sleep(0.05)
            if (reading := sensor.read(asyncio.get_running_loop().time() - begun + 60.0)) is not None:
                found.append(reading.value)
        await sensor.close()
    assert len(found) == 20
    for fix in found:
        assert fix.y == pytest.approx(0.0, abs=0.02)
        assert fix.x / 0.2 == pytest.approx(round(fix.x / 0.2), abs=0.1)
    assert found[-1].x > found[0].x
    assert found[-1].v == pytest.approx(1.0, abs=0.01)
    assert found[-1].theta == pytest.approx(0.0, abs=0.01)


CLIENT = """
import json, sys, motioncapture
client = motioncapture.connect("vrpn", {"hostname": sys.argv[1]})
while True:
    client.waitForNextFrame()
    if "txt01" in client.rigidBodies:
        body = client.rigidBodies["txt01"]
        q = body.rotation
        print(json.dumps([*map(float, body.position), q.x, q.y, q.z, q.w]))
        break
"""


async def test_vrpns_own_client_reads_our_vicon() -> None:
    pytest.importorskip("motioncapture", reason="needs VRPN's client: pip install motioncapture")
    try:
        socket.getprotobyname("tcp")
    except OSError:
        pytest.skip("VRPN's client looks up tcp in /etc/protocols: apt install netbase")
    device = VirtualVicon("txt01")
    listener = await listen_tcp("127.0.0.1", 0, device)
    theta = 0.7
    pose = TrackerReading(*TRACKED, (0.0, 0.0, sin(0.5 * theta), cos(0.5 * theta)))
    try:
        address = listener.address.replace("socket", "tcp")
        async with process(sys.executable, "-c", CLIENT, address) as client:

            async def show() -> None:
                for k in count():
                    device.show(Reading(0.01 * k, pose))
                    await asyncio.sleep(0.01)

            showing = asyncio.create_task(show())
            out, err = await asyncio.wait_for(client.communicate(), LIMIT)
            showing.cancel()
    finally:
        listener.close()
    lines = [line for line in out.splitlines() if line.startswith(b"[")]
    assert lines, err
    x, y, z, *quaternion = json.loads(lines[0])
    assert (x, y, z) == pytest.approx(tuple(1000.0 * each for each in TRACKED))  # Vicon's are millimetres
    assert quaternion == pytest.approx(pose.orientation)
