"""A recording that is played on the page."""

from __future__ import annotations

from math import inf, nan
from types import SimpleNamespace
from typing import Any, cast

import pytest

from txt1.web.player import PagePlayer


@pytest.mark.parametrize("value", [nan, inf, -inf, "nan", 10**400])
def test_no_page_winds_to_a_number_that_is_not_finite(value: Any) -> None:
    player = PagePlayer("run.mcap", cast("Any", SimpleNamespace(start=0.0, end=9.0)), 1.0)
    for to, speed in ((value, None), (None, value), (2.0, value)):
        with pytest.raises((ValueError, OverflowError)):
            player.wind(to, speed)
    assert (player.position, player.speed) == (1.0, 1.0)
