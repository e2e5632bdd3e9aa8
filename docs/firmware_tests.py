"""`python -m docs.firmware_tests`: docs/results/firmware-tests.md, the thesis's tests with the Pico's firmware.

Beside it drive the virtual board and the simulation, and `txt1 tune` finds the vehicle through it. Takes a minute.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from datetime import date
from typing import Any, Final

from matplotlib.figure import Figure

from docs.drive_tests import DRIVES, HERE, NAMES, SERIAL, behind_the_wire, run
from txt1.cli import execute
from txt1.experiments.metrics import response
from txt1.experiments.profile import load_profile
from txt1.experiments.run_folder import Run

PICO: Final = ("hal=serial", "serial.port=pico")
STYLES: Final = (("#0072b2", 2.6), ("#e69f00", 1.5), ("black", 0.7))  # colours that all eyes tell apart; line widths

INTRODUCTION: Final = f"""\
# The firmware in the thesis's drive tests

MicroPython's unix port runs the Pico's firmware, with a simulated vehicle behind its pins. The firmware drives the
thesis's tests beside the virtual board (`txt1 board`) and the simulation without a wire, with seed 1 ({date.today()}).
`python -m docs.firmware_tests` makes this page. No figure was measured on a real Pico.

![The six tests: firmware, virtual board and simulation](firmware-tests.png)

Speeds and yaw rates are means over 0.2 s by the encoders, paths are by odometry; the packs are full at first.
"""

DIFFERENCES: Final = """\
## The differences

Board and firmware beside the simulation, by the encoders of each, as in
[the drive tests](drive-tests.md#behind-the-wire).
"""


def main() -> None:
    """Drive, draw and write."""
    kinds = (("simulation", ()), ("virtual board", SERIAL), ("firmware", PICO))
    by_kind = [{name: run(load_profile(name), label, "seed=1", *how) for name in NAMES} for label, how in kinds]
    figure = Figure(figsize=(8.0, 5.8), layout="constrained")
    for axes, name in zip(figure.subplots(2, 3).ravel(), NAMES, strict=True):
        panel(axes, name, [runs[name] for runs in by_kind])
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.savefig(HERE / "firmware-tests.png", dpi=150)
    again = {name: run(load_profile(name), "simulation, another seed", "seed=2") for name in DRIVES}
    ends = "\n".join(
        f"- {runs['battery-run'].label}: {runs['battery-run'].metrics['stopped_by']} after "
        f"{runs['battery-run'].recording['time'][-1] / 60.0:.1f} min"
        for runs in by_kind
    )
    parts = [
        INTRODUCTION,
        behind_the_wire(by_kind[0], [again, *by_kind[1:]], DIFFERENCES),
        f"## The battery run\n\n{ends}\n",
        tuned(),
    ]
    (HERE / "firmware-tests.md").write_text("\n".join(parts).rstrip() + "\n")


def panel(axes: Any, name: str, runs: list[Run]) -> None:
    """Draw one test of all three."""
    curve, (across, up) = CURVES[runs[0].profile.figure]
    if name == "angular-steps":
        curve, up = yaw_rate, "yaw rate, rad/s"
    for each, (colour, width) in zip(runs, STYLES, strict=True):
        x, y = curve(each)
        axes.plot(x, y, color=colour, linewidth=width, label=each.label)
    axes.set(title=name, xlabel=across, ylabel=up)
    if up == "y, m":
        axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)


def speed(one: Run) -> tuple[Any, Any]:
    """Return times and speeds."""
    return one.recording["time"], response(one.recording.without_truth(), "v")


def yaw_rate(one: Run) -> tuple[Any, Any]:
    """Return times and yaw rates."""
    return one.recording["time"], response(one.recording.without_truth(), "omega")


def path(one: Run) -> tuple[Any, Any]:
    """Return places by odometry."""
    return one.recording["x"], one.recording["y"]


def voltage(one: Run) -> tuple[Any, Any]:
    """Return minutes and the battery's voltage."""
    return one.recording["time"] / 60.0, one.recording["voltage"]


CURVES: Final[dict[str, tuple[Callable[[Run], tuple[Any, Any]], tuple[str, str]]]] = {
    "velocities": (speed, ("time, s", "speed, m/s")),
    "path": (path, ("x, m", "y, m")),
    "waypoints": (path, ("x, m", "y, m")),
    "battery": (voltage, ("time, min", "voltage, V")),
}


def tuned() -> str:
    """What `txt1 tune` finds through each of them."""
    parts = ["## Tuning\n\nThe vehicle that `txt1 tune --seed 1 --no-trial` finds, by hand and through either board:\n"]
    for label, words in (
        ("simulation", ()),
        ("virtual board", ("--hal", "serial", "--port", "virtual")),
        ("firmware", ("--hal", "serial", "--port", "pico")),
    ):
        told = io.StringIO()
        with contextlib.redirect_stdout(told):
            assert execute(["tune", "--seed", "1", "--no-trial", *words]) == 0
        parts += [f"- {label}: {'; '.join(told.getvalue().splitlines()[:2])}"]
    return "\n".join(parts)


if __name__ == "__main__":
    main()
