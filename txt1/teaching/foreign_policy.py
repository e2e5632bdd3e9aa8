"""A policy from elsewhere: any network in an ONNX file, with a card that says what it sees and what it says.

    txt1 run --source foreign.onnx --card card.yaml

The card is YAML. The numbers of all its sights, one after the other, are the network's only input:

    sees:
      - {kind: laser, sensor: laser, beams: 541, first: -2.3562, last: 2.3562, clip: 10.0, scale: 1.0}
      - {kind: light, sensor: light}         # log(lux) / log(1000), four numbers from 0 to 1
      - {kind: odometry}                     # v and omega, m/s and rad/s
    says: {steering: rad, slow: 1.0, fast: 8.0}
    rate: 25.0

- A laser's beams are evenly spaced from `first` to `last`, rad in the robot's frame. Each takes the nearest beam of the
  robot's laser, clipped at `clip` m, where nothing in range counts as that, and divided by `scale`.
- `says` is the first output. With `steering: rad` or `share` it has two numbers: the front wheels' angle or the share
  of full lock, left positive; then the speed, 0 to 1 from `slow` to `fast` m/s. With `commands`, a list of [v, omega],
  it has a number for each, and the largest is taken.
- `rate` is how often a second it is asked, at most.

Its weights are in the file, or in `foreign.onnx.data` beside it, as PyTorch's exporter writes them; together at most
16 MB. onnxruntime gets the bytes and opens no file, whatever the network names.

A network whose shapes differ from the card is refused in words, and so is a robot that lacks what it sees. It drives as
a taught policy does (`policy_driver`), behind the same gate. It has no ensemble, so it has no doubt.
"""

from dataclasses import dataclass, field
from functools import cached_property
from math import inf, log, prod, tan
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from numpy.typing import NDArray

from txt1.config import Config
from txt1.config.sources import checked
from txt1.errors import ConfigError, MissingExtra
from txt1.file_limits import POLICY_MAX, read_bytes
from txt1.safe_yaml import read_yaml
from txt1.sensors.readings import Scan
from txt1.teaching.features import Unfit
from txt1.teaching.onnx_file import PolicyError
from txt1.teaching.policy import Judgement

Array = NDArray[np.float32]
LUX_MAX: Final = 1000.0
COUNTS: Final = {"light": 4, "odometry": 2}


@dataclass(frozen=True)
class ForeignSight:
    """What the network sees of a sensor."""

    kind: Literal["laser", "light", "odometry"]
    sensor: str = ""
    beams: Annotated[int, Ge(1), Le(100_000)] = 1
    first: float = 0.0
    """Angle of its first beam, rad in the robot's frame."""
    last: float = 0.0
    """Angle of its last beam, rad."""
    clip: Annotated[float, Gt(0.0)] = 10.0
    """Longest range, m."""
    scale: Annotated[float, Gt(0.0)] = 1.0
    """Ranges are divided by this, m."""

    @property
    def name(self) -> str:
        """Its name in messages."""
        return self.sensor or self.kind

    @property
    def count(self) -> int:
        """How many numbers it has."""
        return COUNTS.get(self.kind, self.beams)

    def seen(self, value: Any) -> Array:
        """Return the numbers of a reading; raises Unfit: it is another sensor's, or does not look far enough round."""
        match self.kind, value:
            case "laser", Scan():
                angles, wanted = value.angles, np.linspace(self.first, self.last, self.beams)
                order = np.argsort(angles)
                places = np.clip(np.searchsorted(angles[order], wanted), 1, len(angles) - 1)
                low, high = order[places - 1], order[places]
                nearest = np.where(wanted - angles[low] < angles[high] - wanted, low, high)
                if (np.abs(angles[nearest] - wanted) > abs(value.angle_step) + 1e-3).any():
                    raise Unfit(
                        f"'{self.name}' looks from {angles.min():.2f} to {angles.max():.2f} rad, and the policy sees "
                        f"from {min(self.first, self.last):.2f} to {max(self.first, self.last):.2f}"
                    )
                ranges = np.nan_to_num(value.ranges[nearest], nan=self.clip, posinf=self.clip)
                near: Array = (np.clip(ranges, 0.0, self.clip) / self.scale).astype(np.float32)
                return near
            case "light", tuple() if len(value) == 4:
                lux = np.nan_to_num(np.asarray(value, float), nan=0.0, posinf=LUX_MAX)
                bright: Array = (np.log(np.clip(lux, 1.0, LUX_MAX)) / log(LUX_MAX)).astype(np.float32)
                return bright
            case "odometry", _:
                return np.array(value, np.float32)
        raise Unfit(f"'{self.name}' tells no {self.kind}'s readings, but {type(value).__name__}")


@dataclass(frozen=True)
class Says:
    """What the network's output means."""

    steering: Literal["rad", "share"] | None = None
    """Unit of its first number; None with `commands`."""
    slow: Annotated[float, Ge(0.0), Le(100.0)] = 0.0
    """Speed for a second number of 0, m/s."""
    fast: Annotated[float, Gt(0.0), Le(100.0)] = 1.0
    """Speed for a second number of 1, m/s."""
    commands: Annotated[tuple[tuple[float, float], ...], MaxLen(1000)] = ()
    """v and omega of each number, m/s and rad/s; the largest number is taken."""

    @property
    def count(self) -> int:
        """How many numbers it has."""
        return len(self.commands) or 2


