"""A recorded run as it is needed to run it again: the configuration, and everything that was given from outside."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from txt1.config import Config, recorded
from txt1.errors import ConfigError, RecordingError
from txt1.estimation.settings import EstimationConfig
from txt1.hal.base import Capabilities, Inputs
from txt1.record.reader import Decoding, FilePass, Item, check_own, trusting
from txt1.record.recorded_inputs import Given, TaskStep
from txt1.record.session import machine
from txt1.tasks.controller import SETPOINT
from txt1.tasks.inputs import INPUT, REPORT, STEP, Input, Report
from txt1.telemetry import exact
from txt1.version import __version__


@dataclass
class Recorded:
    """A robot's run, to be repeated."""

    path: Path
    robot: str
    """Its name."""
    config: Config = Config()  # noqa: RUF009 - immutable
    given: list[Given] = field(default_factory=list)
    """Everything from outside."""
    steps: list[TaskStep] = field(default_factory=list)
    """None where virtual time says when they are due."""
    hardware: tuple[str, Capabilities] | None = None
    """Its name and abilities; None in recordings of older versions."""
    sensed: bool = False
    """Whether the sensors' readings are in it."""
    last: float = 0.0
    """The time of the last message, s of the run."""
    epoch: float = 0.0
    """Time stamp of the run's start, s since 1970."""
    former: str = ""
    """The version of txt1 that made it, if it is an earlier one."""
    alike: bool = True
    """Whether it was made with the processor and the libraries of now, so that each bit is the same."""

    @property
    def reports(self) -> bool:
        """Whether the hardware reports again; else it is simulated anew."""
        return bool(self.steps) and self.hardware is not None and not self.hardware[1].repeats

    @property
    def shared(self) -> bool:
        """Whether other robots may have been in the simulated world."""
        return (
            not self.steps and self.config.hal == "sim" and self.hardware is not None and not self.hardware[1].repeats
        )

    @property
    def lacks(self) -> str:
        """The contents that it lacks, in words."""
        if self.sensed or not (self.config.sensors or self.config.section(EstimationConfig).names):
            return ""
        return "it is older than this version and has no exact readings, so guards and what sensors tell are left out"


def read(path: Path, robot: str) -> Recorded:
    """The run of a robot of a recording; RecordingError: it is none, or cannot be repeated."""
    check_own(path)
    run = _RunRead(path, robot)
    with trusting(path):
        for item in run.reading:
            run.take(item)
        return run.found()


def check_map(path: Path, name: str, digest: str) -> None:
    """Raise RecordingError if a recording's map is missing or has changed."""
    from txt1.maps.files import read as read_map

    known = f"the map {name} of SHA-256 {digest[:12]}"
    try:
        now = read_map(name).digest
    except ConfigError as error:
        raise RecordingError(f"{path}: recorded in {known}, which cannot be read here: {error}") from None
    if now != digest:
        raise RecordingError(f"{path}: recorded in {known}, now it is {now[:12]}: put the files of then in its place")


def _begun(about: dict[str, str]) -> float | None:
    """When in its run a recording was begun, s of the run; None: at the start."""
    try:
        return float(json.loads(about["plan"])["begun"])
    except (ValueError, TypeError, KeyError):
        return None


class _RunRead:
    """A run as it is read, message by message."""

    def __init__(self, path: Path, robot: str) -> None:
        self.reading, self._decoding = FilePass(path, robot), Decoding()
        self._found = Recorded(path, robot)
        self._path = path
        self._cycles, self._whole = 0, True
        # whether what is read belongs to the last step, not to an input behind it
        self._in_step = False

    def take(self, item: Item) -> None:
        """Take the next message."""
        found, time = self._found, self.reading.run_time(item)
        found.last = max(found.last, time)
        if item.name == INPUT.name:
            said = self._decoding.message(item)
            values = tuple(map(float, said.values))
            found.given.append(Given(time, Input(said.step, said.source, said.kind, said.text, said.given, values)))
            self._in_step = bool(said.source)
        elif item.name == REPORT.name:
            said = self._decoding.message(item)
            found.sensed = True
            self._take_report(time, Report(said.step, said.source, said.kind, said.text, said.time, bytes(said.data)))
        elif item.name == STEP.name:
            said = self._decoding.message(item)
            found.steps.append(TaskStep(said.task, said.time, said.missed))
            self._in_step = True
        elif item.name == SETPOINT.name:
            self._whole = self._whole and item.message.sequence == self._cycles
            self._cycles += 1

    def _take_report(self, time: float, report: Report) -> None:
        found = self._found
        if report.kind == "hardware":
            found.hardware = report.text, self._value(Capabilities, report)
        elif report.source != "hal":
            found.given.append(Given(time, report))
        else:
            report = report._replace(value=None if report.text else self._value(Inputs, report))
            if self._in_step and found.steps:
                found.steps[-1].reports.append(report)
            else:
                # read in the course of the last input, so it has to be known ahead of that
                found.given.insert(-1, Given(time, report))

    def _value(self, kind: Any, report: Report) -> Any:
        try:
            return exact.decode(kind, report.value)
        except ValueError as error:
            raise RecordingError(f"{self._path}: {REPORT.name}: {error}") from None

    def found(self) -> Recorded:
        """The whole run."""
        path, found, about = self._path, self._found, self.reading.metadata.get("txt1")
        if about is None or "config" not in about:
            raise RecordingError(f"{path}: no configuration in it, so there is nothing to run; was it made by txt1?")
        if (begun := _begun(about)) is not None:
            raise RecordingError(
                f"{path}: it begins {begun:.1f} s into its run, and what was before is not known, so it cannot be "
                "repeated; record from the start: 'txt1 run --log FILE'"
            )
        if "part" in about:
            raise RecordingError(f"{path}: a later part of a recording; only the first begins where the run does")
        if not self._whole:
            raise RecordingError(
                f"{path}: messages are missing in the middle, so it cannot be repeated; see 'txt1 log info'"
            )
        if about.get("clock") == "virtual":
            found.steps = []
        elif not found.steps:
            raise RecordingError(
                f"{path}: it cannot be repeated: a board, and hardware in recordings of older versions, has a time of "
                "its own on the real clock; record the robot, or use virtual time: --speed max"
            )
        if not self._cycles:
            raise RecordingError(f"{path}: no whole cycle in it, so nothing can be compared; see 'txt1 log info'")
        try:
            own = json.loads(about["robots"])[found.robot] if "robots" in about else None
            found.config = recorded(json.loads(about["config"]), own)
        except (ValueError, ConfigError) as error:
            raise RecordingError(f"{path}: its configuration is not one of this version's: {error}") from None
        if digest := about.get("map"):
            check_map(path, str(found.config.sim.room.map), digest)
        found.epoch = self.reading.epoch
        # until 0.2.0 no processor was named
        if about.get("txt1") != __version__ or "processor" not in about:
            found.former = about.get("txt1", "")
        found.alike = all(about.get(name, told) == told for name, told in machine().items())
        return found
