"""The thesis's figures (4.3 to 4.6 and 3.13), drawn from one run or from several together."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from txt1.errors import MissingExtra
from txt1.experiments.metrics import QUANTUM, Channel, changes, cross_track, response
from txt1.experiments.recording import Array, Recording
from txt1.experiments.report import step_name
from txt1.experiments.run_folder import Run
from txt1.model.battery import INTERCEPT_V, SAFE_END_MIN, SLOPE_V_PER_MIN

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# s of a step in the figure
STEP_SHOWN: Final = 1.5
# distinct for the colour-blind, too (Okabe, Ito)
COLOURS: Final = ("#0072B2", "#E69F00", "#009E73", "#D55E00")
# so that runs differ by more than colour
STYLES: Final = ("-", "--", "-.", ":")
# styles of up to seven lines
LOOKS: Final[tuple[dict[str, Any], ...]] = tuple(
    {"color": colour, "linestyle": style}
    for colour, style in zip(
        (*COLOURS, "#CC79A7", "#56B4E9", "#000000"), (*STYLES, "-", (0, (5, 1)), (0, (1, 1))), strict=True
    )
)


def draw(runs: Sequence[Run], file: Path, layout: str = "") -> None:
    """Write the figure of a run, or of several runs of a profile; the file's suffix chooses the format.

    `layout` "steps" has a panel for every step, "" is the profile's. Raises MissingExtra: matplotlib is not installed.
    """
    available()
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    profile = runs[0].profile
    layouts = {"velocities": _velocities, "path": _path, "waypoints": _waypoints, "battery": _battery, "steps": _steps}
    layouts[layout or profile.figure](figure, runs)
    figure.suptitle(profile.title + (", step by step" if layout == "steps" else ""))
    # no date and no random ids, so that the same run makes the same file
    metadata = {"Date": None} if file.suffix == ".svg" else None
    with matplotlib.rc_context({"svg.hashsalt": "txt1", "path.simplify_threshold": 0.5}):
        figure.savefig(file, metadata=metadata)


def available() -> None:
    """Raise MissingExtra if drawing is not possible."""
    if find_spec("matplotlib") is None:
        raise MissingExtra("drawing figures (--no-figure does without)", "plots")


def _velocities(figure: Figure, runs: Sequence[Run]) -> None:
    """Draw linear velocity above angular velocity over time, with set-point and response (4.3, 4.4)."""
    above, below = figure.subplots(2, 1, sharex=True)
    panels: tuple[tuple[Any, Channel, str], ...] = ((above, "v", "v, m/s"), (below, "omega", "ω, rad/s"))
    for axes, channel, label in panels:
        for run, look in zip(runs, _looks(runs), strict=False):
            recording = run.recording
            time = recording["time"]
            if len(runs) == 1:
                axes.plot(time, recording[channel], color="0.8", linewidth=0.5, label="each reading of the encoders")
            # from one change of the set-point to the next, so that no mean shows it in advance
            values = np.concatenate([_shown(recording, channel, *between) for between in changes(recording)])
            axes.plot(time, values, **look, label=f"{run.label}, {_response(run)}")
        first = runs[0].recording
        axes.plot(first["time"], first[f"set_{channel}"], "k--", linewidth=0.8, label="set-point")
        middle, half = 0.5 * sum(axes.get_ylim()), 0.5 * float(np.diff(axes.get_ylim())[0])
        axes.set_ylim(middle - max(half, 2.0 * QUANTUM[channel]), middle + max(half, 2.0 * QUANTUM[channel]))
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
    below.set_xlabel("time, s")
    _legend(figure, above)


def _steps(figure: Figure, runs: Sequence[Run]) -> None:
    """Draw each step's response over the time since its set-point changed, and the band in which it has settled."""
    judged = [run.metrics["steps"] for run in runs]
    columns = 4
    panels = figure.subplots(-(-len(judged[0]) // columns), columns, sharex=True, squeeze=False).ravel()
    for panel in panels[len(judged[0]) :]:
        panel.axis("off")
    for number, axes in enumerate(panels[: len(judged[0])]):
        for run, steps, look in zip(runs, judged, _looks(runs), strict=False):
            step, time = steps[number], run.recording["time"]
            first, last = np.searchsorted(time, (step["time"] - 1e-6, step["time"] + STEP_SHOWN))
            values = _shown(run.recording, step["channel"], int(first), int(last))
            axes.plot(time[first:last] - step["time"], values, **look, label=run.label)
            steady = step["after"] + step["steady_error"]
            axes.axhspan(steady - step["band"], steady + step["band"], color=look["color"], alpha=0.1, linewidth=0.0)
            if step["settling"] is not None:
                axes.axvline(step["settling"], color=look["color"], linewidth=0.8, linestyle=":")
        axes.axhline(judged[0][number]["after"], color="k", linewidth=0.8, linestyle="--", label="set-point")
        unit = {"v": "m/s", "omega": "rad/s"}[judged[0][number]["channel"]]
        axes.set_title(f"{step_name(judged[0][number])} {unit}", fontsize="small")
        axes.tick_params(labelsize="x-small")
        axes.grid(alpha=0.3)
        # the lowest axes of the column; the legend would cover a label of all
        if number + columns >= len(judged[0]):
            axes.tick_params(labelbottom=True)
            axes.set_xlabel("time, s", fontsize="x-small")
    figure.supylabel("response, m/s or rad/s", fontsize="small")
    _legend(figure, panels[0], "since the set-point changed; shaded: the band; dotted: settled")


def _looks(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return colour, style and width of each run's line, so that lines on top of each other are all visible."""
    widths = (1.0,) if len(runs) == 1 else (2.4, 1.6, 1.0, 1.0)
    return [
        {"color": colour, "linestyle": style, "linewidth": width}
        for colour, style, width in zip(COLOURS, STYLES, widths, strict=False)
    ]


def _path(figure: Figure, runs: Sequence[Run]) -> None:
    """Draw the path in the plane (4.5, 4.6)."""
    axes = figure.subplots()
    _draw_paths(axes, runs)
    _legend(figure, axes)
    circles = [(run.label, run.metrics["circle"]) for run in runs if run.metrics.get("circle")]
    parts = [f"{label}: radius {one['radius']:.3f} m, v/ω {one['asked']:.3f} m" for label, one in circles]
    if parts:
        axes.set_title("\n".join(parts), fontsize="small")


def _waypoints(figure: Figure, runs: Sequence[Run]) -> None:
    """Draw the path with its waypoints, and the cross-track error over time."""
    figure.set_size_inches(7.0, 6.5)
    above, below = figure.subplots(2, 1, height_ratios=(3, 1))
    waypoints = runs[0].profile.waypoints
    if waypoints is not None:
        x, y = zip(*waypoints.points, waypoints.points[0], strict=True)
        above.plot(x, y, "k--", linewidth=0.8, marker="o", markersize=4, label="waypoints")
    _draw_paths(above, runs)
    for run, look in zip(runs, _looks(runs), strict=False):
        time, legs = run.recording["time"], run.legs
        for number, leg in enumerate(legs):
            until = legs[number + 1].time if number + 1 < len(legs) else np.inf
            on = (time >= leg.time) & (time < until)
            below.plot(time[on], cross_track(run.recording, leg)[on], **look)
    below.axhline(0.0, color="k", linewidth=0.8, linestyle="--")
    below.set(xlabel="time, s", ylabel="off the leg, m")
    below.grid(alpha=0.3)
    _legend(figure, above, f"steered by {', '.join(dict.fromkeys(run.metrics['pose_source'] for run in runs))}")


def _battery(figure: Figure, runs: Sequence[Run]) -> None:
    """Draw the battery's voltage over time, and the line through it (3.13)."""
    axes = figure.subplots()
    ends: dict[str, float] = {}
    for run, look in zip(runs, _looks(runs), strict=False):
        minutes = run.recording["time"] / 60.0
        axes.plot(minutes, run.recording["voltage"], **look, label=f"{run.label}: voltage")
        fit = run.metrics.get("battery")
        if fit:
            at = np.array([0.0, SAFE_END_MIN])
            text = f"its line: {fit['intercept']:.4f} V {1000.0 * fit['slope']:+.3f} mV/min"
            axes.plot(
                at,
                fit["intercept"] + fit["slope"] * at,
                color=look["color"],
                linewidth=0.8,
                linestyle=(0, (1, 4)),
                label=text,
            )
        ends.setdefault(f"{minutes[-1]:.1f} min: {run.metrics['stopped_by']}", float(minutes[-1]))
    for text, end in ends.items():
        axes.axvline(end, color="k", linewidth=0.5)
        axes.annotate(text, (end, 12.6), rotation=90, ha="right", va="top", fontsize=7)
    at = np.array([0.0, SAFE_END_MIN])
    axes.plot(at, INTERCEPT_V - SLOPE_V_PER_MIN * at, "k--", linewidth=0.8, label="the thesis's line")
    axes.set(xlabel="time, min", ylabel="battery voltage, V")
    # the labels of the ends stay above the curve
    axes.set_ylim(top=12.7)
    axes.grid(alpha=0.3)
    _legend(figure, axes)


def _draw_paths(axes: Any, runs: Sequence[Run]) -> None:
    for run, look in zip(runs, _looks(runs), strict=False):
        x, y = run.recording.path()
        axes.plot(x, y, **look, label=f"{run.label}, {_response(run, 'position')}")
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
    # a tall, narrow picture has no room for more
    axes.locator_params(nbins=6)
    axes.grid(alpha=0.3)


def _legend(figure: Figure, axes: Any, title: str | None = None) -> None:
    """Draw the legend of these axes, below everything."""
    figure.legend(
        *axes.get_legend_handles_labels(),
        fontsize="x-small",
        loc="outside lower center",
        ncols=2,
        title=title,
        title_fontsize="x-small",
    )


def _shown(recording: Recording, channel: Channel, first: int, last: int) -> Array:
    """Return the speed (m/s) or yaw rate (rad/s) to draw: the true values, or means of the encoders' values."""
    if recording.knows_truth:
        true: Array = recording[f"true_{channel}"][first:last]
        return true
    return response(recording, channel, first, last)


def _response(run: Run, what: str = "speed") -> str:
    if run.recording.knows_truth:
        return f"true {what}"
    return f"{what}{', 0.2 s means' if what == 'speed' else ''} by the encoders"
