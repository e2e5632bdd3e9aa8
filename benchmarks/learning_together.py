"""Learning by several robots beside learning alone: repetitions to the same skill, full robots.

``python -m benchmarks.learning_together [--learner thesis] [--teams 20] [--robots 4] [--episodes 24] [--minutes 5]``.
With --newcomer: one that joins a team which has learned (``--episodes 3``: each third is an episode). Every kind has
the same teams: the same robots, starts and noise. Results are kept as they come; the same command goes on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.rounds import table
from tests.lessons import Lessons
from txt1.config import load
from txt1.fleet.plan import names
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import run
from txt1.learning.agent import Learned
from txt1.trials.provenance import code_hash
from txt1_learners.sharing import Sharing
from txt1_learners.studies.team import Join, learn_together

Times = list[list[float]]  # s to the light, by robot and episode; a failure counts as LIMIT
LIMIT: Final = 60.0  # s of an episode
SKILL: Final = 12.0  # s that each of ...
IN_A_ROW: Final = 3  # ... so many episodes in a row takes at most
BEFORE: Final = 12  # episodes that a team has had when a newcomer joins it
NEW: Final = 1000  # what a newcomer's seed is larger by
RESAMPLES: Final = 2000


@dataclass(frozen=True)
class Kind:
    """A way of learning together."""

    lessons: Mapping[str, Any] = field(default_factory=dict)  # options of `Lessons`
    sharing: Mapping[str, Any] = field(default_factory=dict)  # ... and of `Sharing`

    def join(self) -> Join:
        """Begin a team."""
        lessons = Lessons(**self.lessons)
        return lambda name, learner: Sharing(learner, lessons.of(name), **self.sharing)


def reversed_by(name: str, own: Learned) -> Learned:
    """The lie of the first: whatever is best is worst, and five times so."""
    lie = tuple(tuple(-5.0 * value for value in row) for row in own.rows)
    return own._replace(rows=lie) if name == "txt01" else own


KINDS: dict[str, Kind | None] = {
    "alone": None,
    "together": Kind(),
    "each explores at its own pace": Kind(sharing={"hurry": False}),
    "one of them lies": Kind({"lies": reversed_by}),
    "one of them lies, all are believed": Kind({"lies": reversed_by}, {"liars": 0}),
    "one of them is lost": Kind({"lost": frozenset({"txt01"})}),
}


def learned(kind: Kind | None, learner: str, seed: int, robots: int, episodes: int) -> Times:
    """How long each robot but the first took for each episode: the first lies, or is lost, in some kinds."""
    config = load(None, [f"learning.time_limit={LIMIT:g}"]).config
    join = None if kind is None else kind.join()
    done = run(learn_together(config, seed, names(robots), episodes, join, learner), speed="max")
    return [[one.time if one.success else LIMIT for one in each] for name, each in done.items() if name != "txt01"]


def newcomer(kind: Kind | None, learner: str, seed: int, robots: int, episodes: int) -> Times:
    """How long one takes for each of its episodes that joins a team of so many robots, who have had a few."""
    config = load(None, [f"learning.time_limit={LIMIT:g}"]).config
    join = None if kind is None else kind.join()
    if join is not None:
        run(learn_together(config, seed, names(robots), BEFORE, join, learner), speed="max")
    (one,) = run(learn_together(config, NEW + seed, ["newcomer"], episodes, join, learner), speed="max").values()
    return [[each.time if each.success else LIMIT for each in one]]


def until_skill(times: Sequence[float]) -> int:
    """The episodes that were needed to become skilled; one more than there were, if that was not enough."""
    for at in range(len(times) - IN_A_ROW + 1):
        if max(times[at : at + IN_A_ROW]) <= SKILL:
            return at
    return len(times) + 1


def interval(teams: Sequence[float]) -> tuple[float, float]:
    """95 % of the mean over teams, by resampling."""
    rng = np.random.default_rng(0)
    means = rng.choice(np.asarray(teams), (RESAMPLES, len(teams))).mean(axis=1)
    low, high = np.percentile(means, (2.5, 97.5))
    return float(low), float(high)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--learner", default="thesis")
    parser.add_argument("--teams", type=int, default=20)
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--episodes", type=int, default=24)
    parser.add_argument("--newcomer", action="store_true", help="measure one that joins a team which has learned")
    parser.add_argument("--minutes", type=float, help="begin no team after so many")
    parser.add_argument("--kept", type=Path, default=Path("out/learning_together.jsonl"), help="what came out so far")
    arguments = parser.parse_args()
    measure = newcomer if arguments.newcomer else learned
    given = [measure.__name__, arguments.learner, arguments.robots, arguments.episodes, code_hash()]
    lines = arguments.kept.read_text(encoding="utf-8").splitlines() if arguments.kept.exists() else []
    known = {(row["kind"], row["seed"]): row["times"] for row in map(json.loads, lines) if row["given"] == given}
    began = stopwatch_ns()
    arguments.kept.parent.mkdir(parents=True, exist_ok=True)
    for seed in range(arguments.teams):
        for name, kind in KINDS.items():
            late = arguments.minutes is not None and stopwatch_ns() - began > 60.0 * arguments.minutes * NS_PER_S
            if (name, seed) in known or late:
                continue
            known[name, seed] = measure(kind, arguments.learner, seed, arguments.robots, arguments.episodes)
            with arguments.kept.open("a", encoding="utf-8") as kept:
                row = {"kind": name, "seed": seed, "given": given, "times": known[name, seed]}
                print(json.dumps(row), file=kept)
    _report(known, arguments)


def _report(known: Mapping[tuple[str, int], Times], arguments: argparse.Namespace) -> None:
    episodes = arguments.episodes
    whole = [seed for seed in range(1000) if all((kind, seed) in known for kind in KINDS)]
    thirds = [slice(at * episodes // 3, (at + 1) * episodes // 3) for at in range(3)]
    rows = []
    alone = [float(np.mean([until_skill(each) for each in known["alone", seed]])) for seed in whole]
    for kind in KINDS:
        needed = [float(np.mean([until_skill(each) for each in known[kind, seed]])) for seed in whole]
        data = np.array([known[kind, seed] for seed in whole])  # (teams, robots, episodes)
        gain = [a - b for a, b in zip(alone, needed, strict=True)]
        rows.append(
            (
                kind,
                _with_interval(needed),
                "" if kind == "alone" else _with_interval(gain),
                *(_with_interval(data[:, :, third].mean(axis=(1, 2))) for third in thirds),
            )
        )
    skill = f"{IN_A_ROW} in a row within {SKILL:g} s"
    who = "newcomers to " if arguments.newcomer else ""
    teams = f"{arguments.learner}: {who}{len(whole)} teams of {arguments.robots}, {episodes} episodes"
    table(
        f"{teams}, a failure as {LIMIT:g} s; in brackets 95 % over teams",
        ("", f"episodes until {skill}", "fewer than alone", *(f"s, {name} third" for name in ("first", "2nd", "last"))),
        rows,
    )


def _with_interval(teams: Sequence[float]) -> str:
    low, high = interval(teams)
    return f"{np.mean(teams):.1f} ({low:.1f} to {high:.1f})"


if __name__ == "__main__":
    main()
