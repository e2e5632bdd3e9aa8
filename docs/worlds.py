"""`python -m docs.worlds`: the pilot's tables in docs/results/learning.md; it learns in all worlds, half an hour.

`--agent locator` has the locator learn in the worlds of `PLAIN`; ten minutes.

Ended and begun again, it goes on: raw results are kept in out/pilot-worlds and out/locator-worlds and, of many trials
in the thesis's world, in out/pilot-thesis. `--report` does no more than write the page from them, and worlds.md of all
worlds in the first two.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from rigs import page_parts
from txt1.learning.experiment import LEARNED
from txt1_learners.studies import suite
from txt1_learners.studies.__main__ import main as study
from txt1_learners.worlds import groups

HERE: Final = Path(__file__).parent
LOCATOR: Final = HERE.parent / "out" / "locator-worlds"
EVERY, THESIS = HERE.parent / "out" / "pilot-worlds", HERE.parent / "out" / "pilot-thesis"
PAGE: Final = HERE / "results" / "learning.md"
SEED: Final = "1213282368"  # drawn after the pilot was finished
NEAR: Final = 1.05  # times its floor, within which it is to be
FAR: Final = 1.3  # times its floor, beyond which the locator is slow in a world
SHOWN: Final = 4  # worlds that are named as the farthest from their floors
# plain worlds: the robot's own, and one thing that differs from it in each
PLAIN: Final = (
    *("thesis", "sensor-dead", "sensors-two-dead", "sensor-frozen", "sensors-swapped", "sensors-turned"),
    *("sensors-quarter", "sensors-mixed", "sensors-close", "sensors-uneven", "noise-none", "noise-double"),
    *("delay-0.2", "delay-0.4", "floor-slippery", "floor-rough", "light-dim", "servo-slow", "speed-half"),
    "steering-reversed",
)


def read(out: Path) -> list[dict[str, Any]]:
    """The raw results of a learner in a directory, by the names of their worlds."""
    return [json.loads(path.read_text(encoding="utf-8")) for path in sorted(out.glob("*/*.json"))]


def source(results: Sequence[dict[str, Any]]) -> str:
    """Where results came from, in a sentence."""
    (told,) = {(one["trials"], one["episodes"], one["seed"], one["provenance"]["code"]) for one in results}
    made = results[0]["provenance"]
    versions = ", ".join(f"{name} {made[name]}" for name in ("python", "numpy", "numba"))
    return "{} trials of {} episodes, seed {}, code {}; ".format(*told) + f"{versions}; {made['platform']}"


def about(result: dict[str, Any]) -> str:
    """A world in a few words: what the list says of it, or its numbers where it was drawn."""
    if (world := groups()["usual"].get(result["world"])) is not None:
        return str(world["about"])
    learning, sim = result["config"]["learning"], result["config"]["sim"]
    v, turns = learning["actions"][0][0], [abs(action[1]) for action in learning["actions"] if action[1]]
    turned = " and ".join(f"{v / turn:.2f}" for turn in turns)
    start, goal, delay = (learning[key] for key in ("start_radius", "goal_radius", "delay"))
    noise, slip = sim["light"]["noise"], sim["vehicle"]["slip"]
    return (
        f"{v:.2f} m/s, turns of {turned} m, start {start:.2f} m, goal {goal:.2f} m, noise {noise:.2f}, "
        f"slip {slip:.2f}, delay {delay:g} s"
    )


def far(one: dict[str, Any]) -> str:
    """A world, and how far from its floor the learner is; of one trial nobody knows how sure that is."""
    upper = f" (up to {one['to_floor_95'][1]:.3f})" if one["to_floor_95"] else ""
    return f"`{one['world']}` {one['to_floor']:.3f}{upper}"


def losses(results: Sequence[dict[str, Any]]) -> str:
    """The worlds in which it is not near its floor, and those that are next, the worst first."""
    every = [suite.figures(one) | {"world": one["world"]} for one in results]
    every.sort(key=lambda one: -float(one["to_floor"]))
    named = [*map(far, every)]
    lost = sum(one["to_floor"] > NEAR for one in every)
    within = f"In {'all ' if not lost else f'{len(every) - lost} of '}{len(every)} worlds the pilot stays within "
    within += f"{NEAR - 1:.0%} of the best possible time.".replace("%", " %")
    count, failed, before = (sum(one[key] for one in every) for key in ("episodes", "failures", "failures_before"))
    return (
        f"{within} Farthest from it: {', '.join(named[: max(lost, SHOWN)])} times the best possible time. Episodes "
        f"after the {LEARNED}th: {count}, of which {failed} failed. Failures before: {before}.\n"
    )


def worlds(results: Sequence[dict[str, Any]], agent: str) -> str:
    """The table of all worlds."""
    lines = [
        f"| world | {agent}: success, to the floor (95 %), to the optimum |",
        "|---|---|",
        *(f"| `{one['world']}`: {about(one)} | {suite.cell(suite.figures(one))} |" for one in results),
        "",
        f"{source(results)}.",
        "",
    ]
    return "\n".join(lines)


def thesis(result: dict[str, Any]) -> str:
    """What many trials in the thesis's world came to."""
    one = suite.figures(result)
    return (
        f"After the {LEARNED}th episode {one['failures']} of {one['episodes']} failed, before it "
        f"{one['failures_before']} of {LEARNED * result['trials']}; {one['to_floor']:.4f} times the floor "
        f"({one['to_floor_95'][0]:.4f} to {one['to_floor_95'][1]:.4f}), {one['to_optimum']:.3f} times the optimum; "
        f"at the second repetition {one['to_optimum_at_2']:.3f} times the optimum. {source([result])}.\n"
    )


