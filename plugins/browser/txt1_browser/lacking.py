"""Stands in for what Python lacks in a browser, so that the robot's modules can be imported there; import it first.

There are no threads: a job for one is done at once (`AtOnce`). `zstandard` is made of Python's own module of 3.14. Of
other modules that cannot be had there, only their names are there (`Absent`): they serve as types, and whoever calls
them gets an ImportError that names the module. So what computes with numpy says that it is not to be had.
"""

import concurrent.futures
import importlib.metadata
import importlib.util
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future
from importlib.machinery import ModuleSpec
from io import BytesIO
from types import ModuleType
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
        return _Named(f"{cls.__name__}.{name}", (), {})

    def __getitem__(cls, _: object) -> Any:
        return cls

    def __or__(cls, other: object) -> Any:
        return Any

    __ror__ = __or__

    def __call__(cls, *_: object, **__: object) -> Any:
        raise ImportError(f"{cls.__name__}: it is not to be had in a browser")


class Absent(ModuleType):
    """A module of which only the names are there."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Named(f"{self.__name__}.{name}", (), {})


class ZstdCompressor:
    """zstandard's, by Python's own module."""

    def __init__(self, level: int = 3) -> None:
        self._level = level

    def compress(self, data: bytes) -> bytes:
        """Return data as one frame."""
        from compression import zstd  # type: ignore[import-not-found,unused-ignore]

        return bytes(zstd.compress(data, self._level))


class ZstdDecompressor:
    """zstandard's, by Python's own module."""

    def stream_reader(self, data: bytes) -> Any:
        """Return a file of what is in the frames."""
        from compression import zstd

        return zstd.open(BytesIO(data))


def stand_in() -> None:
    """Put the modules and executors in place."""
    for name in MODULES:
        if name in sys.modules or _is_there(name):
            continue
        sys.modules[name] = module = Absent(name)
        module.__path__, module.__spec__ = [], ModuleSpec(name, None)
        parent, _, last = name.rpartition(".")
        if parent:
            setattr(sys.modules[parent], last, module)
    if not _is_there("zstandard"):
        packed = sys.modules["zstandard"] = ModuleType("zstandard")
        packed.__spec__ = ModuleSpec("zstandard", None)
        packed.ZstdCompressor, packed.ZstdDecompressor = ZstdCompressor, ZstdDecompressor  # type: ignore[attr-defined]
    concurrent.futures.ThreadPoolExecutor = AtOnce  # type: ignore[misc,assignment]
    versions = importlib.metadata.version

    def version(distribution_name: str) -> str:
        try:
            return versions(distribution_name)
        except importlib.metadata.PackageNotFoundError:
            return "none"

    importlib.metadata.version = version


def _is_there(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False
