"""What a comparison amounts to: figures, table and picture of contenders, of the lines of its file alone.

A line has the `curve` of a contender's trial, a list of [seconds driven before, rows by COLUMNS]: one pair for who
learns as he drives, one for each checkpoint of who is trained. An interval is of 95 % over trials: as many trials as
there are, are drawn with replacement, `RESAMPLES` times, and the middle 95 % of what they come to is told. Failures are
counted apart and are in no ratio of successes; the columns "of all" have the time they took.
"""

from collections.abc import Sequence
from math import inf, nan
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.errors import MissingExtra
from txt1.learning.experiment import LEARNED

SKILL: Final = 10  # episodes in a row that have to succeed, in so many times their floors together:
SKILLED: Final = 1.25
RESAMPLES: Final = 1000  # of the trials, for an interval of 95 %
TRAINED: Final = ("ppo", "dqn")  # of Stable-Baselines3
ALL: Final = ("thesis", "thesis-10", "sweeps", "pilot", "neural", "taxis", *TRAINED, "homing")
TOLD: Final = {
    "thesis": "places of the sensors, a reward",
    "thesis-10": "places of the sensors, a reward",
    "sweeps": "places of the sensors, a reward, odometry",
    "pilot": "a point light, a power law, odometry",
    "neural": "bright is good",
    "taxis": "bright is good",
    "ppo": "bright is good, seconds cost",
    "dqn": "bright is good, seconds cost",
    "homing": "places of the sensors, what the actions do; learns nothing",
}
Line = dict[str, Any]
Episodes = NDArray[np.float64]  # by COLUMNS, shape (episodes, 4)
COLUMNS: Final = ("time_s", "success", "optimal_time_s", "floor_s")


def judged(lines: Sequence[Line]) -> list[Episodes]:
    """The episodes by which each trial of a contender is judged: after the 7th, or at the last checkpoint."""
    found = []
    for line in lines:
        rows = np.array(line["curve"][-1][1], float)
        found.append(rows if line["contender"] in TRAINED else rows[min(LEARNED, len(rows) - 1) :])
    return found


def until_skill(line: Line) -> float:
    """Seconds driven until the first `SKILL` episodes in a row that all succeed, in `SKILLED` times their floors.

    Infinite: never. Of who is trained the first episodes of each checkpoint's test are looked at.
    """
    for driven, rows in line["curve"]:
        data = np.array(rows, float)
        before = driven + np.concatenate([[0.0], data[:, 0].cumsum()])
        last = 1 if line["contender"] in TRAINED else len(data) - SKILL + 1
        for k in range(max(0, last)):
            some = data[k : k + SKILL]
            if len(some) == SKILL and some[:, 1].all() and some[:, 0].sum() <= SKILLED * some[:, 3].sum():
                return float(before[k])
    return inf


def told(line: Line) -> str:
    """A trial in a few words."""
    if not line["curve"]:
        return f"refused: {line['refused']}"
    (rows,) = judged([line])
    won = rows[rows[:, 1] == 1.0]
    ratio = f"{won[:, 0].sum() / won[:, 3].sum():.3f}" if len(won) else "-"
    return f"{len(won)} of {len(rows)} reached, ratio {ratio}, skilled after (s) {_seconds(until_skill(line))}"


def figures(lines: Sequence[Line]) -> Line:
    """What the trials of one contender amount to; intervals of 95 % over trials."""
    sound = [line for line in lines if line["curve"]]
    found: Line = {"trials": len(lines), "refused": len(lines) - len(sound)}
    if not sound:
        return found
    late = judged(sound)
    every = np.concatenate(late)
    rng = np.random.default_rng(0)
    again = [rng.integers(0, len(late), len(late)) for _ in range(RESAMPLES)]
    sums = np.array([[*(rows[rows[:, 1] == 1.0].sum(axis=0)), (rows[:, 1] == 1.0).sum(), len(rows)] for rows in late])
    drawn = np.array([sums[which].sum(axis=0) for which in again])
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = drawn[:, 0] / drawn[:, 3]
    skill = np.array([until_skill(line) for line in sound])
    medians = [float(np.median(skill[which])) for which in again]
    won = every[every[:, 1] == 1.0]
    found |= {
        "episodes": len(every),
        "failures": len(every) - len(won),
        "success": len(won) / len(every),
        "success_95": _interval(drawn[:, 4] / drawn[:, 5]),
        "to_floor": float(won[:, 0].sum() / won[:, 3].sum()) if len(won) else None,
        "to_floor_95": _interval(ratios[np.isfinite(ratios)]) if len(won) else None,
        "to_optimum": float(won[:, 0].sum() / won[:, 2].sum()) if len(won) else None,
        "seconds": float(won[:, 0].mean()) if len(won) else None,
        "seconds_of_all": float(every[:, 0].mean()),
        "all_to_floor": float(every[:, 0].sum() / every[:, 3].sum()),
        "skilled": int(np.isfinite(skill).sum()),
        "until_skill": float(np.median(skill)),
        "until_skill_95": _interval(np.array(medians)),
        "driven": float(
            np.median(
                [
                    line["curve"][-1][0] if line["contender"] in TRAINED else np.array(line["curve"][-1][1])[:, 0].sum()
                    for line in sound
                ]
            )
        ),
    }
    return found


