"""A real board: ``TXT_PORT=/dev/ttyUSB0 python -m pytest tests/hardware -n 0``.

Without TXT_PORT these tests are skipped. Those that drive want TXT_WHEELS_UP=yes besides: the robot stands on a box and
nothing touches its wheels.
"""

import os
from collections.abc import AsyncIterator, Callable

import pytest

from txt1.kernel.loop import RealTimeLoop
from txt1.robot import Robot


def pytest_asyncio_loop_factories(config: pytest.Config, item: pytest.Item) -> dict[str, Callable[[], RealTimeLoop]]:
    return {"real": RealTimeLoop}


@pytest.fixture(scope="session")
def port() -> str:
    port = os.environ.get("TXT_PORT")
    if not port:
        pytest.skip("no board: TXT_PORT=/dev/ttyUSB0 names its port")
    return port


@pytest.fixture
def wheels_up() -> None:
    if os.environ.get("TXT_WHEELS_UP") != "yes":
        pytest.skip("TXT_WHEELS_UP=yes says that nothing touches the wheels")


@pytest.fixture
async def robot(port: str) -> AsyncIterator[Robot]:
    """The robot behind the port, linked and not armed."""
    async with Robot.open("serial", settings=[f"serial.port={port}"]) as robot:
        await robot.linked(5.0)
        yield robot