@dataclass(frozen=True)
class ForeignCard:
    """The card; its derived numbers are those that a driver asks of a taught policy's card, too."""

    sees: Annotated[tuple[ForeignSight, ...], MinLen(1), MaxLen(8)]
    says: Says
    rate: Annotated[float, Gt(0.0), Le(1000.0)]
    radius_min: float = field(default=0.0, init=False)
    doubt_slow: float = field(default=1.0, init=False)
    doubt_stop: float = field(default=inf, init=False)

    @property
    def v_max(self) -> float:
        """Its largest speed, m/s."""
        return max((abs(v) for v, _ in self.says.commands), default=self.says.fast) or 1.0


class ForeignPolicy:
    """A network from elsewhere on a robot of this configuration. Raises PolicyError: it does not fit its card."""

    def __init__(self, path: Path, card: ForeignCard, config: Config) -> None:
        self.path, self.card = path, card
        object.__setattr__(card, "radius_min", config.geometry.radius_min)
        self._lock = tan(config.geometry.steering_max)
        beside = path.with_name(f"{path.name}.data")
        there = beside.exists()
        if there and beside.resolve().parent != path.parent.resolve():
            raise PolicyError(f"{beside}: it is a link into another folder; put the file itself there")
        try:
            self._data = read_bytes(path, POLICY_MAX)
            self._weights = [read_bytes(beside, POLICY_MAX - len(self._data))] if there else []
        except OSError as error:
            raise PolicyError(f"{error.filename or path}: cannot read it: {error.strerror}; check the name") from None
        one, out = self.session.get_inputs(), self.session.get_outputs()
        if len(one) != 1:
            named = ", ".join(each.name for each in one)
            raise PolicyError(f"{path}: it has {len(one)} inputs ({named}); a policy from elsewhere has one")
        self._name = one[0].name
        # a size without a number is free: it becomes 1
        self._shape = [each if isinstance(each, int) and each > 0 else 1 for each in one[0].shape]
        wants, has = prod(self._shape), sum(sight.count for sight in card.sees)
        if one[0].type != "tensor(float)":
            raise PolicyError(f"{path}: its input is {one[0].type}; export it with 32-bit floats, tensor(float)")
        if wants != has:
            sights = " + ".join(f"{sight.count} of '{sight.name}'" for sight in card.sees)
            raise PolicyError(
                f"{path}: its input {one[0].shape} takes {wants} numbers, and the card sees {has}: {sights}"
            )
        found = self._run(np.zeros(has, np.float32))
        if found.size != card.says.count:
            told = f"its output '{out[0].name}' has {found.size} numbers, and by the card it says {card.says.count}"
            raise PolicyError(f"{path}: {told}; mend the card's says")

    @cached_property
    def session(self) -> Any:
        """The network as an onnxruntime session; raises MissingExtra, PolicyError: it is no network."""
        try:
            import onnxruntime
        except ImportError:
            raise MissingExtra("driving by a policy", "teach") from None
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        # no file is below a file, so it opens none
        options.add_session_config_entry("session.model_external_initializers_file_folder_path", str(self.path))
        beside, sizes = f"{self.path.name}.data", [len(one) for one in self._weights]
        try:
            options.add_external_initializers_from_files_in_memory([beside] * len(sizes), self._weights, sizes)
            return onnxruntime.InferenceSession(self._data, options, providers=["CPUExecutionProvider"])
        except Exception as error:
            told = " ".join(str(error).split())[:200]
            raise PolicyError(
                f"{self.path}: onnxruntime cannot load it: {told}; export it as a single ONNX file, "
                f"or with its weights in {beside} beside it"
            ) from None

    def _run(self, numbers: Array) -> NDArray[np.float64]:
        try:
            found = self.session.run(None, {self._name: numbers.reshape(self._shape)})[0]
        except Exception as error:
            told = " ".join(str(error).split())[:200]
            raise PolicyError(f"{self.path}: it cannot be run: {told}") from None
        return np.asarray(found, float).ravel()

    def judged(self, values: list[Any]) -> Judgement:
        """Return its judgement of its sensors' values; raises Unfit."""
        card, says = self.card, self.card.says
        numbers = np.concatenate([sight.seen(value) for sight, value in zip(card.sees, values, strict=True)])
        found = self._run(numbers)
        if not np.isfinite(found).all():
            return Judgement(inf, inf, 0.0)
        if says.commands:
            v, omega = says.commands[int(found.argmax())]
            steering = omega * card.radius_min / v if v else 0.0
        else:
            first, second = found.tolist()
            v = says.slow + min(max(second, 0.0), 1.0) * (says.fast - says.slow)
            steering = tan(min(max(first, -1.5), 1.5)) / self._lock if says.steering == "rad" else first
        return Judgement(min(max(steering, -1.0), 1.0), min(max(v / card.v_max, 0.0), 1.0), 0.0)


def load(path: Path, card: Path, config: Config) -> ForeignPolicy:
    """Return the policy of a file and its card; raises ConfigError: the card is wrong; PolicyError, MissingExtra."""
    try:
        tree = read_yaml(card.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"--card {card}: cannot be read: {' '.join(str(error).split())[:200]}") from None
    if not isinstance(tree, dict):
        raise ConfigError(f"--card {card}: is no card; give it the keys sees, says and rate")
    told = checked(ForeignCard, tree, "card")
    if (told.says.steering is None) == (not told.says.commands):
        raise ConfigError("card.says: give either steering (rad or share) or commands, a list of [v, omega]")
    if told.sees[0].kind == "odometry" or any(sight.kind != "odometry" and not sight.sensor for sight in told.sees):
        raise ConfigError("card.sees: name a sensor for each sight (sensor: laser), and give odometry after the first")
    if any(v < 0.0 for v, _ in told.says.commands):
        raise ConfigError("card.says.commands: a policy drives forward; give speeds of 0 or more")
    return ForeignPolicy(path, told, config)
