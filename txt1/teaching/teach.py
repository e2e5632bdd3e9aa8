"""Makes a policy from recordings: the work of `txt1 teach`, as functions for programs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import RecordingError
from txt1.teaching.human_drive import HumanDrive
from txt1.teaching.lessons import HUMAN_LAG, Ask, drive_in, sha256_of, together
from txt1.teaching.policy import FORMAT, Card, Policy, digest
from txt1.teaching.training import Ensemble, Judged, Progress, Recipe, judged, train
from txt1.version import __version__

__all__ = ["Ask", "Recipe", "drive_in", "teach"]

FOLDS: Final = 4
"""Number of blocks of time that are held out in turn."""
HELD_GAP: Final = 1.0
"""s beside a held-out block that are not taught."""
SURE_SHARE: Final = 0.98
"""Share of the held-out times at which a policy should drive at full speed."""
STOP_DOUBT: Final = 3.0
"""Doubt at which it stands, as a multiple of the doubt from which it drives slower."""

Told = Callable[[str, Progress], None]


class Lesson(NamedTuple):
    """A policy, its origin, and its results."""

    policy: Policy
    ensemble: Ensemble
    judged: Judged
    origin: NDArray[np.int64]
    """The recording of each lesson."""


def teach(
    drives: Sequence[HumanDrive],
    recipe: Recipe,
    made: str,
    told: Told = lambda what, progress: None,
    folds: int = FOLDS,
) -> Lesson:
    """Return a policy taught from recordings; `made` is the date for its card.

    Raises RecordingError: the recordings do not fit together, or are too short.
    """
    sights, lessons, origin = together(drives)
    held = judged(sights, lessons, recipe, folds, HELD_GAP, lambda progress: told("held-out blocks", progress))
    ensemble = train(sights, lessons, recipe, lambda progress: told("all lessons", progress))
    policy = _policy(drives, recipe, made, held, ensemble)
    return Lesson(policy, ensemble, held, origin)


def _policy(drives: Sequence[HumanDrive], recipe: Recipe, made: str, held: Judged, ensemble: Ensemble) -> Policy:
    # the deviation of few networks is too small, and fewer networks were judged than drive
    few, many = len(held.outputs), len(ensemble.networks)
    larger = float(np.sqrt((1.0 - 1.0 / many) / (1.0 - 1.0 / few))) if min(few, many) > 1 else 1.0
    # a disagreement below the usual error is no reason for doubt
    error = float(np.sqrt(np.mean(held.errors[:, 0] ** 2)))
    slow = max(larger * float(np.quantile(held.doubts, SURE_SHARE)), error, 1e-3)
    sights = tuple(
        replace(sight, mean=tuple(map(float, norm.mean)), deviation=tuple(map(float, norm.deviation)))
        for sight, norm in zip(drives[0].sights, ensemble.norms, strict=True)
    )
    card = Card(
        FORMAT,
        __version__,
        made,
        sights,
        many,
        ensemble.networks[0].shape.dense,
        drives[0].v_max,
        drives[0].radius_min,
        slow,
        STOP_DOUBT * slow,
        drives[0].vehicle,
        tuple(each.taught for each in drives),
        held.results() | {"parameters": float(many * card_parameters(ensemble))},
        digest(ensemble.networks),
    )
    return Policy(card, ensemble.networks)


def card_parameters(ensemble: Ensemble) -> int:
    """Return the number of parameters of each network."""
    return ensemble.networks[0].shape.parameters


def earlier(policy: Policy, also: Collection[str] = (), lag: float = HUMAN_LAG) -> list[HumanDrive]:
    """Return the recordings from which a policy was taught; raises RecordingError: one is missing, or has changed."""
    asks = [Ask(sight.kind, sight.sensor) for sight in policy.card.sees]
    found = []
    for taught in policy.card.taught_by:
        path = Path(taught.file)
        if not path.exists():
            raise RecordingError(
                f"{path}: the policy was taught by it, and it is not there any more; put it back, "
                "or teach anew without --from"
            )
        if sha256_of(path) != taught.sha256:
            raise RecordingError(f"{path}: it is not the recording any more that the policy was taught by")
        found.append(drive_in(path, asks, {*also, *taught.by}, lag=lag, vehicle=policy.card.vehicle))
    return found


def summary(drive: HumanDrive) -> list[str]:
    """Return lines about a recording: its lessons, and the times that are left out, with reasons."""
    taught = drive.taught
    by = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in sorted(taught.by.items()))
    lines = [f"{taught.file}: {len(drive.lessons)} lessons, driven by {by}"]
    if taught.takeover:
        lines.append(f"  {taught.takeovers} take-overs from a policy: {taught.takeover:.1f} s, which count more")
    if drive.ends != "complete":
        lines.append(f"  it {drive.ends}")
    left = sorted(taught.left_out.items(), key=lambda one: -one[1])
    if left:
        lines.append("  left out: " + ", ".join(f"{reason} {seconds:.1f} s" for reason, seconds in left))
    return lines
