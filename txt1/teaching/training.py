"""Training: networks that do what a human did at the same sight.

The loss is the squared error of steering and speed, weighted by how much a lesson counts. Each network of the ensemble
gets the lessons in an order of its own. Some of them are mirrored: so left turns teach right turns. Some are disturbed
or thinned (drop-out): so no network depends on a single ray or a patch of light.

Blocks of time are held out. Neighbouring samples are nearly alike, so a network would recognise samples drawn at
random. Whole blocks, with a gap on either side, have to be understood. The card tells the error in these blocks. The
networks that drive are then taught with all lessons, because the last minute of a lesson is worth as much as the first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from txt1.teaching.network import Adam, PolicyNetwork, Shape
from txt1.teaching.onnx_file import Norm
from txt1.teaching.policy import doubts, normalised
from txt1.teaching.seeing import Seen, Sight, mirrored, shape_of

Array = NDArray[np.float32]
SCALE: Final = 2.0
"""Times as large, or as small, a world is at most, where lessons are scaled."""
SPEED_WEIGHT: Final = 0.3
"""What an error of the speed counts, against one of the steering."""


@dataclass(frozen=True)
class Recipe:
    """How networks are trained."""

    members: int = 5
    """Networks."""
    dense: tuple[int, ...] = (32,)
    """Units of the layers behind the convolutions."""
    epochs: int = 60
    """Times that all lessons are seen, at most; fewer with many lessons, so `steps` is kept to."""
    steps: int = 3000
    """Steps of each network at most."""
    batch: int = 64
    """Lessons in a step."""
    rate: float = 2e-3
    """Of Adam, at the start; it falls to 0 as a cosine."""
    decay: float = 0.1
    """Of the weights (`txt1.teaching.network.Adam`)."""
    drop: float = 0.3
    """Share of what the convolutions found that is left out in each step."""
    mirror: bool = True
    """Whether half of the lessons are seen in a mirror: not where a rule says which side to keep to."""
    scale: bool = True
    """Whether lessons by a laser alone are seen in larger and smaller worlds, too."""
    seed: int = 0
    """Repeats the training to the last bit, on the same kind of processor."""


class LessonSet(NamedTuple):
    """Sights and what a human did there."""

    seen: Seen
    commands: Array
    """(n, 2): share of full lock, share of the fastest speed."""
    weights: Array
    """(n,): how much each counts."""
    times: NDArray[np.float64]
    """(n,), s: lessons that are near in time are nearly alike. Recordings follow one another with a gap."""

    def at(self, index: Any) -> LessonSet:
        """Return those of an index."""
        return LessonSet(self.seen.at(index), self.commands[index], self.weights[index], self.times[index])

    def __len__(self) -> int:
        return len(self.times)


class Progress(NamedTuple):
    """How far a training is."""

    done: float
    """Share of all steps."""
    loss: float
    """Of the last epoch."""


Told = Callable[[Progress], None]


class Ensemble(NamedTuple):
    """Networks of one shape, and the norms of what they see."""

    networks: list[PolicyNetwork]
    norms: list[Norm]
    curves: list[list[float]]
    """Of each network, the loss of each epoch."""

    def outputs(self, seen: Seen) -> Array:
        """Return what each says, (networks, n, 2)."""
        normal = normalised(seen.parts, self.norms)
        return np.stack([network(normal) for network in self.networks])


def norms_of(seen: Seen) -> list[Norm]:
    """Return mean and deviation of each channel; a channel that never changes keeps its size."""
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
    """Return networks taught by the lessons, from `begin` on where that is given."""
    norms = norms_of(lessons.seen)
    normal = Seen(tuple(normalised(lessons.seen.parts, norms)))
    shape = shape_of(sights, recipe.dense)
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
    """Return one network, and its loss in each epoch."""
    network = PolicyNetwork(shape, rng)
    adam = Adam(network, recipe.decay)
    count = len(lessons)
    batches = max(1, count // recipe.batch)
    epochs = max(1, min(recipe.epochs, recipe.steps // batches))
    features = shape.layers()[-len(recipe.dense) - 1][0]
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
            keep = [(rng.random((len(index), features)) >= recipe.drop).astype(np.float32) / (1.0 - recipe.drop)]
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


def _disturbed(sight: Sight, normal: Array, norm: Norm, flip: NDArray[np.bool_], rng: Generator) -> Array:
    """Return what is seen through a worse device, those of `flip` mirrored."""
    if flip.any():
        # a mirror is one of what was seen, not of what was normalised
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
            # a black or shining surface takes a ray away
            lost = rng.random((count, rows, columns, 1), np.float32) < 0.02
            none = ((1.0 - norm.mean) / norm.deviation).astype(np.float32)
            normal = np.where(lost, none, normal + 0.02 * rng.standard_normal(normal.shape, np.float32))
        case "light" | "odometry":
            normal = normal + 0.05 * rng.standard_normal(normal.shape, np.float32)
    return normal


def _scaled(
    sights: Sequence[Sight], parts: Sequence[Array], norms: Sequence[Norm], commands: Array, rng: Generator
) -> tuple[list[Array], Array]:
    """Return the lessons in worlds that are larger by a factor s, and smaller, each by one of its own.

    A path there has the curvature over s, and at the same acceleration to the side the speed times the root of s. A
    range r is seen as f = r / (r + 1), so r = f / (1 - f).
    """
    size = (SCALE ** rng.uniform(-1.0, 1.0, len(commands))).astype(np.float32)
    found = []
    for _, part, norm in zip(sights, parts, norms, strict=True):
        share = (part * norm.deviation + norm.mean).clip(0.0, 1.0)
        ranges = size[:, None, None, None] * share / np.maximum(1.0 - share, 1e-6)
        found.append((((ranges / (ranges + 1.0)) - norm.mean) / norm.deviation).astype(np.float32))
    steering = (commands[:, 0] / size).clip(-1.0, 1.0)
    speed = (commands[:, 1] * np.sqrt(size)).clip(0.0, 1.0)
    return found, np.column_stack((steering, speed)).astype(np.float32)


# -- how well ----------------------------------------------------------------------------------------------------


class Judged(NamedTuple):
    """What networks said at sights that they had not been taught."""

    lessons: LessonSet
    outputs: Array
    """(networks, n, 2)."""

    @property
    def errors(self) -> NDArray[np.float64]:
        """Steering and speed minus what the human did, (n, 2)."""
        found: NDArray[np.float64] = self.outputs.mean(0).astype(float) - self.lessons.commands
        return found

    def results(self) -> dict[str, float]:
        """Root mean square of the errors, correlations, and what always doing the mean would give."""
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
        """How much the networks disagreed, (n,)."""
        return doubts(self.outputs)


def blocks(times: NDArray[np.float64], folds: int, gap: float) -> list[tuple[Any, Any]]:
    """Return for each fold what is taught and what is held out, as indices: blocks of equal numbers of lessons.

    `gap`: s on either side of a block in which nothing is taught.
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
    """Return how networks do on blocks of time that are held out in turn, each block by two networks' teaching."""
    trial = replace(recipe, members=min(2, recipe.members))
    outputs = np.zeros((trial.members, len(lessons), 2), np.float32)
    for number, (taught, held) in enumerate(blocks(lessons.times, folds, gap)):

        def tell(progress: Progress, number: int = number) -> None:
            told(Progress((number + progress.done) / folds, progress.loss))

        ensemble = train(sights, lessons.at(taught), trial, tell)
        outputs[:, held] = ensemble.outputs(lessons.seen.at(held))
    return Judged(lessons, outputs)


# -- what it looked at -------------------------------------------------------------------------------------------


def saliency(networks: Sequence[PolicyNetwork], norms: Sequence[Norm], seen: Sequence[Array]) -> list[Array]:
    """Return how much each place of one sight moves the steering, from 0 to 1: the gradient times the input's size."""
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
