"""Desks for the serial HAL."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from serial_desk import Desk


@pytest.fixture
def make() -> Iterator[Callable[..., Desk]]:
    """A function that makes a desk whose line is open."""
    desks: list[Desk] = []

    def made(**options: Any) -> Desk:
        desks.append(Desk(**options))
        return desks[-1].opens()

    yield made
    for desk in desks:
        desk.do(desk.hal.close())
        desk.loop.close()


@pytest.fixture
def desk(make: Callable[..., Desk]) -> Desk:
    """A desk whose board has been heard for 2 s."""
    return make().runs(2.0)
