"""Training: networks learn a human's commands from the same inputs.

The loss is the squared error of steering and speed, times the weight of the lesson. Each network of the ensemble gets
the lessons in an order of its own. Some of them are mirrored: so left turns teach right turns. Some are disturbed or
thinned (drop-out): so no network depends on a single ray or a patch of light.

Blocks of time are held out. Neighbouring samples are nearly equal, so a network would recognise single samples drawn at
random. It cannot recognise whole blocks with a gap on either side. The card has the error in these blocks. The networks
that drive are then taught with all lessons, because the last minute of a lesson is worth as much as the first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from txt1.teaching.features import Seen, Sight, mirrored, shape_of
from txt1.teaching.network import Adam, PolicyNetwork, Shape
from txt1.teaching.onnx_file import Norm
from txt1.teaching.policy import doubts, normalised

Array = NDArray[np.float32]
SCALE_MAX: Final = 2.0
"""Largest factor by which a world is scaled up or down, if lessons are scaled."""
FULL_SPEED_SHARE: Final = 0.98
"""Share of the fastest speed from which a human might have driven faster still, if that had been allowed."""
HABIT: Final = 0.5
"""Disturbance of odometry in training, as a share of its deviation. A car mostly goes on turning as it turns, so a
network that trusts odometry does the same, whatever it sees.
"""
SPEED_WEIGHT: Final = 0.3
"""Weight of a speed error relative to a steering error."""


@dataclass(frozen=True)
class Recipe:
    """The parameters of a training."""

    members: int = 5
    """Number of networks."""
    dense: tuple[int, ...] | None = None
    """Units of the dense layers; None: 32 after convolutions, 64 and 64 if all inputs are plain numbers."""
    epochs: int = 60
    """Largest number of passes over all lessons; with many lessons fewer, because of `steps`."""
    steps: int = 3000
    """Largest number of steps of each network."""
    batch: int = 64
    """Number of lessons in a step."""
    rate: float = 2e-3
    """Initial rate of Adam; it falls to 0 as a cosine."""
    decay: float = 0.1
    """Decay of the weights (`txt1.teaching.network.Adam`)."""
    drop: float = 0.3
    """Share of the outputs of a camera's convolutions that is dropped in each step."""
    mirror: bool = True
    """Whether half of the lessons are mirrored; not if a rule requires one side of the way."""
    scale: bool = True
    """Whether lessons of a laser alone are also scaled to larger and smaller worlds."""
    seed: int = 0
    """Repeats the training to the last bit, on the same kind of processor."""


class LessonSet(NamedTuple):
    """Inputs, and the human's commands at the same times."""

    seen: Seen
    commands: Array
    """(n, 2): share of full lock, share of the fastest speed."""
    weights: Array
    """(n,): weight of each lesson."""
    times: NDArray[np.float64]
    """(n,), s: lessons close in time are nearly equal. Recordings follow one another with a gap."""

    def at(self, index: Any) -> LessonSet:
        """Return the lessons at an index."""
        return LessonSet(self.seen.at(index), self.commands[index], self.weights[index], self.times[index])

    def __len__(self) -> int:
        return len(self.times)


class Progress(NamedTuple):
    """The progress of a training."""

    done: float
    """Share of all steps."""
    loss: float
    """Loss of the last epoch."""


Told = Callable[[Progress], None]


class Ensemble(NamedTuple):
    """Networks of equal shape, and the norms of their inputs."""

    networks: list[PolicyNetwork]
    norms: list[Norm]
    curves: list[list[float]]
    """Loss of each epoch, for each network."""

    def outputs(self, seen: Seen) -> Array:
        """Return the output of each network, (networks, n, 2)."""
        normal = normalised(seen.parts, self.norms)
        return np.stack([network(normal) for network in self.networks])


def norms_of(seen: Seen) -> list[Norm]:
    """Return mean and deviation of each channel; a constant channel is not scaled."""
    found = []
    for each in seen.parts:
        flat = each.reshape(-1, each.shape[-1])
        deviation = flat.std(0, dtype=np.float64)
        deviation[deviation < 1e-4] = 1.0
        found.append(Norm(flat.mean(0, dtype=np.float64).astype(np.float32), deviation.astype(np.float32)))
    return found


