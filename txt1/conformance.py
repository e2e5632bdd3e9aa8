"""What conformance suites have in common: a promise, where it stands, and the verdict on it.

A suite is a class whose `test_` methods are the promises, in pytest's way, and whose `make` is overridden.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any, Final, NoReturn
from unittest import SkipTest

BROKEN: Final = "BROKEN"
"""How the verdict on a promise that is not kept begins."""


class Promises:
    """The promises of one interface.

    Args:
        stands: the module where they stand.

    """

    def __init__(self, stands: str) -> None:
        self._stands = stands

    def promise(self, kept: bool, where: str, text: str) -> None:
        """Fail unless the promise is kept; `where` it stands in the module, and what it says there."""
        if not kept:
            self.broken(where, text)

    def broken(self, where: str, text: str) -> NoReturn:
        """Fail: a promise is broken."""
        raise AssertionError(f"{where} {text} (the promise stands in {self._stands})")

    def called(self, where: str, method: Callable[..., Any], *arguments: Any) -> Any:
        """What a method returns, which must not be something to wait for."""
        value = method(*arguments)
        if inspect.isawaitable(value):
            if inspect.iscoroutine(value):
                value.close()
            self.broken(where, "returns at once, but must be awaited; only open and close are coroutines")
        return value

    async def waited(self, value: Any, where: str) -> None:
        """Wait for something that a coroutine method returned."""
        self.promise(inspect.isawaitable(value), where, "is a coroutine, but returned at once")
        await value


def named(error: Exception) -> str:
    """An error with its type before it."""
    return f"{type(error).__name__}: {error}"


def promises(suite: type) -> list[str]:
    """The names of a suite's tests, in order."""
    return [name for name in vars(suite) if name.startswith("test_")]


def verdicts(suite: type, make: Callable[[], Any], **settings: object) -> Iterator[tuple[str, str]]:
    """Every promise in words, and "ok", "skipped: ..." or "BROKEN: ...", for a suite with these settings."""
    checked = type("Checked", (suite,), {"make": staticmethod(make), **settings})
    for name in promises(suite):
        verdict = "ok"
        try:
            getattr(checked(), name)()
        except SkipTest as reason:
            verdict = f"skipped: {reason}"
        except Exception as error:
            verdict = f"{BROKEN}: {error if isinstance(error, AssertionError) else named(error)}"
        yield name.removeprefix("test_").replace("_", " "), verdict
