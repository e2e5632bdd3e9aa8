"""Conformance suites: the promises of an interface, a test for each, for any implementation.

With pytest, which collects the `test_` methods of a subclass whose name starts with "Test"::

    class TestMyCar(HalConformance):
        def make(self):
            return MyCarHal(port="/dev/ttyUSB0")

A failure names the broken promise, and the module that states it.
"""

import asyncio
import inspect
import resource
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, wraps
from statistics import median
from typing import Any, ClassVar, Final, Generic, NoReturn, Protocol, TypeVar
from unittest import SkipTest

from txt1.kernel.clock import NS_PER_S, processor_ns, stopwatch_ns
from txt1.kernel.loop import Speed, run

# how the verdict on a broken promise begins
BROKEN: Final = "BROKEN"
# how the verdict on a promise that was not checked begins
SKIPPED: Final = "skipped"
ROUNDS: Final = 3
# by which the system tells about one thread; None where it does not
THREAD: Final[int | None] = getattr(resource, "RUSAGE_THREAD", None)
# turns of a plain loop in Python, and the s that they take on a usual computer
LOOP: Final = 7500
LOOP_TIME: Final = 0.0002


class Part(Protocol):
    """A part that a suite opens and closes."""

    async def open(self) -> None:
        """Make the hardware ready."""

    async def close(self) -> None:
        """Release the hardware."""


P = TypeVar("P", bound=Part)
S = TypeVar("S", bound="Conformance[Any]")


def unopened(test: Callable[[S], Coroutine[Any, Any, None]]) -> Callable[[S], None]:
    """Run a test in an event loop of its own."""

    @wraps(test)
    def tested(self: S) -> None:
        try:
            run(test(self), speed=self.speed)
        except AssertionError as error:
            raise AssertionError(f"{error} (the promise stands in {self.interface.__module__})") from None

    return tested


def opened(test: Callable[[S], Coroutine[Any, Any, None]]) -> Callable[[S], None]:
    """Run a test on a new part that is open, and close it."""

    @unopened
    @wraps(test)
    async def tested(self: S) -> None:
        self.started = asyncio.get_running_loop().time()
        await self.waited("open")
        try:
            await self.ready()
            await test(self)
        except BaseException:
            # the test's own error matters more
            with suppress(Exception):
                await self.part.close()
            raise
        await self.waited("close")

    return tested


