"""Stands in for what Python lacks in a browser, so that the robot's modules can be imported there; import it first.

There are no threads: a job for one is done at once (`AtOnce`). `zstandard` is made of Python's own module of 3.14. Of
other modules that cannot be had there, only their names are there (`Absent`): they serve as types, and whoever calls
them gets an ImportError that names the module. So what computes with numpy says that it is not to be had.
"""

import asyncio
import concurrent.futures
import importlib.metadata
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future
from functools import partial
from importlib import import_module
from importlib.machinery import ModuleSpec
from io import BytesIO
from types import SimpleNamespace
from typing import Any, Final, TypeVar

T = TypeVar("T")

MODULES: Final = ("resource", "termios", "fcntl", "lz4", "lz4.frame", "numpy", "numpy.random", "numpy.typing")


class AtOnce(Executor):
    """An executor that does each job when it is submitted."""

    def __init__(self, *_: object, **__: object) -> None:
        pass

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Do a job, and return its result."""
        done: Future[T] = Future()
        try:
            done.set_result(fn(*args, **kwargs))
        except Exception as error:
            done.set_exception(error)
        return done


class _Named(type):
    """The type of names: each has more names in it, and none can be called."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return absent(f"{cls.__name__}.{name}")

    def __getitem__(cls, _: object) -> Any:
        return cls

    def __or__(cls, other: object) -> Any:
        return Any

    __ror__ = __or__

    def __call__(cls, *_: object, **__: object) -> Any:
        raise ImportError(f"{cls.__name__}: it is not to be had in a browser")


def absent(name: str) -> Any:
    """Return a module, or what is in one, of which only the names are there."""
    return _Named(name, (), {"__path__": [], "__spec__": ModuleSpec(name, None)})


def _zstandard() -> Any:
    """Return what recordings take of zstandard, by Python's own module."""
    zstd = import_module("compression.zstd")
    return SimpleNamespace(
        ZstdCompressor=lambda level: SimpleNamespace(compress=partial(zstd.compress, level=level)),
        ZstdDecompressor=lambda: SimpleNamespace(stream_reader=lambda data: zstd.open(BytesIO(data))),
        __spec__=ModuleSpec("zstandard", None),
    )


def stand_in() -> None:
    """Put the modules and executors in place."""
    for name in MODULES:
        sys.modules[name] = absent(name)
    sys.modules["zstandard"] = _zstandard()
    concurrent.futures.ThreadPoolExecutor = AtOnce  # type: ignore[misc,assignment]
    versions = importlib.metadata.version

    def version(distribution_name: str) -> str:
        return "none" if distribution_name in MODULES else versions(distribution_name)

    importlib.metadata.version = version
    # the browser's own loop, in which Python's others could not run
    asyncio._set_running_loop(None)
