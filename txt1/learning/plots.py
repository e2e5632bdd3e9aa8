"""Pictures of what was learned: the learning curve, some paths, the Q-table. Needs matplotlib (extra `plots`)."""

from collections.abc import Callable, Sequence
from math import cos, sin
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1.errors import MissingExtra
from txt1.learning.qtable import ACTIONS, StoredTable
from txt1.learning.trial import Task, TrialResult

DPI: Final = 120
BLUE, RED, GREEN, GREY = "tab:blue", "tab:red", "tab:green", "0.6"


def draw(out: Path, outcomes: Sequence[TrialResult], chosen: TrialResult, task: Task) -> list[Path]:
    """The pictures that were written: learning_curve.png, paths.png, qtable.png; raises MissingExtra."""
    try:
        from matplotlib import colormaps, ticker
        from matplotlib.collections import LineCollection
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtra("drawing pictures", "plots") from None
    paintings: tuple[tuple[str, tuple[float, float], Callable[[Any], None]], ...] = (
        ("learning_curve.png", (8.0, 4.5), lambda figure: _curve(figure, outcomes, ticker, LineCollection)),
        ("paths.png", (4.5 * max(1, len(chosen.paths)), 4.8), lambda figure: _paths(figure, chosen, task)),
        ("qtable.png", (6.0, 4.5), lambda figure: _table(figure, chosen.table, colormaps)),
    )
    pictures = []
    for name, size, paint in paintings:
        figure = Figure(figsize=size, dpi=DPI)  # no pyplot: no window, no state
        paint(figure)
        path = out / name
        figure.savefig(path, pil_kwargs={"compress_level": 1})  # half the time, 6 % more bytes
        pictures.append(path)
    return pictures


def _panel(figure: Any, left: float, bottom: float, width: float, height: float) -> Any:
    """Axes, title and labels at places in inches, as finding them takes matplotlib longer than all the rest."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.set_title("", y=1.0)
    axes.xaxis.set_label_coords(0.5, -0.28 / height)
    axes.yaxis.set_label_coords(-0.48 / width, 0.5)
    return axes


def _curve(figure: Any, outcomes: Sequence[TrialResult], ticker: Any, line_collection: Any) -> None:
    """Time of each episode: every trial, their mean and median, the optimum (figure 5.10)."""
    axes = _panel(figure, 0.65, 0.475, 7.2, 3.775)
    length = max((len(one.episodes) for one in outcomes), default=0)
    begun = [one.episodes for one in outcomes if one.episodes]  # a trial may be ended in its first one
    lines = [[(episode.number, episode.time) for episode in episodes] for episodes in begun]
    alpha = max(0.05, min(0.6, 4.0 / len(outcomes)))
    axes.add_collection(line_collection(lines, colors=BLUE, alpha=alpha, linewidths=0.8, label="each trial"))
    rows = [[one.episodes[k] for one in outcomes if len(one.episodes) > k] for k in range(length)]
    numbers = range(1, length + 1)
    times = [[one.time for one in row] for row in rows]
    best = [np.mean([one.optimal_time for one in row]) for row in rows]
    axes.plot(numbers, [np.mean(row) for row in times], color=RED, lw=2.5, label="mean")
    axes.plot(numbers, [np.median(row) for row in times], color=RED, lw=1.2, ls="--", label="median")
    axes.plot(numbers, best, color=GREEN, lw=2.0, label="optimum")
    agents = " and ".join(sorted({str(one.table.about.get("agent")) for one in outcomes}))
    title = f"{agents}, {len(outcomes)} trial{'s' if len(outcomes) > 1 else ''}"
    axes.set(xlabel="episode", ylabel="time, s", yscale="log", title=title, xlim=(0.5, length + 0.5))
    axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 3.0, 5.0, 7.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(ticker.NullLocator())
    axes.xaxis.set_major_locator(ticker.MaxNLocator(integer=True))
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right")


def _paths(figure: Any, chosen: TrialResult, task: Task) -> None:
    """Paths in the room, as in figures 5.8 and 5.9."""
    numbers = sorted(chosen.paths)
    if not numbers:
        return
    for k, number in enumerate(numbers):
        axes = _panel(figure, 4.5 * k + 0.66, 0.5, 3.8, 3.8)
        x, y = np.array(chosen.paths[number]).T
        axes.plot(x, y, color=BLUE)
        axes.plot(x[0], y[0], "o", color=RED)
        title = f"trial {chosen.trial}, episode {number}"
        if len(chosen.episodes) >= number:  # else it was broken off
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
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x, m", ylabel="y, m", title=title)


def _table(figure: Any, table: StoredTable, colormaps: Any) -> None:
    """The Q-table as a heat map; where it says what its `axes` are (label, cells, from, to), the best actions."""
    if "axes" in table.about:
        (across, columns, *x), (up, rows, *y) = table.about["axes"]
        best = np.asarray(table.values).reshape(columns, rows, -1).argmax(axis=2).T
        axes, scale = _panel(figure, 0.7, 0.475, 4.2, 3.775), _panel(figure, 5.1, 0.475, 0.2, 3.775)
        colours = colormaps["viridis"].resampled(len(ACTIONS))
        image = axes.imshow(
            best, aspect="auto", origin="lower", extent=(*x, *y), cmap=colours, vmin=-0.5, vmax=len(ACTIONS) - 0.5
        )
        axes.set(xlabel=across, ylabel=up, title="best action")
        figure.colorbar(image, scale, ticks=range(len(ACTIONS))).set_ticklabels(ACTIONS)
        return
    axes, scale = _panel(figure, 0.97, 0.28, 4.04, 3.97), _panel(figure, 5.2, 0.28, 0.2, 3.97)
    image = axes.imshow(table.values, aspect="auto", cmap="RdYlGn")
    axes.set_xticks(range(len(ACTIONS)), ACTIONS)
    axes.set_yticks(range(len(table.values)), table.about.get("states", range(len(table.values))))
    for (row, column), value in np.ndenumerate(table.values):
        axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=8)
    axes.set_title("Q(s, a)")
    figure.colorbar(image, scale)
