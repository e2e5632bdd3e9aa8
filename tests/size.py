"""How large the robot is, in statements, which neither the format nor the comments change.

    python -m tests.size

Printed are the statements of txt1/ by folder, beside those that are loaded once `Robot.open("sim")` was entered, in an
interpreter of its own.
"""

import ast
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
OPEN: Final = """
import json, sys
import txt1

async def main():
    async with txt1.Robot.open("sim"):
        print(json.dumps([each.__file__ for name, each in sys.modules.items() if name.partition(".")[0] == "txt1"]))

txt1.run(main(), speed="max")
"""


def statements(file: Path) -> int:
    """Return the number of statements in a file, docstrings included."""
    return sum(isinstance(node, ast.stmt) for node in ast.walk(ast.parse(file.read_bytes())))


def loaded() -> list[Path]:
    """Return the files of txt1 that an opened simulated robot has imported."""
    done = subprocess.run([sys.executable, "-c", OPEN], cwd=ROOT, capture_output=True, text=True, check=True)
    return [Path(file) for file in json.loads(done.stdout)]


def by_folder(files: list[Path]) -> Counter[str]:
    """Return the statements of each folder of txt1/; a module that lies in none stands by itself."""
    count: Counter[str] = Counter()
    for file in files:
        count["/".join(file.relative_to(ROOT).parts[:2])] += statements(file)
    return count


def main() -> None:
    """Print the table."""
    there = sorted((ROOT / "txt1").rglob("*.py"))
    opened = loaded()
    everything, plain = by_folder(there), by_folder(opened)
    print(f"{'statements':>12}{'loaded':>9}")
    for folder, count in sorted(everything.items(), key=lambda each: -each[1]):
        print(f"{count:12}{plain[folder] or '-':>9}  {folder}")
    print(f'{everything.total():12}{plain.total():>9}  {len(there)} modules, {len(opened)} loaded by Robot.open("sim")')


if __name__ == "__main__":
    main()