def train(
    sights: Sequence[Sight],
    lessons: LessonSet,
    recipe: Recipe,
    told: Told = lambda progress: None,
    begin: Sequence[PolicyNetwork] = (),
) -> Ensemble:
    """Return networks taught from the lessons, starting from the networks in `begin` if given."""
    norms = norms_of(lessons.seen)
    normal = Seen(tuple(normalised(lessons.seen.parts, norms)))
    dense = (32,) if any(sight.trunk for sight in sights) else (64, 64)
    shape = shape_of(sights, recipe.dense or dense)
    networks, curves = [], []
    for number in range(recipe.members):

        def tell(done: float, loss: float, number: int = number) -> None:
            told(Progress((number + done) / recipe.members, loss))

        rng = default_rng([recipe.seed, number])
        network, curve = _member(sights, shape, normal, lessons, norms, recipe, rng, tell)
        networks.append(network)
        curves.append(curve)
    return Ensemble(networks, norms, curves)


def _member(
    sights: Sequence[Sight],
    shape: Shape,
    normal: Seen,
    lessons: LessonSet,
    norms: Sequence[Norm],
    recipe: Recipe,
    rng: Generator,
    tell: Callable[[float, float], None],
) -> tuple[PolicyNetwork, list[float]]:
    """Return a trained network, and its loss in each epoch."""
    network = PolicyNetwork(shape, rng)
    adam = Adam(network, recipe.decay)
    count = len(lessons)
    batches = max(1, count // recipe.batch)
    epochs = max(1, min(recipe.epochs, recipe.steps // batches))
    shares = dropped(sights, shape, recipe.drop)
    held = (1.0 - shares).astype(np.float32)
    counts = np.array([1.0, SPEED_WEIGHT], np.float32)
    scalable = recipe.scale and {sight.kind for sight in sights} == {"laser"}
    chances = lessons.weights.astype(float) / lessons.weights.sum()
    curve, step = [], 0
    for _ in range(epochs):
        order = rng.choice(count, size=batches * min(recipe.batch, count), p=chances)
        total = 0.0
        for index in order.reshape(batches, -1):
            seen, commands = normal.at(index), lessons.commands[index]
            flip = rng.random(len(index)) < (0.5 if recipe.mirror else 0.0)
            parts = [_disturbed(*each, flip, rng) for each in zip(sights, seen.parts, norms, strict=True)]
            commands = commands.copy()
            commands[flip, 0] *= -1.0
            if scalable:
                parts, commands = _scaled(sights, parts, norms, commands, rng)
            keep = [(rng.random((len(index), len(shares))) >= shares).astype(np.float32) / held]
            kept: list[Any] = []
            error = network(parts, kept, keep) - commands
            by_weights, by_biases, _ = network.gradients(parts, error * counts / np.float32(len(index)), kept, keep)
            step += 1
            rate = 0.5 * recipe.rate * (1.0 + np.cos(np.pi * step / (epochs * batches)))
            adam.step(by_weights, by_biases, float(rate))
            total += float((error * error * counts).sum()) / len(index)
        curve.append(total / batches)
        tell(step / (epochs * batches), curve[-1])
    return network, curve


def dropped(sights: Sequence[Sight], shape: Shape, share: float) -> NDArray[np.float64]:
    """Return the share of each dense input that is dropped: of a camera's, which are many for few lessons."""
    return np.repeat([share if sight.kind == "camera" else 0.0 for sight in sights], shape.features())


def _disturbed(sight: Sight, normal: Array, norm: Norm, flip: NDArray[np.bool_], rng: Generator) -> Array:
    """Return inputs as from a worse device; those in `flip` are mirrored."""
    if flip.any():
        # the mirror applies to the inputs before normalisation
        there = mirrored(sight, normal[flip] * norm.deviation + norm.mean)
        normal = normal.copy()
        normal[flip] = (there - norm.mean) / norm.deviation
    count, rows, columns, _ = normal.shape
    match sight.kind:
        case "camera":
            contrast = 1.0 + 0.2 * rng.standard_normal((count, 1, 1, 1), np.float32)
            brightness = 0.3 * rng.standard_normal((count, 1, 1, 1), np.float32)
            down, along = int(rng.integers(-1, 2)), int(rng.integers(-2, 3))
            normal = np.roll(normal * contrast + brightness, (down, along), (1, 2))
        case "laser":
            # a black or shining surface swallows a ray
            lost = rng.random((count, rows, columns, 1), np.float32) < 0.02
            none = ((1.0 - norm.mean) / norm.deviation).astype(np.float32)
            normal = np.where(lost, none, normal + 0.02 * rng.standard_normal(normal.shape, np.float32))
        case "light":
            normal = normal + 0.05 * rng.standard_normal(normal.shape, np.float32)
        case "odometry":
            normal = normal + HABIT * rng.standard_normal(normal.shape, np.float32)
    return normal


def _scaled(
    sights: Sequence[Sight], parts: Sequence[Array], norms: Sequence[Norm], commands: Array, rng: Generator
) -> tuple[list[Array], Array]:
    """Return the lessons in worlds scaled by random factors s, a factor for each lesson.

    The path's curvature is divided by s. At the same sideways acceleration the speed is multiplied by the root of s. A
    range r is seen as f = r / (r + 1), so r = f / (1 - f).

    A lesson at the top speed is taken to larger worlds only: in a smaller one, the human might drive just as fast.
    """
    size = (SCALE_MAX ** rng.uniform(-1.0, 1.0, len(commands))).astype(np.float32)
    size = np.where(commands[:, 1] > FULL_SPEED_SHARE, np.maximum(size, 1.0 / size), size)
    found = []
    for _, part, norm in zip(sights, parts, norms, strict=True):
        share = (part * norm.deviation + norm.mean).clip(0.0, 1.0)
        ranges = size[:, None, None, None] * share / np.maximum(1.0 - share, 1e-6)
        found.append((((ranges / (ranges + 1.0)) - norm.mean) / norm.deviation).astype(np.float32))
    steering = (commands[:, 0] / size).clip(-1.0, 1.0)
    speed = (commands[:, 1] * np.sqrt(size)).clip(0.0, 1.0)
    return found, np.column_stack((steering, speed)).astype(np.float32)


# -- results --------------------------------------------------------------------------------------------------------


class Judged(NamedTuple):
    """The outputs of networks for inputs that they were not taught."""

    lessons: LessonSet
    outputs: Array
    """(networks, n, 2)."""

    @property
    def errors(self) -> NDArray[np.float64]:
        """Errors of steering and speed against the human, (n, 2)."""
        found: NDArray[np.float64] = self.outputs.mean(0).astype(float) - self.lessons.commands
        return found

    def results(self) -> dict[str, float]:
        """Root mean square errors, correlations, and the error of a constant mean."""
        errors, done = self.errors, self.lessons.commands.astype(float)
        found = {"samples": float(len(done))}
        for column, name in enumerate(("steering", "speed")):
            said, did = self.outputs.mean(0)[:, column].astype(float), done[:, column]
            moves = said.std() > 1e-9 and did.std() > 1e-9
            found |= {
                f"{name}_rms": float(np.sqrt(np.mean(errors[:, column] ** 2))),
                f"{name}_correlation": float(np.corrcoef(said, did)[0, 1]) if moves else 0.0,
                f"{name}_deviation": float(did.std()),
            }
        return {name: round(value, 5) for name, value in found.items()}

    @property
    def doubts(self) -> NDArray[np.float64]:
        """Disagreement of the networks, (n,)."""
        return doubts(self.outputs)


def blocks(times: NDArray[np.float64], folds: int, gap: float) -> list[tuple[Any, Any]]:
    """Return the taught and the held-out lessons of each fold, as indices: blocks with equal numbers of lessons.

    `gap`: s on either side of a block that are not taught.
    """
    found = []
    for held in np.array_split(np.arange(len(times)), folds):
        near = (times > times[held[0]] - gap) & (times < times[held[-1]] + gap)
        found.append((np.flatnonzero(~near), held))
    return found


def judged(
    sights: Sequence[Sight],
    lessons: LessonSet,
    recipe: Recipe,
    folds: int,
    gap: float,
    told: Told = lambda progress: None,
) -> Judged:
    """Return the results of networks on blocks held out in turn; two networks are taught for each block."""
    trial = replace(recipe, members=min(2, recipe.members))
    outputs = np.zeros((trial.members, len(lessons), 2), np.float32)
    for number, (taught, held) in enumerate(blocks(lessons.times, folds, gap)):

        def tell(progress: Progress, number: int = number) -> None:
            told(Progress((number + progress.done) / folds, progress.loss))

        ensemble = train(sights, lessons.at(taught), trial, tell)
        outputs[:, held] = ensemble.outputs(lessons.seen.at(held))
    return Judged(lessons, outputs)


# -- importance of the inputs ---------------------------------------------------------------------------------------


def saliency(networks: Sequence[PolicyNetwork], norms: Sequence[Norm], seen: Sequence[Array]) -> list[Array]:
    """Return the influence of each place of a sight on the steering, 0 to 1: the gradient times the input's size."""
    normal = normalised([each[None] for each in seen], norms)
    totals = [np.zeros(each.shape[:2], np.float32) for each in seen]
    for network in networks:
        kept: list[Any] = []
        network(normal, kept)
        slope = np.array([[1.0, 0.0]], np.float32)
        _, _, by_inputs = network.gradients(normal, slope, kept)
        for total, each in zip(totals, by_inputs, strict=True):
            total += np.abs(each[0]).sum(-1)
    return [total / max(float(total.max()), 1e-9) for total in totals]