def changes(results: Sequence[dict[str, Any]]) -> str:
    """The ratio to the floor about a change, by episode."""
    changed = [one for one in results if one["config"]["learning"].get("changes")]
    first = changed[0]["config"]["learning"]["changes"][0]["episode"]
    shown = range(first - 1, first + 5)
    lines = [
        "| change | " + " | ".join(map(str, shown)) + f" | back within {suite.BACK:g} after |",
        "|---" * (len(shown) + 2) + "|",
    ]
    for one in changed:
        found = suite.figures(one)
        curve = " | ".join(f"{found['to_floor_at_episode'][k - 1]:.2f}" for k in shown)
        back = "never" if found["back_after"] is None else f"{(n := found['back_after'])} episode{'s' * (n != 1)}"
        lines.append(f"| `{one['world']}` | {curve} | {back} |")
    return "\n".join([*lines, ""])


def plain(results: Sequence[dict[str, Any]]) -> str:
    """The locator in plain worlds, the worst by name, and how often its doubt was right."""
    every = sorted((suite.figures(one) | {"world": one["world"]} for one in results), key=lambda one: -one["to_floor"])
    ratios = [float(one["to_floor"]) for one in every]
    named = map(far, every[:SHOWN])
    late = np.concatenate([np.array(one["results"], float)[:, LEARNED:].reshape(-1, 8) for one in results])
    said = np.isfinite(late[:, suite.UNFIT])
    slow = (late[:, 3] == 0.0) | (late[:, 2] > suite.SLOW * late[:, 5])
    return (
        f"Times the floor after the {LEARNED}th episode: {np.mean(ratios):.3f} in the mean over {len(every)} worlds, "
        f"above {FAR} in {sum(each > FAR for each in ratios)}. Farthest from it: {', '.join(named)}. Of {len(late)} "
        f"episodes {int((late[:, 3] == 0.0).sum())} failed. It doubted {int((said & ~slow).sum())} of "
        f"{int((~slow).sum())} fine episodes, and {int((said & slow).sum())} of {int(slow.sum())} that failed or took "
        f"{suite.SLOW} times the floor. {source(results)}.\n"
    )


def main() -> None:
    """Have the learner learn, and write the page."""
    parser = argparse.ArgumentParser(prog="docs.worlds", description=__doc__)
    parser.add_argument("--agent", default="pilot", choices=("pilot", "locator"), help="the learner; pilot")
    parser.add_argument("--trials", default="4", metavar="N", help="in each world; 4")
    parser.add_argument("--episodes", default="31", metavar="N", help="of the locator, in each trial; 31")
    parser.add_argument("--thesis", default="1000", metavar="N", help="in the thesis's world; 1000")
    parser.add_argument("--report", action="store_true", help="only write the page, from the results that are there")
    given = parser.parse_args()
    if given.agent == "locator":
        if not given.report:
            common = ["worlds", "usual", "--agent", "locator", "--seed", SEED, "--resume", "--jobs", "1"]
            chosen = ["--world", ",".join(PLAIN), "--trials", given.trials, "--episodes", given.episodes]
            study([*common, *chosen, "--out", str(LOCATOR)])
        (LOCATOR / "worlds.md").write_text(worlds(read(LOCATOR), "locator"), encoding="utf-8")
        page_parts.write(PAGE, "locator-plain", plain(read(LOCATOR)), "docs.worlds")
        return
    if not given.report:
        common = ["worlds", "usual", "--agent", "pilot", "--seed", SEED, "--resume"]
        study([*common, "--trials", given.trials, "--out", str(EVERY)])
        study([*common, "--trials", given.thesis, "--out", str(THESIS), "--world", "thesis"])
    every = read(EVERY)
    texts = {
        "losses": losses(every),
        "changes": changes(every),
        "thesis": "".join(map(thesis, read(THESIS))),
    }
    (EVERY / "worlds.md").write_text(worlds(every, "pilot"), encoding="utf-8")
    for name, text in texts.items():
        page_parts.write(PAGE, f"pilot-{name}", text, "docs.worlds")


if __name__ == "__main__":
    main()
