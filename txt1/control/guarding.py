"""A guard of the safety gate that may fail: the robot then stands, and the run goes on."""

from collections.abc import Callable
from math import isfinite

from txt1.control.limits import Guard


def contained(name: str, guard: Guard, tell: Callable[[float, str], None]) -> Guard:
    """Return the guard; once it raises, or returns anything but two finite numbers, it allows only 0.

    `tell` then adds a line to the event log, once.
    """
    failed = False

    def guarded(v: float, omega: float, now: float) -> tuple[float, float]:
        nonlocal failed
        if failed:
            return 0.0, 0.0
        try:
            answer = guard(v, omega, now)
            try:
                slower, turning = answer
                if isfinite(slower) and isfinite(turning):
                    return float(slower), float(turning)
            except (TypeError, ValueError, OverflowError):
                pass
            why = f"it returned {answer!r}"
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
        failed = True
        tell(now, f"guard '{name}' failed: {' '.join(why.split())}; the robot stands for the rest of the run")
        return 0.0, 0.0

    return guarded
