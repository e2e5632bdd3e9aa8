"""How the tasks do and what went wrong, as ROS's diagnostics say it."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from txt1.kernel.statistics import Histogram, TaskStatistics
from txt1.telemetry.topics import Rule, Topic, declare


class TaskCount(NamedTuple):
    """One task's cycles run and missed; lateness and run time on the real clock."""

    cycles: int
    misses: int
    lateness: Histogram | None = None
    run_time: Histogram | None = None


TaskCounts = dict[str, TaskCount]  # by the tasks' names


def task_counts(tasks: Mapping[str, TaskStatistics], times: bool) -> TaskCounts:
    """Return what stands in the statistics now, with the `times` or without."""
    return {
        name: TaskCount(task.cycles, task.misses, *((task.lateness.copy(), task.run_time.copy()) if times else ()))
        for name, task in tasks.items()
    }


def _array(statuses: Iterable[tuple[int, str, str, Mapping[str, object]]]) -> dict[str, object]:
    return {
        "status": [
            {
                "level": level, "name": name, "message": message, "hardware_id": "txt1",
                "values": [{"key": key, "value": str(value)} for key, value in values.items()],
            }
            for level, name, message, values in statuses
        ]
    }  # fmt: skip


def _tasks(tasks: TaskCounts) -> dict[str, object]:
    return _array(
        (
            1 if task.misses else 0,
            f"task {name}",
            f"{task.misses} cycles missed" if task.misses else "punctual",
            {"cycles": task.cycles, "misses": task.misses, **_times(task)},
        )
        for name, task in tasks.items()
    )


def _times(task: TaskCount) -> dict[str, str]:
    return {
        f"{name}_{share}_s": f"{value:.9f}"
        for name, histogram in (("lateness", task.lateness), ("run_time", task.run_time))
        if histogram is not None
        for share, value in histogram.percentiles()._asdict().items()
    }


TASKS: Final = declare(Topic[TaskCounts](
    "/diagnostics", dict, "s", "diagnostic_msgs/DiagnosticArray", Rule.SECOND, "the tasks' cycles, misses and times",
    make=_tasks, in_snapshots=False,
))  # fmt: skip
FAULTS: Final = declare(Topic[dict[str, int]](
    "/faults", dict, "", "diagnostic_msgs/DiagnosticArray", Rule.SECOND, "everything counted as a fault",
    make=lambda counts: _array([(1 if counts else 0, "faults", "", counts)]),
))  # fmt: skip