def _place(line: Line) -> tuple[str, int]:
    """The place of a trial among all: by its contender and number."""
    return line["contender"], line["trial"]


def _interval(values: NDArray[np.float64]) -> list[float]:
    """The middle 95 % of values, which may be infinite."""
    ordered = np.sort(values)
    return [float(ordered[int(share * (len(ordered) - 1))]) for share in (0.025, 0.975)]


def _seconds(value: float) -> str:
    return "never" if value == inf else f"{value:.0f}"


def table(head: Line, lines: Sequence[Line]) -> str:
    """The table in Markdown, those first that have the most failures, then the largest ratio.

    It is the same in whatever order the trials were done.
    """
    by: dict[str, list[Line]] = {}
    for line in sorted(lines, key=_place):
        by.setdefault(line["contender"], []).append(line)
    all_of = {name: figures(some) for name, some in by.items()}
    worst_first = sorted(
        all_of, key=lambda name: (all_of[name].get("success", -1.0), -(all_of[name].get("to_floor") or inf))
    )
    rows = [
        "| contender | is told | seconds, failures with their time | success | to the floor, of successes | of all | "
        "seconds until skilled, median | skilled | trials |",
        "|---" * 9 + "|",
    ]
    for name in worst_first:
        one = all_of[name]
        if "episodes" not in one:
            rows.append(f"| {name} | {TOLD.get(name, '-')} | refuses the sensors{' | -' * 5} | {one['trials']} |")
            continue
        ratio = "-"
        if one["to_floor"] is not None:
            ratio = "{:.3f} ({:.3f} to {:.3f})".format(one["to_floor"], *one["to_floor_95"])
        skill = "{} ({} to {})".format(_seconds(one["until_skill"]), *map(_seconds, one["until_skill_95"]))
        skill = "never" if one["until_skill_95"][0] == inf else skill
        cells = (
            name, TOLD.get(name, "-"), f"{one['seconds_of_all']:.2f}", "{:.2f} % ({:.2f} to {:.2f})".format(
                100.0 * one["success"], *(100.0 * share for share in one["success_95"])
            ),
            ratio, f"{one['all_to_floor']:.3f}", skill, f"{one['skilled']} of {one['trials'] - one['refused']}",
            one["trials"],
        )  # fmt: skip
        rows.append("| " + " | ".join(map(str, cells)) + " |")
    made = head["provenance"]
    hashes: dict[str, list[str]] = {}
    for line in sorted(lines, key=_place):
        hashes.setdefault(line["code"], []).append(line["contender"])
    codes = "; ".join(f"{code} ({', '.join(dict.fromkeys(names))})" for code, names in hashes.items())
    missing = ", ".join(dict.fromkeys(key for line in lines for key in line.get("floor_leaves_out", ())))
    without = f" The floor is that without {missing}." if missing else ""
    versions = ", ".join(f"{name} {made[name]}" for name in made if name not in ("code", "platform"))
    return "\n".join(
        [
            *rows,
            "",
            f"Seed {head['seed']}, {head['episodes']} episodes a trial; in brackets intervals of 95 % over trials "
            f"({RESAMPLES} resamples). Skilled: {SKILL} in a row succeed, in at most {SKILLED:g} times their floor; "
            f"the seconds are those before these.{without}",
            f"Code {codes}; {versions}; {made['platform']}.",
            "",
        ]
    )


