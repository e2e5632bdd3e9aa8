"""`python -m docs.thesis_readings`: the table in docs/results/thesis.md, from out/readings.jsonl.

`python -m txt1_learners.studies thesis out/readings --trials 100 --seed 39` makes that file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rigs import page_parts
from txt1_learners.studies import thesis

HERE: Final = Path(__file__).parent
RAW: Final = HERE.parent / "out" / "readings.jsonl"
MAKES: Final = "python -m txt1_learners.studies thesis out/readings --trials 100 --seed 39"
PAGE: Final = HERE / "results" / "thesis.md"


def main() -> None:
    """Write the table.

    Raises:
        SystemExit: there are no results.

    """
    if not RAW.exists():
        raise SystemExit(f"{RAW} is not there: `{MAKES}` makes it")
    page_parts.write(PAGE, "readings", thesis.table(RAW), "docs.thesis_readings")


if __name__ == "__main__":
    main()
