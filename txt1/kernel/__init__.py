"""Time: clocks, event loops in real and virtual time, and the scheduler of periodic tasks."""

from txt1.kernel.clock import Clock, RealClock, VirtualClock
from txt1.kernel.loop import RealTimeLoop, Speed, VirtualTimeLoop, clock_of, new_loop, run
from txt1.kernel.scheduler import Scheduler
from txt1.kernel.statistics import Histogram, Percentiles, TaskStatistics
from txt1.kernel.ticks import Ticks

__all__ = [
    "Clock",
    "Histogram",
    "Percentiles",
    "RealClock",
    "RealTimeLoop",
    "Scheduler",
    "Speed",
    "TaskStatistics",
    "Ticks",
    "VirtualClock",
    "VirtualTimeLoop",
    "clock_of",
    "new_loop",
    "run",
]
