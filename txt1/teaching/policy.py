"""A policy: networks that steer by sensors, and a card with its sensors, teachers and lessons.

The steering is the share of full lock, -1 (right) to 1 (left): the path's curvature times the least turning radius of
the car. The speed is a share of the largest speed allowed in the lessons. Every network of the ensemble was taught on
its own random order of the lessons. In known situations the networks agree; their disagreement is the policy's doubt
(Lakshminarayanan, arXiv 1612.01474).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from math import isfinite, prod
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from numpy.typing import NDArray

from txt1.config.sources import checked
from txt1.errors import ConfigError, MissingExtra
from txt1.file_limits import POLICY_MAX, read_bytes
from txt1.teaching.features import Sight, check, seen, shape_of
from txt1.teaching.network import PolicyNetwork, Shape
from txt1.teaching.onnx_file import Norm, PolicyError, card_of, read, written

Array = NDArray[np.float32]
FORMAT: Final = 1
PRODUCTS_MAX: Final = 50_000_000
"""Largest number of multiplications for a judgement: some 50 ms of a slow processor."""


@dataclass(frozen=True)
class Taught:
    """A recording from which a policy was taught."""

    file: str
    sha256: str
    seconds: float
    """Duration of human driving in it, s."""
    by: dict[str, float]
    """Seconds by driving source."""
    takeover: float = 0.0
    """Seconds of take-overs from a policy among them."""
    takeovers: int = 0
    """Number of take-overs."""
    left_out: dict[str, float] = field(default_factory=dict)
    """Seconds that were left out, by reason."""


@dataclass(frozen=True)
class Card:
    """A policy's description of itself."""

    format: Annotated[int, Ge(FORMAT), Le(FORMAT)]
    version: str
    """Version of txt1 that taught it."""
    made: str
    """Date of the teaching."""
    sees: Annotated[tuple[Sight, ...], MinLen(1), MaxLen(8)]
    members: Annotated[int, Ge(1), Le(16)]
    """Number of networks."""
    dense: Annotated[tuple[Annotated[int, Ge(1), Le(1024)], ...], MaxLen(8)]
    v_max: Annotated[float, Gt(0.0), Le(100.0)]
    """Speed for an output of 1, m/s."""
    radius_min: Annotated[float, Gt(0.0), Le(100.0)]
    """Turning radius for a steering of 1, m."""
    doubt_slow: Annotated[float, Gt(0.0)]
    """Beyond this doubt it drives slower."""
    doubt_stop: Annotated[float, Gt(0.0)]
    """Beyond this doubt it stands."""
    vehicle: str = "txt1"
    taught_by: Annotated[tuple[Taught, ...], MaxLen(1000)] = ()
    results: dict[str, float] = field(default_factory=dict)
    """Results on held-out lessons."""
    weights: str = ""
    """SHA-256 of the weights."""

    @property
    def shape(self) -> Shape:
        """Shape of each network."""
        return shape_of(self.sees, self.dense)

    @property
    def norms(self) -> list[Norm]:
        """Norm of each sight."""
        return [Norm(np.array(each.mean, np.float32), np.array(each.deviation, np.float32)) for each in self.sees]

    @property
    def names(self) -> list[str]:
        """Name of each sight."""
        return [each.name for each in self.sees]


class Judgement(NamedTuple):
    """A policy's judgement of its inputs."""

    steering: float
    """Share of full lock, left positive."""
    speed: float
    """Share of the largest speed."""
    doubt: float
    """Disagreement of the networks: standard deviation of their steering and speed together."""

    @property
    def finite(self) -> bool:
        """Whether all values are finite."""
        return isfinite(self.steering) and isfinite(self.speed) and isfinite(self.doubt)


def judgement(commands: Array) -> Judgement:
    """Return the joint judgement of networks, from their outputs, (networks, 2)."""
    steering, speed = (float(each) for each in commands.mean(0))
    doubt = float(np.sqrt(commands.astype(float).var(0).sum()))
    return Judgement(min(max(steering, -1.0), 1.0), min(max(speed, 0.0), 1.0), doubt)


def doubts(commands: Array) -> NDArray[np.float64]:
    """Return the doubt at many times, from outputs (networks, n, 2)."""
    found: NDArray[np.float64] = np.sqrt(commands.astype(float).var(0).sum(1))
    return found


