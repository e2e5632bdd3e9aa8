"""Learning by several robots beside learning alone: success and time to the light by episode, full robots.

``python -m benchmarks.learning_together [--teams 10] [--robots 4] [--episodes 12]``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from statistics import mean

from benchmarks.rounds import table
from txt1.config import load
from txt1.fleet.plan import names
from txt1.kernel.loop import run
from txt1.learning.thesis import ThesisAgent
from txt1.learning.together import Shared, learn_together

Share = Callable[[Mapping[str, ThesisAgent]], Shared]
SKILL = 9.0  # s: the mean time to the light that counts as skill
KINDS: dict[str, Share | None] = {
    "alone": None,
    "together": Shared,
    "one of them lies": partial(Shared, lies=lambda name, q: -5.0 * q if name == "txt01" else q),
    "one of them is lost": partial(Shared, lost=frozenset({"txt01"})),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--teams", type=int, default=10)
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--episodes", type=int, default=12)
    arguments = parser.parse_args()
    config = load(None, ["learning.time_limit=60"]).config
    team, episodes = names(arguments.robots), arguments.episodes
    rows = []
    for kind, share in KINDS.items():
        times: list[list[float]] = [[] for _ in range(episodes)]
        for seed in range(arguments.teams):
            done = run(learn_together(config, seed, team, episodes, share), speed="max")
            for name, each in done.items():
                if name != "txt01":  # who lies, or is lost, in some of them
                    for one in each:
                        times[one.number - 1].append(one.time if one.success else 60.0)
        means = [mean(each) for each in times]
        skilled = next((at + 1 for at, value in enumerate(means) if value <= SKILL), None)
        rows.append((kind, *(f"{means[at]:.1f}" for at in range(0, episodes, 3)), str(skilled or "-")))
    heads = ("", *(f"episode {at + 1}" for at in range(0, episodes, 3)), f"first with {SKILL:g} s")
    table(f"Mean time to the light, s, a failure as 60: {arguments.teams} teams of {len(team)}", heads, rows)


if __name__ == "__main__":
    main()
