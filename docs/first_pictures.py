"""Makes the pictures of the first minute's terminal: `python -m docs.first_pictures`, into docs/first."""

from pathlib import Path
from typing import Final

from rigs.terminals import Watched, start

FOLDER: Final = Path(__file__).parent / "first"
SIZES: Final = ((60, 20), (80, 24), (120, 40))


def main() -> None:
    """Drive a practice, and a car against a wall, on terminals of each size."""
    FOLDER.mkdir(exist_ok=True)
    for columns, rows in SIZES:
        for name, words, shown in (
            ("run", ("--practice",), ("ARMED", "http://", "laser" if columns > 60 else "room")),
            ("wall", ("--screen", "5", "--set", "sim.start=[1.8, 0.0, 0.0]", "--drive", "0.5,0"), ("a wall of",)),
        ):
            child = start(columns, rows, "run", "--seed", "1", *words)
            watched = Watched(child, columns, rows)
            # the last row has the keys again
            watched.until(*shown, "SPACE stop")
            watched.picture(FOLDER / f"{name}-{columns}x{rows}.png")
            child.send(b"q")
            child.close()


if __name__ == "__main__":
    main()