class Policy:
    """An ensemble of networks and its card."""

    def __init__(self, card: Card, networks: Sequence[PolicyNetwork], data: bytes | None = None) -> None:
        self.card = card
        self.networks = list(networks)
        self._data = data

    @property
    def data(self) -> bytes:
        """The bytes of its file."""
        if self._data is None:
            self._data = written(self.networks, self.card.norms, self.card.names, _text(self.card))
        return self._data

    def save(self, path: Path) -> None:
        """Write the file; raises PolicyError: it cannot be written."""
        try:
            half = path.with_name(f".{path.name}.part")
            half.write_bytes(self.data)
            half.replace(path)
        except OSError as error:
            raise PolicyError(f"{path}: cannot write it: {error.strerror}") from None

    def outputs(self, inputs: Sequence[Array]) -> Array:
        """Return the networks' outputs, (networks, n, 2), for many inputs at once, by numpy."""
        normal = normalised(inputs, self.card.norms)
        return np.stack([network(normal) for network in self.networks])

    @cached_property
    def session(self) -> Any:
        """The networks as an onnxruntime session; raises MissingExtra."""
        try:
            import onnxruntime
        except ImportError:
            raise MissingExtra("driving by a policy", "teach") from None
        options = onnxruntime.SessionOptions()
        # another thread would cost more than it saves at this size, and would compete with the robot's own
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        return onnxruntime.InferenceSession(self.data, options, providers=["CPUExecutionProvider"])

    def judged(self, values: Sequence[Any]) -> Judgement:
        """Return the judgement of its sensors' values.

        Raises Unfit: a value is from another device than in the lessons.
        """
        sights = self.card.sees
        for sight, value in zip(sights, values, strict=True):
            check(sight, value)
        return self.judge([seen(sight, value) for sight, value in zip(sights, values, strict=True)])

    def judge(self, inputs: Sequence[Array]) -> Judgement:
        """Return the judgement of one input per sight, (rows, columns, channels) each."""
        named = {name: each[None] for name, each in zip(self.card.names, inputs, strict=True)}
        (commands,) = self.session.run(None, named)
        return judgement(commands)


def normalised(seen: Sequence[Array], norms: Sequence[Norm]) -> list[Array]:
    """Return inputs scaled to mean 0 and deviation 1 in the lessons."""
    return [(each - norm.mean) * (1.0 / norm.deviation) for each, norm in zip(seen, norms, strict=True)]


def digest(networks: Sequence[PolicyNetwork]) -> str:
    """Return the SHA-256 of the networks' weights."""
    found = hashlib.sha256()
    for network in networks:
        for each in (*network.weights, *network.biases):
            found.update(np.ascontiguousarray(each, "<f4").tobytes())
    return found.hexdigest()


def _text(card: Card) -> str:
    return json.dumps(asdict(card), separators=(",", ":"), sort_keys=True)


def load(path: Path) -> Policy:
    """Return the policy of a file; raises PolicyError, which names the file: it is no policy, damaged, or too large."""
    try:
        data = read_bytes(path, POLICY_MAX)
    except OSError as error:
        raise PolicyError(f"{path}: cannot read it: {error.strerror}; check the name") from None
    try:
        return loaded(data)
    except PolicyError as error:
        raise PolicyError(f"{path}: {error}") from None


def loaded(data: bytes) -> Policy:
    """Return the policy of a file's bytes; raises PolicyError."""
    if len(data) > POLICY_MAX:
        raise PolicyError(f"a policy has at most {POLICY_MAX // 1_000_000} MB")
    text = card_of(data)
    try:
        told = json.loads(text)
        if not isinstance(told, dict):
            raise PolicyError("its card is damaged")
        card = checked(Card, told, "card")
    except (ValueError, RecursionError, ConfigError) as error:
        raise PolicyError(f"its card is damaged: {' '.join(str(error).split())[:200]}") from None
    _bounded(card)
    networks = read(data, card.shape, card.members, card.norms, card.names, text)
    if digest(networks) != card.weights:
        raise PolicyError("its weights differ from the taught weights, so it is damaged")
    return Policy(card, networks, data)


def _bounded(card: Card) -> None:
    """Raise PolicyError if a card describes more than a small network."""
    products = 0
    if len(set(card.names)) != len(card.names):
        raise PolicyError("it sees a sensor twice")
    for sight in card.sees:
        rows, columns, channels = sight.size
        if prod(sight.size) > 100_000:
            raise PolicyError(f"it sees {prod(sight.size)} numbers of '{sight.name}'; 100000 at most")
        if not len(sight.mean) == len(sight.deviation) == channels or not all(map(isfinite, sight.mean)):
            raise PolicyError("its card is damaged: a mean and a deviation for each channel")
        if not all(isfinite(each) and each > 0.0 for each in sight.deviation):
            raise PolicyError("its card is damaged: a deviation is not positive")
        for layer in sight.trunk:
            (high, wide), (down, along) = layer.window, layer.stride
            if high > rows or wide > columns:
                raise PolicyError("its card is damaged: a window larger than its picture")
            rows, columns = (rows - high) // down + 1, (columns - wide) // along + 1
            products += rows * columns * high * wide * channels * layer.filters
            channels = layer.filters
    products += sum(rows * columns for rows, columns in card.shape.layers()[-len(card.dense) - 1 :])
    if products * card.members > PRODUCTS_MAX or card.shape.parameters * card.members * 4 > POLICY_MAX:
        raise PolicyError("it is too large to drive by: a look would take longer than a small computer has")