class Conformance(Generic[P]):
    """The promises of one interface. Override `make`, and the settings whose defaults do not fit."""

    interface: ClassVar[type]

    # virtual time; None is real time, for hardware, other processes or threads
    speed: ClassVar[Speed] = "max"
    # s in which every sensor has reported and a robot rolling at 0.5 m/s has stopped
    settle: ClassVar[float] = 3.0
    # s that a call may wait at the median, so that the controller can keep its period
    prompt: ClassVar[float] = 0.002
    # s of the processor that a call may take at the median, on a usual computer
    processor: ClassVar[float] = 0.0002
    started = 0.0

    def make(self) -> P:
        """Make a new part, not yet opened; override this."""
        raise NotImplementedError(f"override {type(self).__name__}.make: return a new part that is not opened yet")

    @cached_property
    def part(self) -> P:
        """Make the part that is tested."""
        return self.make()

    @property
    def now(self) -> float:
        """Seconds since the run started, just before opening."""
        return asyncio.get_running_loop().time() - self.started

    @opened
    async def test_closing_twice_is_harmless(self) -> None:
        await self.part.close()
        await self.closes(self.part, "when closed already")

    # -- for the tests -----------------------------------------------------------------------------------------

    async def ready(self) -> None:
        """Wait until an open part can be tested."""

    async def closes(self, part: P, when: str) -> None:
        """Check that closing is harmless."""
        with kept(f"{self.interface.__name__}.close", f"is harmless {when}"):
            await part.close()

    async def reopen(self) -> None:
        """Close the part, and check that it opens again."""
        await self.part.close()
        with kept(f"{self.interface.__name__}.open", "makes the hardware ready again after close"):
            await self.part.open()

    async def waited(self, method: str) -> None:
        """Call a method of the part that must be a coroutine."""
        value, where = getattr(self.part, method)(), f"{self.interface.__name__}.{method}"
        promise(inspect.isawaitable(value), where, "is a coroutine, but returned at once")
        await value

    def called(self, method: str, *arguments: Any) -> Any:
        """Call a method of the part and return its result, which must not be awaitable."""
        value = getattr(self.part, method)(*arguments)
        if inspect.isawaitable(value):
            if inspect.iscoroutine(value):
                value.close()
            where = f"{self.interface.__name__}.{method}"
            broken(where, "returns at once, but must be awaited; only open and close are coroutines")
        return value

    async def expect_prompt(self, where: str, period: float, call: Callable[[], object]) -> None:
        """Check that calls, each a period apart, neither wait nor compute for long.

        Only processor time has a tight limit, as it excludes the load of other programs. On a slow or busy computer
        `processor` grows in proportion to the time of a plain loop, measured between the calls. Programs that share
        the processor's cache cost time, too, so one good round of `ROUNDS` is enough. A call that waits
        gives up the processor by itself; one that other programs hold up does not.
        """
        for _ in range(ROUNDS):
            waited, took, usual, gave_up = [], [], [], []
            for _ in range(25):
                await asyncio.sleep(period)
                waits, begun, before = _waits(), stopwatch_ns(), processor_ns()
                call()
                after = processor_ns()
                took.append((after - before) / NS_PER_S)
                waited.append((stopwatch_ns() - begun) / NS_PER_S - took[-1])
                gave_up.append(_waits() - waits)
                before = processor_ns()
                sum(k * k for k in range(LOOP))
                usual.append((processor_ns() - before) / NS_PER_S)
            limit, taken = 1e3 * self.processor * max(1.0, median(usual) / LOOP_TIME), 1e3 * median(took)
            prompt = median(waited) < self.prompt or (THREAD is not None and median(gave_up) == 0)
            if taken < limit and prompt:
                break
        told = f"takes less than {limit:.2f} ms of the processor, but took {taken:.2f} ms; leave the work to a thread"
        promise(taken < limit, where, told)
        promise(prompt, where, f"never waits, but waits {1e3 * median(waited):.1f} ms each time")


def _waits() -> int:
    """How often this thread has given up the processor by itself; 0 where the system does not tell."""
    return 0 if THREAD is None else resource.getrusage(THREAD).ru_nvcsw


def promise(kept: bool, where: str, text: str) -> None:
    """Fail unless the promise is kept; `where` names its place in the interface, `text` repeats it."""
    if not kept:
        broken(where, text)


def broken(where: str, text: str) -> NoReturn:
    """Fail: a promise is broken."""
    raise AssertionError(f"{where} {text}")


@contextmanager
def kept(where: str, text: str) -> Iterator[None]:
    """Fail if the block raises anything, as that breaks a promise."""
    try:
        yield
    except AssertionError:
        raise
    except Exception as error:
        broken(where, f"{text}, but raised {named(error)}")


def named(error: Exception) -> str:
    """Return an error's text with its type before it."""
    return f"{type(error).__name__}: {error}"


def promises(suite: type) -> list[str]:
    """Return the names of a suite's tests."""
    return [name for kind in reversed(suite.__mro__) for name in vars(kind) if name.startswith("test_")]


def verdicts(suite: type, make: Callable[[], Any], **settings: object) -> Iterator[tuple[str, str]]:
    """Yield every promise in words with "ok", "skipped: ..." or "BROKEN: ...", for a suite with these settings."""
    checked = type("Checked", (suite,), {"make": staticmethod(make), **settings})
    for name in promises(suite):
        verdict = "ok"
        try:
            getattr(checked(), name)()
        except SkipTest as reason:
            verdict = f"{SKIPPED}: {reason}"
        except Exception as error:
            verdict = f"{BROKEN}: {error if isinstance(error, AssertionError) else named(error)}"
        yield name.removeprefix("test_").replace("_", " "), verdict