def curves(lines: Sequence[Line]) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Of each contender, along its episodes or checkpoints: seconds driven, success and ratio with their intervals."""
    by: dict[str, list[Line]] = {}
    for line in sorted(lines, key=_place):
        if line["curve"]:
            by.setdefault(line["contender"], []).append(line)
    found = {}
    rng = np.random.default_rng(0)
    for name, some in by.items():
        if name in TRAINED:
            data = np.array(
                [[rows for _, rows in line["curve"]] for line in some]
            )  # trial, checkpoint, episode, column
            driven = np.array([[each for each, _ in line["curve"]] for line in some])
        else:
            data = np.array([line["curve"][0][1] for line in some])[:, :, None]
            driven = data[:, :, 0, 0].cumsum(axis=1)
        won = data[..., 1] == 1.0
        sums = np.stack(
            [(data[..., 0] * won).sum(2), (data[..., 3] * won).sum(2), won.sum(2), np.ones(won.shape).sum(2)]
        )
        drawn = sums[:, rng.integers(0, len(some), (RESAMPLES, len(some)))].sum(axis=2)
        all_sums = sums.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios, ratio = drawn[0] / drawn[1], all_sums[0] / all_sums[1]
        found[name] = {
            "driven": np.median(driven, axis=0),
            "success": all_sums[2] / all_sums[3],
            "ratio": ratio,
            "success_95": np.percentile(drawn[2] / drawn[3], (2.5, 97.5), axis=0),
            "ratio_95": np.array([_band(column) for column in ratios.T]).T,
        }
    return found


def _band(values: NDArray[np.float64]) -> list[float]:
    """The middle 95 % of those that are finite; NaN without any."""
    finite = values[np.isfinite(values)]
    return [float(x) for x in np.percentile(finite, (2.5, 97.5))] if len(finite) else [nan, nan]


COLOURS: Final = (
    *("#0072B2", "#56B4E9", "#009E73", "#D55E00", "#CC79A7", "#E69F00", "#000000", "#999999"),  # Okabe, Ito
    "#8B4513",
)
MARKERS: Final = "os^vDPXp*"  # as colours alone tell no line
ACROSS: Final = 3  # panels in a row


def draw(picture: Path, lines: Sequence[Line]) -> None:
    """Success, and the ratio of successes to the floor, over seconds driven; raises MissingExtra."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtra("drawing pictures", "plots") from None
    order = [name for name in ALL if any(line["contender"] == name for line in lines)]
    found = sorted(curves(lines).items(), key=lambda pair: order.index(pair[0]) if pair[0] in order else 99)
    rows = -(-len(found) // ACROSS)
    figure = Figure(figsize=(9.0, 3.6 + 1.7 * rows), dpi=120, layout="constrained")
    grid = figure.add_gridspec(rows + 1, ACROSS, height_ratios=[3.2, *[1.7] * rows])
    upper = figure.add_subplot(grid[0, :])
    for number, (name, one) in enumerate(found):
        colour, marker = (COLOURS[ALL.index(name)], MARKERS[ALL.index(name)]) if name in ALL else ("0.4", ".")
        n = sum(line["contender"] == name for line in lines)
        style: dict[str, Any] = {
            "color": colour, "marker": marker, "ms": 6.0, "mec": "white", "mew": 0.5,
            "ls": "--" if name in TRAINED else "-", "markevery": 1 if name in TRAINED else 3,
        }  # fmt: skip
        # ratios of contenders lie one over another, so each has a panel
        lower = figure.add_subplot(grid[1 + number // ACROSS, number % ACROSS])
        for axes, what, factor in ((upper, "success", 100.0), (lower, "ratio", 1.0)):
            axes.plot(one["driven"], factor * one[what], label=f"{name}, {n} trials", **style)
            axes.fill_between(one["driven"], *(factor * one[f"{what}_95"]), color=colour, alpha=0.2, lw=0.0)
        lower.set_title(name, fontsize=9)
        lower.set(yscale="log", xscale="log", xlim=(4.0, 3e4), ylim=(0.9, 30.0))
        lower.set_yticks([1.0, 2.0, 5.0, 10.0, 20.0], ["1", "2", "5", "10", "20"], minor=False)
        lower.minorticks_off()
        lower.grid(alpha=0.3)
        if number % ACROSS == 0:
            lower.set(ylabel="time / floor")
        if number + ACROSS >= len(found):
            lower.set(xlabel="seconds driven")
    upper.set(ylabel="episodes that reach the light, %", ylim=(-3.0, 103.0), xscale="log", xlim=(4.0, 3e4))
    upper.grid(alpha=0.3)
    figure.legend(*upper.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    upper.set_title(
        "above: success; below: time of the successes; bands of 95 % over trials; dashed: trained", fontsize=9
    )
    figure.savefig(picture)
