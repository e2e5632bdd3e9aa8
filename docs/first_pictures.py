"""Makes the pictures of the first minute's terminal: `python -m docs.first_pictures [NAME ...]`, into docs/first."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from rigs.ros_bags import bag
from rigs.terminals import Watched, start

FOLDER: Final = Path(__file__).parent / "first"
SIZES: Final = ((60, 20), (80, 24), (120, 40))
MAPPED: Final = "map drive.bag -o room"
"""Before "bag", which drives in the map of a bag."""
PICTURES: Final = {
    "run": ("--practice", ("ARMED", "http://", "room x")),
    "wall": ("--screen 5 --set sim.start=[1.8,0.0,0.0] --drive 0.5,0", ("a wall of",)),
    "bag": (
        "--screen 5 --set sim.room.map=room.yaml --set sensors.laser.driver=sim_laser --in room",
        ("ARMED", "map x"),
    ),
}
"""By name: words after `txt1 run`, and texts that are on the screen then."""


def main() -> None:
    """Make them all, or those named."""
    FOLDER.mkdir(exist_ok=True)
    names = sys.argv[1:] or list(PICTURES)
    if strange := sorted(set(names) - set(PICTURES)):
        sys.exit(f"{strange[0]}: there is no such picture; there are: {', '.join(PICTURES)}")
    with TemporaryDirectory() as made:
        folder = Path(made)
        if "bag" in names:
            bag(folder / "drive.bag", "ros1")
            mapping = Watched(start(80, 24, *MAPPED.split(), folder=folder), 80, 24)
            mapping.until_end()
        for columns, rows in SIZES:
            for name in names:
                words, shown = PICTURES[name]
                child = start(columns, rows, "run", "--seed", "1", *words.split(), folder=folder)
                watched = Watched(child, columns, rows)
                # the last row has the keys again
                watched.until(*shown, "SPACE stop")
                if name == "bag":
                    child.send(b"w")
                    watched.until_seen(lambda text: "map x 0.00" not in text, "the car has moved")
                watched.picture(FOLDER / f"{name}-{columns}x{rows}.png")
                child.send(b"q")
                watched.until_end()


if __name__ == "__main__":
    main()
