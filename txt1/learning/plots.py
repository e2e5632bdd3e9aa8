"""Pictures of the learning: the curve, paths, the table and where it drives. Needs matplotlib (extra `plots`).

They know no learner: what one adds to them (a table beside its own, where it drives) stands in its module.
"""

from collections.abc import Callable, Sequence
from math import cos, sin
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1.errors import MissingExtra
from txt1.learning.best_time import Floor
from txt1.learning.qtable import ACTIONS, StoredTable
from txt1.learning.registry import of_module
from txt1.learning.trial import Task, TrialResult
from txt1.model.light_sensors import MOUNT, SENSORS

DPI: Final = 120
# a table with more numbers is drawn without them, by colours only
LEGIBLE: Final = 200
# in, one path and one part of a table across: letters can be read where all are shown 600 pixels wide
PATH, PART = 3.2, 4.8
# of the trials, for an interval
RESAMPLES: Final = 500
# the colour-blind, too, tell them apart (Okabe, Ito)
BLUE, RED, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "0.6"


def draw(
    out: Path, outcomes: Sequence[TrialResult], chosen: TrialResult, task: Task, floor: Floor | None = None
) -> None:
    """Write times.png, learning_curve.png and paths.png, and qtable.png where a learner has something to show in it.

    With a floor (`txt1.learning.best_time`) the curve has the ratio to it, too.
    """
    _picture(out / "times.png", 8.0, 4.0, lambda figure: _seconds(figure, outcomes))
    _picture(out / "learning_curve.png", 8.0, 4.7, lambda figure: _curve(figure, outcomes, floor))
    _picture(out / "paths.png", PATH * max(1, len(chosen.paths)), 3.6, lambda figure: _paths(figure, chosen, task))
    table = chosen.table
    # the table, and beside it the driving directions, as far as they exist
    parts: list[Callable[[Any, float], None]] = []
    learner = str(table.about.get("agent"))
    if of_module(learner, "TABLE_IS_DRAWN", True):
        parts.append(lambda figure, left: _table(figure, left, table))
    title, reported = of_module(learner, "REPORTED", ("", ()))
    if np.shape(reported) == table.shape:
        beside = StoredTable(np.array(reported), {**table.about, "title": title})
        parts.append(lambda figure, left: _table(figure, left, beside))
    courses = of_module(learner, "courses", None)
    if courses is not None:
        parts.append(lambda figure, left: _floor(figure, left, table, task, courses))
    if parts:
        width = PART * len(parts)
        _picture(out / "qtable.png", width, 4.5, lambda figure: [one(figure, PART * k) for k, one in enumerate(parts)])


def _picture(file: Path, width: float, height: float, paint: Callable[[Any], object]) -> None:
    """Write a picture of this size, in; raises MissingExtra."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtra("drawing pictures", "plots") from None
    # no pyplot: no window, no state
    figure = Figure(figsize=(width, height), dpi=DPI)
    paint(figure)
    # half the time, 6 % more bytes
    figure.savefig(file, pil_kwargs={"compress_level": 1})


def _panel(figure: Any, left: float, bottom: float, width: float, height: float) -> Any:
    """Place axes, title and labels in inches: matplotlib's own layout takes longer than all the rest."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.set_title("", y=1.0)
    axes.xaxis.set_label_coords(0.5, -0.28 / height)
    axes.yaxis.set_label_coords(-0.48 / width, 0.5)
    return axes


def _seconds(figure: Any, outcomes: Sequence[TrialResult]) -> None:
    """Draw the seconds of each episode, as figure 5.10 has them: blue the trials, bold red their mean, failures too."""
    from matplotlib.ticker import MaxNLocator

    axes = _panel(figure, 0.65, 0.475, 7.2, 3.1)
    length = max((len(one.episodes) for one in outcomes), default=0)
    for trial in outcomes:
        axes.plot([one.number for one in trial.episodes], [one.time for one in trial.episodes], color=BLUE, lw=0.8)
    means = [np.mean([one.episodes[k].time for one in outcomes if len(one.episodes) > k]) for k in range(length)]
    axes.plot(range(1, length + 1), means, color=RED, lw=3.0)
    axes.set(xlabel="episode", ylabel="time, s", xlim=(0.5, length + 0.5))
    axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(alpha=0.3)
    count = f"{len(outcomes)} trial{'s' if len(outcomes) > 1 else ''}"
    figure.suptitle(f"{count} (blue) and their mean (red), as figure 5.10", y=0.985, fontsize=10)


