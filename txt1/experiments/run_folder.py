"""The folder of a run: its samples, its metrics, its figure."""

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final, NamedTuple

from pydantic import ValidationError

from txt1.errors import ConfigError
from txt1.experiments import recording as recordings
from txt1.experiments.metrics import judge
from txt1.experiments.profile import Profile
from txt1.experiments.recording import Recording
from txt1.experiments.runner import Leg
from txt1.file_limits import JSON_MAX, read_text

METRICS: Final = "metrics.json"
FILES: Final = (recordings.FILE, METRICS)
FIGURE: Final = "figure.svg"


class Run(NamedTuple):
    """A run for drawing and comparing."""

    # its name in legends and tables
    label: str
    # the profile driven
    profile: Profile
    # the samples
    recording: Recording
    # the result of `txt1.experiments.metrics.measure`
    metrics: dict[str, Any]

    @property
    def legs(self) -> list[Leg]:
        """The legs of waypoints."""
        return [Leg(time, tuple(start), tuple(end)) for time, start, end in self.metrics.get("legs_driven", [])]


def alike(runs: Sequence[Run]) -> list[Run]:
    """Return the runs; unless the true motion of all is known, all are judged by their encoders."""
    if len({run.recording.knows_truth for run in runs}) == 1:
        return list(runs)
    plain = [run._replace(recording=run.recording.without_truth()) for run in runs]
    return [run._replace(metrics=run.metrics | judge(run.recording, run.legs, run.profile)) for run in plain]


def make(folder: Path) -> Path:
    """Return the folder, made if it is missing; raises ConfigError if it is not writable."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ConfigError(f"{folder}: cannot write results there: {error.strerror}; choose another place") from None
    return folder


def write(run: Run, folder: Path) -> None:
    """Write samples and metrics; `txt1.experiments.figures` draws the figure."""
    folder.mkdir(parents=True, exist_ok=True)
    recordings.save(run.recording, folder)
    tree = {"label": run.label, "profile": json.loads(run.profile.model_dump_json()), **run.metrics}
    (folder / METRICS).write_text(json.dumps(tree, indent=1) + "\n")


def read(folder: Path) -> Run:
    """Return the run in a folder; raises ConfigError: there is none."""
    file = folder / METRICS
    try:
        tree = json.loads(read_text(file, JSON_MAX))
        profile = Profile.model_validate(tree.pop("profile"))
        return Run(str(tree.pop("label")), profile, recordings.load(folder), tree)
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror}; give a folder that an experiment's --out made") from None
    except (ValueError, KeyError, AttributeError, ValidationError) as error:
        raise ConfigError(f"{file}: is not of a run ({str(error).splitlines()[0]}); make the run again") from None
