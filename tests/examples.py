"""Which examples `make test` tries: a fifth of a property's, and some values of a parameter; `make test-long` all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import pytest
from hypothesis import settings

USUAL: Final = 100
"""Examples of a property that does not name a number, in `make test-long`."""
SHARE: Final = 5
"""`make test` tries one in so many."""


def some(*usual: Any, rest: Iterable[Any]) -> list[Any]:
    """The values of a parameter: the usual ones in each run of the tests, the rest in `make test-long` besides."""
    return [*usual, *(pytest.param(each, marks=pytest.mark.long) for each in rest)]


def examples(number: int) -> int:
    """The examples of a property that asks for `number`, under the profile in use (tests/conftest.py)."""
    return number if settings.get_current_profile_name() == "others" else max(1, number // SHARE)
