"""`python -m docs.compared_learners`: docs/results/compared-learners.md, of all contenders and in all worlds.

That takes an hour of two processors. Ended and begun again, it goes on: raw results are kept in out/compared.jsonl,
which is copied to docs/results/learning, and in out/compared-worlds/. `--report` only writes the page from them.
The table of all worlds is out/compared-worlds/worlds.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from shutil import copyfile
from typing import Any, Final

from rigs import page_parts
from txt1_learners.studies import compare, contenders, suite
from txt1_learners.studies.__main__ import main as study

HERE: Final = Path(__file__).parent
RESULTS: Final = HERE / "results"
RAW: Final = RESULTS / "learning" / "compared.jsonl"
OUT: Final = HERE.parent / "out" / "compared.jsonl"
WORLDS: Final = HERE.parent / "out" / "compared-worlds"
PAGE: Final = RESULTS / "compared-learners.md"
LEARNERS: Final = "thesis,sweeps,taxis,pilot,neural"
SEED: Final = "1"
# worlds of a learner that are named in the table of losses
WORST: Final = 5


def losses(results: Sequence[dict[str, Any]]) -> str:
    """The worlds in which each learner does not always arrive, or refuses to try; who has most of them first."""
    found: dict[str, list[tuple[float, str]]] = {}
    for one in results:
        shown = suite.figures(one)
        if "refused" in shown or shown["success"] < 1.0:
            share = shown.get("success", 0.0)
            told = "refuses the sensors" if "refused" in shown else f"{100.0 * share:.0f} %"
            found.setdefault(one["agent"], []).append((share, f"`{one['world']}` {told}"))
    rows = ["| learner | worlds with a loss | the worst |", "|---|--:|---|"]
    for name in sorted(LEARNERS.split(","), key=lambda name: -len(found.get(name, ()))):
        own = sorted(found.get(name, ()))
        rows.append(f"| `{name}` | {len(own)} | {', '.join(text for _, text in own[:WORST])} |")
    return "\n".join(rows)


def main() -> None:
    """Compare, and write the page."""
    parser = argparse.ArgumentParser(prog="docs.compared_learners", description=__doc__)
    parser.add_argument("--trials", default="100", metavar="N", help="of each contender in the thesis's world; 100")
    parser.add_argument("--worlds", default="4", metavar="N", help="trials of each learner in each world; 4")
    parser.add_argument("--report", action="store_true", help="only write the page, from the results that are there")
    given = parser.parse_args()
    if not given.report:
        OUT.parent.mkdir(exist_ok=True)
        if RAW.exists() and not OUT.exists():
            copyfile(RAW, OUT)
        study(["compare", str(OUT), "--trials", given.trials, "--seed", SEED])
        copyfile(OUT, RAW)
        study(
            [
                "worlds",
                "usual",
                "--agent",
                LEARNERS,
                "--seed",
                SEED,
                "--trials",
                given.worlds,
                "--episodes",
                "12",
                "--out",
                str(WORLDS),
                "--resume",
            ]
        )
    page_parts.write(PAGE, "contenders", contenders.table(*compare.read(RAW)), "docs.compared_learners")
    contenders.draw(RAW.with_suffix(".png"), compare.read(RAW)[1])
    files = [path for name in LEARNERS.split(",") for path in sorted((WORLDS / name).glob("*.json"))]
    if files:
        results = [json.loads(path.read_text(encoding="utf-8")) for path in files]
        (WORLDS / "worlds.md").write_text(f"{losses(results)}\n\n{suite.table(results)}", encoding="utf-8")


if __name__ == "__main__":
    main()
