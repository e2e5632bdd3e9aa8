"""Asynchronous tests run in virtual time."""

from collections.abc import Callable

import pytest

from txt1.kernel import VirtualTimeLoop


def pytest_asyncio_loop_factories(config: pytest.Config, item: pytest.Item) -> dict[str, Callable[[], VirtualTimeLoop]]:
    return {"virtual": VirtualTimeLoop}