def _curve(figure: Any, outcomes: Sequence[TrialResult], floor: Floor | None) -> None:
    """Draw the ratio of each episode's time to its optimum, which removes the luck of the starts (cf. figure 5.10).

    It shows every trial, the mean of the successes with an interval of 95 % over trials, the mean ratio to the floor,
    and the number of failures.
    """
    from matplotlib import ticker
    from matplotlib.collections import LineCollection

    axes = _panel(figure, 0.65, 0.475, 7.2, 3.5)
    length = max((len(one.episodes) for one in outcomes), default=0)
    lines = [[(one.number, one.time / one.optimal_time) for one in trial.episodes if one.success] for trial in outcomes]
    alpha = max(0.05, min(0.6, 4.0 / len(outcomes)))
    shown = [line for line in lines if line]
    axes.add_collection(LineCollection(shown, colors=BLUE, alpha=alpha, linewidths=0.8, label="each trial"))
    numbers, means, to_floor, low, high, failed = [], [], [], [], [], []
    rng = np.random.default_rng(0)
    for k in range(length):
        row = [one.episodes[k] for one in outcomes if len(one.episodes) > k]
        failed.append(sum(not one.success for one in row))
        won = [one for one in row if one.success]
        pairs = np.array([(one.time, one.optimal_time) for one in won])
        if not len(pairs):
            continue
        drawn = pairs[rng.integers(0, len(pairs), (RESAMPLES, len(pairs)))].sum(axis=1)
        band = np.percentile(drawn[:, 0] / drawn[:, 1], (2.5, 97.5))
        numbers.append(k + 1)
        means.append(pairs[:, 0].sum() / pairs[:, 1].sum())
        low.append(band[0])
        high.append(band[1])
        if floor is not None:
            to_floor.append(pairs[:, 0].sum() / sum(floor.time(one.start) for one in won))
    axes.plot(numbers, means, color=RED, lw=2.5, label="mean of successes")
    axes.fill_between(numbers, low, high, color=RED, alpha=0.25, lw=0.0, label="its interval of 95 %")
    if floor is not None:
        axes.plot(numbers, to_floor, color="black", lw=1.2, ls=":", label="mean, time / floor")
    axes.axhline(1.0, color=GREEN, lw=2.0, ls="--", label="optimum")
    lost = [(k, count) for k, count in enumerate(failed, 1) if count]
    top = max([2.0, *(ratio for line in shown for _, ratio in line)]) * 1.3
    if lost:
        axes.plot([k for k, _ in lost], [top] * len(lost), "x", color="black", label="failures, and how many")
        for k, count in lost:
            axes.annotate(str(count), (k, top), (0, 4), textcoords="offset points", ha="center", fontsize=8)
    agents = " and ".join(sorted({str(one.table.about.get("agent")) for one in outcomes}))
    axes.set(xlabel="episode", ylabel="time / optimum", yscale="log", xlim=(0.5, length + 0.5), ylim=(0.9, 1.25 * top))
    axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(ticker.NullLocator())
    axes.xaxis.set_major_locator(ticker.MaxNLocator(integer=True))
    axes.grid(alpha=0.3)
    figure.suptitle(f"{agents}, {len(outcomes)} trial{'s' if len(outcomes) > 1 else ''}", y=0.985, fontsize=10)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, fontsize=8, frameon=False)


