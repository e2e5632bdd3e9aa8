"""A recording in numbers that its owner may give away: `txt1 report --share`.

The file is JSON, short enough to be read before it is sent. It has what the robot drove, its faults, tasks and topics,
and the settings that are not as by default. Left out unless they are asked for:

- names: of the robot, its sensors and devices, settings that are texts, and the event log, which has such names;
- places: the way, and settings that say where something stands;
- pictures: the report's picture, which shows the way.
"""

import base64
import json
import re
from collections.abc import Callable, Collection
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1.config import Config, flatten
from txt1.errors import RecordingError
from txt1.record.reader import robots_in, trusting
from txt1.record.report import Content, draw, travelled

KINDS: Final = ("names", "places", "pictures")
# what a recording says of the program and the computer
ABOUT: Final = ("txt1", "python", "numpy", "processor", "libm", "hal", "clock")
# texts that name a kind of thing, and nobody's own
SAFE_TEXTS: Final = re.compile(
    r"(^|\.)(hal|vehicle|driver|physics|steering|model|reverse|transport|preset|auto_arm|enabled)$"
)
# such a text; a path has other characters, and names folders
WORD: Final = re.compile(r"[\w-]+")
# settings that say where something stands
PLACED: Final = re.compile(
    r"(^sim\.(room|obstacles|light|start)|(^|\.)(start|at|place|home|origin|datum|lat|lon|latitude|longitude|altitude)($|\.))"
)
LEFT_OUT: Final = "left out"
# points of the way at most
WAY_MAX: Final = 200


def shared(path: Path, robot: str | None = None, kinds: Collection[str] = ()) -> dict[str, Any]:
    """Return what is shared of a recording, JSON values; `kinds` are those of `KINDS` that may be in it.

    Raises RecordingError: it cannot be read, or it is of several robots and none is named.
    """
    if robot is None and len(names := robots_in(path)) > 1:
        raise RecordingError(f"{path}: a recording of several robots; choose one by --robot: {', '.join(names)}")
    with trusting(path):
        content = Content(path, robot)
    config, about = content.config, content.metadata.get("txt1", {})
    odometry = content.columns("odometry")
    called = (lambda text: text) if "names" in kinds else _aliases(content)
    result: dict[str, Any] = {
        "about": {key: about[key] for key in ABOUT if key in about},
        "drive": {
            "seconds": round(float(np.ptp(odometry[0])), 1),
            "metres": round(travelled(content), 2),
            "fastest": round(float(np.abs(odometry[3]).max()), 2),
            "disarmed": len(content.disarms),
            "complete": content.complete,
        },
        "faults": {called(key): value for key, value in content.faults.items()},
        "tasks": {
            called(task): ", ".join(f"{value} {key}" for key, value in each.items())
            for task, each in content.tasks.items()
        },
        "topics": {
            called(name): f"{each.count} messages, {each.rate:.2f} Hz, {each.lost} lost"
            for name, each in content.topics.items()
        },
        "settings": "of another version" if config is None else _settings(config, kinds, called),
        "left out": [kind for kind in KINDS if kind not in kinds],
    }
    if "names" in kinds:
        result["events"] = [f"{time:.2f} s: {text}" for time, text in content.events]
    if "places" in kinds:
        way = content.columns("way")[:3].T
        result["way"] = [[round(float(value), 2) for value in row] for row in way[:: max(1, len(way) // WAY_MAX)]]
    if "pictures" in kinds:
        result["picture"] = "data:image/png;base64," + base64.b64encode(draw(content)).decode("ascii")
    return result


def _aliases(content: Content) -> Callable[[str], str]:
    """Return the function that puts sensor1, sensor2, ... in the place of the sensors' own names.

    The names are those of the configuration and of the topics: the configuration of another version is not known.
    """
    config = content.config
    told = [found[1] for topic in content.topics if (found := re.match("/sensors/([^/]+)", topic))]
    names = dict.fromkeys([*(() if config is None else config.sensors), *told])
    number = {name: f"sensor{index}" for index, name in enumerate(names, 1)}
    own = re.compile(r"(?<![\w-])(" + "|".join(map(re.escape, number)) + r")(?![\w-])")
    return lambda text: own.sub(lambda found: number[found[1]], text) if number else text


def _settings(config: Config, kinds: Collection[str], called: Callable[[str], str]) -> dict[str, object]:
    """Return the settings that are not as by default, the vehicle's among them."""
    usual = dict(flatten(Config()))
    changed = [(key, value) for key, value in flatten(config) if key not in usual or usual[key] != value]
    apart = chain.from_iterable(
        [(f"{key}.{name}", each) for name, each in value.items()] if isinstance(value, dict) else [(key, value)]
        for key, value in changed
    )
    return {called(key): value if may_share(key, value, kinds) else LEFT_OUT for key, value in apart}


def may_share(key: str, value: object, kinds: Collection[str]) -> bool:
    """Return whether the value of a setting may be shared."""
    if PLACED.search(key):
        return "places" in kinds
    if "names" in kinds or value is None or isinstance(value, bool | int | float):
        return True
    return isinstance(value, str) and bool(SAFE_TEXTS.search(key) and WORD.fullmatch(value))


def share(path: Path, file: Path, robot: str | None, kinds: Collection[str]) -> Path:
    """Write what is shared of a recording; return the file; RecordingError: one cannot be read or written."""
    text = json.dumps(shared(path, robot, kinds), indent=1, default=str)
    try:
        file.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{file}: cannot write it: {error.strerror}") from None
    return file
