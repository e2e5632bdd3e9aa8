"""The tasks' statistics and the counts of faults, as ROS's diagnostics."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple

from txt1.kernel.statistics import Histogram, TaskStatistics
from txt1.tasks.fields import TaskReport
from txt1.telemetry.topics import Rule, Topic, declare


class TaskCount(NamedTuple):
    """Cycles run and missed of one task; its lateness and run time on the real clock."""

    cycles: int
    misses: int
    lateness: Histogram | None = None
    run_time: Histogram | None = None


# by name of task
TaskCounts = dict[str, TaskCount]


def task_counts(tasks: Mapping[str, TaskStatistics], times: bool) -> TaskCounts:
    """Return the present statistics, with the `times` or without."""
    return {
        name: TaskCount(task.cycles, task.misses, *((task.lateness.copy(), task.run_time.copy()) if times else ()))
        for name, task in tasks.items()
    }


class Reports:
    """The published statistics of the tasks.

    They are computed no more often than needed, because summing up takes time.

    Args:
        statistics: of every task so far, by name.
        virtual: whether time is virtual; lateness and run time are left out then, as they are the processor's.

    """

    def __init__(self, statistics: Callable[[], Mapping[str, TaskStatistics]], virtual: bool) -> None:
        self._statistics, self._virtual = statistics, virtual
        # priority and period (s), by name
        self._tasks: dict[str, tuple[int, float | None]] = {}
        self._reports: dict[str, TaskReport] = {}
        self._next = 0
        self._counts: TaskCounts | None = None
        self._counted_at = 0.0

    def __len__(self) -> int:
        """The number of tasks."""
        return len(self._tasks)

    def add(self, name: str, priority: int, period: float | None) -> None:
        """Report on another task; its period in s is None if it runs on arrival."""
        self._tasks[name] = priority, period

    def counts(self, now: float, running: bool) -> TaskCounts:
        """Return the counts of all tasks.

        In virtual time the counts of a running robot are renewed only once in ten seconds.
        """
        if not (self._virtual and running and self._counts) or now >= self._counted_at + 10.0:
            self._counts, self._counted_at = task_counts(self._statistics(), not self._virtual), now
        return self._counts

    def newest(self) -> tuple[TaskReport, ...]:
        """Return the reports of all tasks. Each call renews the report of one task."""
        names = list(self._tasks)
        due = [name for name in names if name not in self._reports] or [names[self._next % len(names)]]
        self._next += 1
        self._reports.update((name, self._report(name)) for name in due)
        return tuple(self._reports.values())

    def _report(self, name: str) -> TaskReport:
        priority, period = self._tasks[name]
        task = self._statistics()[name]
        times = task.lateness.percentiles(), task.run_time.percentiles()
        return TaskReport(name, priority, None if period is None else 1.0 / period, task.cycles, task.misses, *times)


def _array(statuses: Iterable[tuple[int, str, str, Mapping[str, object]]]) -> dict[str, object]:
    return {
        "status": [
            {
                "level": level,
                "name": name,
                "message": message,
                "hardware_id": "txt1",
                "values": [{"key": key, "value": str(value)} for key, value in values.items()],
            }
            for level, name, message, values in statuses
        ]
    }


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


TASKS: Final = declare(
    Topic[TaskCounts](
        "/diagnostics",
        dict,
        "s",
        "diagnostic_msgs/DiagnosticArray",
        Rule.SECOND,
        "the tasks' cycles, misses and times",
        make=_tasks,
        in_snapshots=False,
    )
)
# counts of values that the gate kept within its limits. They are no faults, so screens leave them out
LIMITED: Final = ("speed_clipped", "yaw_rate_clipped", "pwm_clipped", "motor_limited", "steering_limited")
FAULTS: Final = declare(
    Topic[dict[str, int]](
        "/faults",
        dict,
        "",
        "diagnostic_msgs/DiagnosticArray",
        Rule.SECOND,
        "everything counted as a fault",
        make=lambda counts: _array([(1 if counts else 0, "faults", "", counts)]),
    )
)
