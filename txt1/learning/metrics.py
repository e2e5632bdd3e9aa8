"""Figures of many trials: times, success, and their ratio to the optimum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.learning.trial import Episode

THESIS_MEAN: Final = 7.165  # mean time to the light after the first seven episodes that the thesis reports, s (5.4)
LEARNED: Final = 7  # episodes after which the thesis takes its mean
LAST: Final = 10  # episodes at the end that are looked at by themselves
MILESTONES: Final = (1, 2, 4, 8, 16, 31)  # episodes whose ratio to the optimum is reported


def summary(trials: Sequence[Sequence[Episode]]) -> dict[str, Any]:
    """Times in s, success as shares, and ratios to the optimum; JSON values. Trials may be of different length."""
    every = [one for trial in trials for one in trial]
    if not every:
        return {"trials": len(trials), "episodes": 0}
    length = max(len(trial) for trial in trials)
    # the mean of an episode over the trials that got so far, against the same starts' optimum
    curve = [[trial[k] for trial in trials if len(trial) > k] for k in range(length)]
    means = [_times(row).mean() for row in curve]
    milestones = [k for k in MILESTONES if k <= length]
    return {
        "trials": len(trials),
        "episodes": len(every),
        "thesis_mean_time_s": THESIS_MEAN,
        "after_episode_7": _figures([trial[LEARNED:] for trial in trials]),
        "last_10": _figures([trial[-LAST:] for trial in trials]),
        "ratio_at_episode": {str(k): _ratio(curve[k - 1]) for k in milestones},
        "robot_seconds_until_episode": {str(k): _round(sum(means[:k])) for k in milestones},
        "success_at_episode": [_round(np.mean([one.success for one in row])) for row in curve],
        "mean_time_at_episode_s": [_round(mean) for mean in means],
        "robot_seconds_in_all": _round(sum(one.time for one in every)),
    }


def _figures(by_trial: Sequence[Sequence[Episode]]) -> dict[str, Any]:
    """Times, success and regret of some episodes of each trial."""
    some = [one for trial in by_trial for one in trial]
    if not some:
        return {"episodes": 0}
    time, best = _times(some), np.array([one.optimal_time for one in some])
    means = np.array([_times(trial).mean() for trial in by_trial if trial])
    won = np.array([one.success for one in some])
    return {
        "episodes": len(some),
        "failures": int((~won).sum()),
        "success": float(won.mean()),
        "mean_time_s": _round(time.mean()),
        "median_time_s": _round(np.median(time)),
        "percentile_5_time_s": _round(np.percentile(time, 5)),
        "percentile_95_time_s": _round(np.percentile(time, 95)),
        "mean_time_of_successes_s": _round(time[won].mean()) if won.any() else None,
        "sd_of_trial_means_s": _round(means.std(ddof=1)) if len(means) > 1 else None,
        "median_of_trial_means_s": _round(np.median(means)),
        "slowest_30_percent_take": _round(np.sort(time)[::-1][: max(1, round(0.3 * len(time)))].sum() / time.sum()),
        "optimal_mean_time_s": _round(best.mean()),
        "mean_regret_s": _round((time - best).mean()),
        "ratio_to_optimum": _round(time.sum() / best.sum()),
    }


def _times(some: Sequence[Episode]) -> NDArray[np.float64]:
    return np.array([one.time for one in some])


def _ratio(some: Sequence[Episode]) -> float:
    return _round(_times(some).sum() / sum(one.optimal_time for one in some))


def _round(value: Any) -> float:
    return round(float(value), 4)
