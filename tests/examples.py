"""How many examples a property is tried with: all in `make test-long`, a third in `make test`."""

from __future__ import annotations

from typing import Final

from hypothesis import settings

USUAL: Final = 100
"""Examples of a property that does not name a number, in `make test-long`."""
SHARE: Final = 3
"""`make test` tries one in so many."""


def examples(number: int) -> int:
    """The examples of a property that asks for `number`, under the profile in use (tests/conftest.py)."""
    return number if settings.get_current_profile_name() == "others" else max(1, number // SHARE)