def _paths(figure: Any, chosen: TrialResult, task: Task) -> None:
    """Paths in the room, as in figures 5.8 and 5.9."""
    numbers = sorted(chosen.paths)
    if not numbers:
        return
    for k, number in enumerate(numbers):
        axes = _panel(figure, PATH * k + 0.66, 0.45, 2.5, 2.5)
        x, y = np.array(chosen.paths[number]).T
        axes.plot(x, y, color=BLUE)
        axes.plot(x[0], y[0], "o", color=RED)
        title = f"episode {number}"
        # otherwise the episode was broken off
        if len(chosen.episodes) >= number:
            one = chosen.episodes[number - 1]
            tip = x[0] + 0.4 * cos(one.start.heading), y[0] + 0.4 * sin(one.start.heading)
            axes.annotate("", tip, (x[0], y[0]), arrowprops={"arrowstyle": "->"})
            title += f": {'reached' if one.success else 'lost'} after {one.time:.1f} s"
        axes.plot(*task.light, "*", color="gold", markersize=18, markeredgecolor=GREY)
        angle = np.linspace(0.0, 2.0 * np.pi, 100)
        for radius, style in ((task.goal_radius, "-"), (task.start_radius, ":")):
            around = task.light[0] + radius * np.cos(angle), task.light[1] + radius * np.sin(angle)
            axes.plot(*around, style, color=GREY, lw=1.0)
        corners = task.boundary * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
        axes.plot(*corners.T, "--", color=GREY, lw=1.0)
        reach = max(1.6, float(np.abs(np.concatenate([x, y])).max()) + 0.2)
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x, m", ylabel="y, m")
        axes.set_title(title, fontsize=10)
    figure.suptitle(f"best trial ({chosen.trial})", y=0.985, fontsize=10)


def _floor(figure: Any, edge: float, table: StoredTable, task: Task, courses: Callable[..., Any]) -> None:
    """Draw the direction in which it drives for each place of the light, and its estimate of the sensors' places."""
    axes = _panel(figure, edge + 0.9, 0.475, 3.7, 3.45)
    reach = 4.0 * task.goal_radius
    ahead, left = (each.ravel() for each in np.meshgrid(*[np.linspace(-reach, reach, 15)] * 2, indexing="ij"))
    outside = np.hypot(ahead, left) > task.goal_radius
    ahead, left = ahead[outside], left[outside]
    turns = np.asarray(courses(table, np.column_stack([ahead, left])))
    # up is straight on
    turned = 0.5 * np.pi * turns / (np.abs(turns).max() or 1.0) + 0.5 * np.pi
    colours = np.where(turns > 0.3 * turns.max(), BLUE, np.where(turns < 0.3 * turns.min(), RED, GREEN))
    axes.quiver(-left, ahead, np.cos(turned), np.sin(turned), color=colours, pivot="mid", scale=26.0, width=0.005)
    for colour, way in ((BLUE, "left"), (GREEN, "straight"), (RED, "right")):
        axes.plot([], [], ">", color=colour, label=way)
    for name, (x, y) in zip(SENSORS, table.about.get("sensors", MOUNT), strict=True):
        axes.plot(-y, x, "ks", markersize=4, label="" if name != SENSORS[0] else "sensors")
        axes.annotate(name, (-y, x), (3, 3), textcoords="offset points", fontsize=9)
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    axes.plot(task.goal_radius * np.cos(angle), task.goal_radius * np.sin(angle), color=GREY, label="goal")
    axes.set(xlabel="light to the right, m", ylabel="light ahead, m", aspect="equal")
    axes.yaxis.set_label_coords(-0.62 / 3.7, 0.5)
    axes.set_title("which way it drives, by where the light is", y=1.06)
    axes.legend(
        loc="lower center", bbox_to_anchor=(0.5, 0.985), ncols=5, fontsize=8, frameon=False, columnspacing=1.0,
        handletextpad=0.3, handlelength=1.2,
    )  # fmt: skip


def _table(figure: Any, edge: float, table: StoredTable) -> None:
    """Draw the Q-table as a heat map."""
    axes, scale = _panel(figure, edge + 1.0, 0.28, 3.0, 3.9), _panel(figure, edge + 4.12, 0.28, 0.15, 3.9)
    values = np.asarray(table.values)
    most = float(np.abs(values).max())
    image = axes.imshow(values, aspect="auto", cmap="PuOr", vmin=-most, vmax=most)
    actions = table.about.get("actions", ACTIONS)
    if len(actions) == values.shape[1]:
        axes.set_xticks(range(len(actions)), actions)
    axes.set_yticks(range(len(values)), list(table.about.get("states", range(len(values)))))
    for (row, column), value in np.ndenumerate(values) if values.size <= LEGIBLE else ():
        ink = "white" if abs(value) > 0.6 * most else "black"
        axes.text(column, row, f"{value:.2f}", ha="center", va="center", color=ink)
    axes.set_title(table.about.get("title", "Q(s, a)"))
    figure.colorbar(image, scale)
