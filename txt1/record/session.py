"""A recording beside a run: its metadata, its beginning and its end."""

from __future__ import annotations

import asyncio
import json
import platform
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from txt1.commands import need
from txt1.config import Config, flatten
from txt1.errors import ConfigError, MissingExtra, RecordingError
from txt1.kernel.clock import NS_PER_S, wall_ns
from txt1.kernel.loop import Speed
from txt1.record.settings import RecordConfig
from txt1.runtime import Runtime
from txt1.version import __version__

if TYPE_CHECKING:
    from txt1.record.live_view import LiveView
    from txt1.record.mcap_records import TopicChannel
    from txt1.record.recorder import Origin, Recorder, Sink

MODULES: Final = ("mcap", "mcap_ros2", "zstandard", "lz4")
"""With which recordings are read; without mcap_ros2 they can still be written."""
LIBRARIES: Final = ("pydantic", "mcap")
# real s between two batches for a live view
VIEW_BATCH: Final = 0.1
MEGABYTE: Final = 1_000_000


@cache
def machine() -> dict[str, str]:
    """The processor and the libraries on which the last bits of results depend."""
    wanted, told = ("cpu family", "model", "model name", "stepping"), dict[str, str]()
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as lines:
            for name, _, value in (line.partition(":") for line in lines):
                told.setdefault(name.strip(), value.strip())
    except OSError:
        # not Linux
        pass
    told.setdefault("model name", platform.processor())
    # processors of several kinds have one name, under a hypervisor
    processor = " ".join((platform.machine(), *(told[name] for name in wanted if name in told))).strip()
    return {"processor": processor, "libm": " ".join(platform.libc_ver()).strip(), "numpy": version("numpy")}


def metadata(config: Config, speed: Speed, plan: Mapping[str, object]) -> dict[str, str]:
    """A recording's metadata: configuration, versions, seed, clock, the command's options, wall start."""
    return {
        "txt1": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
        **machine(),
        "seed": str(config.seed),
        "hal": config.hal,
        "clock": "real" if speed is None else "virtual",
        "speed": str(speed),
        "epoch": repr(config.section(RecordConfig).epoch or 0.0),
        "wall_start": datetime.fromtimestamp(wall_ns() / NS_PER_S, UTC).isoformat(),
        "plan": json.dumps(dict(plan)),
        "config": json.dumps(config.model_dump(mode="json")),
        **({} if config.sim.room.map is None else {"map": _digest(config.sim.room.map)}),
    }


def _digest(name: str) -> str:
    """The SHA-256 of a map, by which a replay knows it again; empty where it cannot be read: nothing drives in it."""
    from txt1.maps.files import read

    with suppress(ConfigError, MissingExtra):
        return read(name).digest
    return ""


def dated(folder: Path, name: str) -> Path:
    """A recording's file in a folder, named by the robot and the time of day, UTC."""
    return folder / f"{name}-{datetime.fromtimestamp(wall_ns() / NS_PER_S, UTC):%Y%m%d-%H%M%S}.mcap"


Attach = Callable[[Runtime], None]


@asynccontextmanager
async def recording(
    file: Path | None,
    config: Config,
    speed: Speed,
    plan: Mapping[str, object],
    told: Callable[[str], None],
    view: LiveView | None = None,
) -> AsyncIterator[Attach]:
    """Yield the function that attaches a recorder to a runtime before it starts; on leaving the file is complete.

    `plan` holds further settings of the run, for the metadata. `view` shows the run live and is closed at the end. If
    messages were lost, `told` is called at the end with a sentence about them. Without a file nothing is recorded.

    Raises ConfigError: the file exists, or cannot be made; MissingExtra: the extra `record` is not installed;
    RecordingError: the file could not be written, or not to its end.
    """
    async with _recording(file, config, speed, plan, told, {}, view) as attach:
        yield attach


@asynccontextmanager
async def recording_together(
    file: Path | None,
    configs: Mapping[str, Config],
    speed: Speed,
    plan: Mapping[str, object],
    told: Callable[[str], None],
) -> AsyncIterator[Attach]:
    """Record several robots in one file; their names precede the topics' names.

    Raises as `recording` does.
    """
    first = next(iter(configs.values()))
    own = {name: _differences(first, config) for name, config in configs.items()}
    async with _recording(file, first, speed, plan, told, {"robots": json.dumps(own)}, None) as attach:
        yield attach


