"""A run in one JSON object."""

from __future__ import annotations

from typing import Any

from txt1.kernel.statistics import TaskStatistics
from txt1.runtime import Runtime
from txt1.tasks.fields import DRIVER
from txt1.telemetry.snapshot import plain
from txt1.telemetry.topics import Rule


def report(runtime: Runtime) -> dict[str, Any]:
    """What `--json` prints. Of it, `wall_time_s` and `run_time_s` are measured on the wall clock."""
    battery = runtime.state.battery
    return {
        "sim_time_s": round(runtime.now, 9),
        "wall_time_s": runtime.scheduler.wall_time,
        "seed": runtime.config.seed,
        "tasks": {name: _task_report(task) for name, task in runtime.statistics().items()},
        "odometry": runtime.state.odometry._asdict(),
        "battery": {**battery._asdict(), "state": battery.state and battery.state.value},
        "sensors": {name: polled.state()._asdict() for name, polled in runtime.sensors.items()},
        "driver": plain(runtime.bus.read(DRIVER)),
        "armed": runtime.gate.armed,
        "faults": runtime.faults(),
        "topics": {
            topic.name: plain(value)
            for topic in runtime.bus.offered
            if topic.in_snapshots and topic.rule is not Rule.SNAPSHOT and (value := runtime.bus.read(topic)) is not None
        },
    }


def _task_report(task: TaskStatistics) -> dict[str, Any]:
    return {
        "cycles": task.cycles,
        "misses": task.misses,
        "lateness_s": task.lateness.percentiles()._asdict(),
        "run_time_s": task.run_time.percentiles()._asdict(),
    }
