"""The metrics of a run, or of several side by side, as tables for the terminal and for Markdown."""

from collections.abc import Callable, Sequence
from itertools import product
from math import sqrt
from typing import Any

from rich.console import Console
from rich.table import Table

from txt1.experiments.metrics import QUANTUM, Channel, Deviation, difference, paths_apart
from txt1.experiments.run_folder import Run

TableRow = list[str]
# a table's title, its column names and its rows
Titled = tuple[str, TableRow, list[TableRow]]


def show(runs: Sequence[Run], console: Console, *, with_differences: bool = False) -> None:
    """Print the tables of runs, several side by side, and their differences if requested."""
    for title, head, rows in [*tables(runs), *(apart(runs) if with_differences else ())]:
        table = Table(title=title, title_justify="left")
        for name in head:
            table.add_column(name, justify="right")
        for row in rows:
            table.add_row(*row)
        console.print(table)
    for result in runs:
        told = result.metrics
        warned = told.get("battery_warning_s")
        warning = "" if warned is None else f"; battery warning after {warned / 60.0:.1f} min"
        console.print(
            f"{result.label}: ended by {told['stopped_by']} after {told['duration_s']:.1f} s{warning}; "
            f"judged by {told['judged_by']}",
            markup=False,
            highlight=False,
        )


def tables(runs: Sequence[Run]) -> list[Titled]:
    """Return title, column names and rows of every table for which the runs have values."""
    found: list[Titled] = []
    for title, key, head, cells in _TABLES:
        entries = [_entries(result, key) for result in runs]
        rows = [
            ([result.label] if len(runs) > 1 else []) + cells(entry[number])
            for number in range(max(map(len, entries)))
            for result, entry in zip(runs, entries, strict=True)
            if number < len(entry)
        ]
        if rows:
            found.append((title, (["run"] if len(runs) > 1 else []) + head, rows))
    return found


def apart(runs: Sequence[Run]) -> list[Titled]:
    """Return the difference between each run's responses and path and those of the first run."""
    first, found = runs[0], list[Titled]()
    channels: tuple[Channel, ...] = ("v", "omega")
    responses = []
    for other, channel in product(runs[1:], channels if first.profile.waypoints is None else ()):
        each = difference(first.recording, other.recording, channel)
        if each is not None:
            responses.append([other.label, *difference_cells(each)])
    if responses:
        head = ["run", "of", "later by", "difference, rms", "largest", "one count"]
        found.append((f"Responses, less those of {first.label}, 1/1000 m/s and rad/s", head, responses))
    if first.profile.figure != "velocities":
        distances = [(other.label, paths_apart(first.recording, other.recording)) for other in runs[1:]]
        rows = [[label, *map(_mm, metres)] for label, metres in distances]
        found.append((f"Distance from the path of {first.label}", ["run", "rms", "largest"], rows))
    return found


def difference_cells(each: Deviation) -> TableRow:
    """Return the channel, the delay, the difference, and an encoder count for comparison."""
    least, most = (1000.0 * delay for delay in each.delay)
    late = f"{least:.0f} ms" if least == most else f"{least:.0f} to {most:.0f} ms"
    sizes = f"{1000.0 * each.rms:.1f}", f"{1000.0 * each.largest:.1f}", f"{1000.0 * QUANTUM[each.channel]:.0f}"
    return ["v" if each.channel == "v" else "ω", late, *sizes]


def _entries(result: Run, key: str) -> list[Any]:
    entry = result.metrics.get(key, [])
    if key == "legs":
        return _over_laps(entry)
    return entry if isinstance(entry, list) else [entry]


def _over_laps(legs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the legs of a lap, each with its errors in all laps."""
    laps: dict[str, list[dict[str, Any]]] = {}
    for leg in legs:
        laps.setdefault(f"{leg['start']}{leg['end']}", []).append(leg)
    rms = [sqrt(sum(leg["rms"] ** 2 for leg in same) / len(same)) for same in laps.values()]
    largest = [max(leg["largest"] for leg in same) for same in laps.values()]
    firsts = [same[0] for same in laps.values()]
    return [leg | {"rms": one, "largest": most} for leg, one, most in zip(firsts, rms, largest, strict=True)]


def step_name(step: dict[str, Any]) -> str:
    """Return a step in words."""
    return f"{'v' if step['channel'] == 'v' else 'ω'} {step['before']:g} → {step['after']:g}"


def _step(step: dict[str, Any]) -> TableRow:
    off, noise = f"{1000.0 * step['steady_error']:+.1f}", f"{1000.0 * step['noise']:.1f}"
    return [step_name(step), _seconds(step["rise"]), overshoot(step), _seconds(step["settling"]), off, noise]


def overshoot(step: dict[str, Any]) -> str:
    """Return the overshoot of a step, %, with its standard error for repeated runs."""
    error = step["overshoot_error"]
    return f"{100.0 * step['overshoot']:.1f} {'' if error is None else f'± {100.0 * error:.1f} '}%"


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f} s"


def _mm(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{1000.0 * value:.{digits}f} mm"


_STEP_HEAD = ["step", "rise", "overshoot", "settling", "off, 1/1000", "noise, 1/1000"]
_TABLES: tuple[tuple[str, str, TableRow, Callable[[dict[str, Any]], TableRow]], ...] = (
    ("Steps, m/s and rad/s", "steps", _STEP_HEAD, _step),
    ("Stops, m/s", "stops", _STEP_HEAD, _step),
    ("Loss of speed in the second after a change of the yaw rate, rad/s", "droop", ["change", "droop"],
     lambda one: [f"{one['before']:g} → {one['after']:g}", f"{100.0 * one['droop']:.1f} %"]),
    ("Circle", "circle", ["radius", "v / ω", "lap to lap"],
     lambda one: [f"{one['radius']:.3f} m", f"{one['asked']:.3f} m", _mm(one["lap_to_lap"])]),
    ("Off the leg, round the corner, in all laps", "legs", ["leg", "rms", "largest"],
     lambda one: ["({:g}, {:g}) → ({:g}, {:g})".format(*one["start"], *one["end"]),
                  _mm(one["rms"], 0), _mm(one["largest"], 0)]),
    ("Battery", "battery", ["slope", "intercept", "driven", "remaining time off by"],
     lambda one: [f"{one['slope']:.6f} V/min ({100.0 * one['slope_error']:+.2f} %)",
                  f"{one['intercept']:.4f} V ({100.0 * one['intercept_error']:+.2f} %)",
                  f"{one['driven']:.1f} min",
                  f"{one['remaining_rms']:.0f} s, worst {one['remaining_worst']:.0f} s"]),
)  # fmt: skip