@asynccontextmanager
async def _recording(
    file: Path | None,
    config: Config,
    speed: Speed,
    plan: Mapping[str, object],
    told: Callable[[str], None],
    more: Mapping[str, str],
    view: LiveView | None,
) -> AsyncIterator[Attach]:
    """Record one robot or several; `more` is further metadata."""
    if file is None and view is None:
        yield lambda runtime: None
        return
    sinks: Sequence[Sink] = [] if view is None else [view]
    batch = None if view is None else VIEW_BATCH * (speed if isinstance(speed, float) else 1.0)
    recorders: list[Recorder] = []
    channels: list[TopicChannel] = []
    origin: Origin | None = None
    writer = ThreadPoolExecutor(1, "txt1 recorder")
    try:
        # in a thread, as modules are found and a file is made on the disk
        sinks, make = await asyncio.to_thread(_prepare, file, config, speed, plan, sinks, more)

        def attach(runtime: Runtime) -> None:
            nonlocal origin
            if origin is None:
                from txt1.record.recorder import Origin

                epoch = config.section(RecordConfig).epoch
                origin = Origin(0.0 if epoch is None and speed is not None else epoch)
            recorders.append(make(runtime, sinks, origin, batch, writer=writer, channels=channels))
            if view is not None:
                view.advertise(runtime.bus)

        yield attach
    finally:
        dropped = await close(recorders, sinks)
        writer.shutdown(wait=False)
        if dropped:
            told(f"{file}: {dropped} messages were not recorded: the disk was full or too slow")


async def close(recorders: Sequence[Recorder], sinks: Sequence[Sink]) -> int:
    """Finish recorders, close their sinks and return how many messages were lost.

    Raises RecordingError, the first that there was; the rest is closed all the same.
    """
    failures: list[RecordingError] = []
    for recorder in recorders:
        try:
            await recorder.finish()
        except RecordingError as error:
            failures.append(error)
    dropped = sum(recorder.dropped for recorder in recorders)
    for sink in sinks:
        try:
            await asyncio.to_thread(sink.close, dropped)
        except RecordingError as error:
            failures.append(error)
    if failures:
        raise failures[0]
    return dropped


def _differences(first: Config, other: Config) -> dict[str, Any]:
    """The values in which another configuration differs, by dotted key."""
    before = dict(flatten(first))
    return {key: value for key, value in flatten(other) if key not in before or before[key] != value}


def _prepare(
    file: Path | None,
    config: Config,
    speed: Speed,
    plan: Mapping[str, object],
    sinks: Sequence[Sink],
    more: Mapping[str, str],
) -> tuple[Sequence[Sink], type[Recorder]]:
    """Return the sinks, the file's among them, and the function that makes a recorder for them."""
    need("recording", "record", "mcap", "zstandard", "lz4")
    from txt1.record.file_sink import FileSink, Rotation
    from txt1.record.recorder import Recorder

    record = config.section(RecordConfig)
    rotation = Rotation(round(record.rotate_size * MEGABYTE), round(record.rotate_time * NS_PER_S))
    about = {**metadata(config, speed, plan), **more}
    if file is not None:
        sinks = [*sinks, FileSink(file, about, rotation, record.compression, strict=speed is not None)]
    return sinks, Recorder


def discard(file: Path, config: Config, plan: Mapping[str, object]) -> bool:
    """Whether a file is the recording of this very run, made before; if so it is deleted, later parts and all."""
    from txt1.record.file_sink import parts
    from txt1.record.reader import metadata_of

    told, found = metadata(config, None, plan), list(parts(file))
    abouts = [metadata_of(part, "txt1") for part in found]
    if any(about.get(name) != told[name] for about in abouts for name in ("plan", "config")):
        return False
    for part in found:
        part.unlink()
    return True


def open_view(host: str, port: int, *, control: bool) -> LiveView:
    """Return a live view that listens; raises MissingExtra, ConfigError."""
    need("--view", "view", "foxglove", "mcap", "zstandard", "lz4")
    from txt1.record.live_view import LiveView

    return LiveView(host, port, control=control)
