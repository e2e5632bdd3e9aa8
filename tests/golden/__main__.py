"""``python -m tests.golden NAME...``: makes golden recordings anew, and says how far they are from the old ones."""

import sys
from pathlib import Path

from tests.golden.difference import largest
from tests.golden.recipes import RECIPES, make

FOLDER = Path(__file__).parent


def main(names: list[str]) -> int:
    """Make the recordings of these names anew."""
    unknown = [name for name in names if name not in RECIPES]
    if not names or unknown:
        print("python -m tests.golden NAME... with names of:")
        print("\n".join(f"  {name:10} {recipe.about}" for name, recipe in RECIPES.items()))
        return 2
    for name in names:
        old, new = FOLDER / f"{name}.mcap", FOLDER / f"{name}.new.mcap"
        new.unlink(missing_ok=True)
        make(name, new)
        told = f"{largest(old, new)}" if old.exists() else "new"
        new.replace(old)
        print(f"{name}: {old.stat().st_size / 1000:.0f} kB, {told}")
    return 0


sys.exit(main(sys.argv[1:]))
