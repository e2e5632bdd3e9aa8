"""Networks: their gradients, and what training makes of lessons."""

import numpy as np
import pytest

from txt1.teaching.features import Layer, Seen, Sight, shape_of
from txt1.teaching.network import Convolution, PolicyNetwork, Shape
from txt1.teaching.training import LessonSet, Recipe, blocks, dropped, judged, train

SHAPE = Shape(
    ((12, 20, 3), (1, 1, 4), (1, 40, 1)),
    ((Convolution(4, (5, 5), (2, 2)), Convolution(5, (3, 3), (1, 2))), (), (Convolution(3, (1, 5), (1, 2)),)),
    (16, 8),
    2,
)


@pytest.mark.parametrize("part", range(3))
def test_gradients_are_those_of_small_differences(part):
    rng = np.random.default_rng(0)
    network = PolicyNetwork(SHAPE, rng)
    network.weights = [each.astype(float) for each in network.weights]
    network.biases = [each + 0.1 * rng.standard_normal(each.shape) for each in network.biases]
    seen = [rng.standard_normal((3, *size)) for size in SHAPE.inputs]

    def loss():
        return float((network(seen) ** 2).sum() / 2.0)

    kept = []
    outputs = network(seen, kept)
    gradients = network.gradients(seen, outputs, kept)
    for array, gradient in zip((network.weights, network.biases, seen)[part], gradients[part], strict=True):
        index = np.unravel_index(int(np.abs(gradient).argmax()), array.shape)
        before = array[index]
        array[index] = before + 1e-5
        more = loss()
        array[index] = before - 1e-5
        less = loss()
        array[index] = before
        assert (more - less) / 2e-5 == pytest.approx(gradient[index], rel=1e-3)


def bright_side(count, rng):
    """Lessons of a human who steers to the brighter side."""
    pictures = rng.random((count, 8, 12, 1), np.float32)
    side = rng.uniform(-1.0, 1.0, count).astype(np.float32)
    pictures[:, :, :6] += np.maximum(side, 0.0)[:, None, None, None]
    pictures[:, :, 6:] += np.maximum(-side, 0.0)[:, None, None, None]
    commands = np.column_stack((side, np.full(count, 0.5, np.float32)))
    sight = Sight("camera", "camera", (8, 12, 1), (Layer(4, (3, 3), (2, 2)),))
    return [sight], LessonSet(Seen((pictures,)), commands, np.ones(count, np.float32), 0.1 * np.arange(count))


def test_what_a_human_does_is_learned_and_held_out_blocks_show_it():
    sights, lessons = bright_side(400, np.random.default_rng(1))
    recipe = Recipe(members=2, dense=(8,), epochs=20, decay=1e-3, drop=0.0)
    results = judged(sights, lessons, recipe, 4, 1.0).results()
    assert results["steering_correlation"] > 0.9
    assert results["steering_rms"] < 0.5 * results["steering_deviation"]


def test_a_share_of_a_camera_is_dropped_and_nothing_else() -> None:
    layers = (Layer(4, (3, 3), (2, 2)),)
    sights = [
        Sight("odometry", "", (1, 1, 2)),
        Sight("camera", "camera", (8, 12, 1), layers),
        Sight("laser", "laser", (1, 40, 1), (Layer(3, (1, 5), (1, 2)),)),
    ]
    shape = shape_of(sights, (8,))
    shares = dropped(sights, shape, 0.3)
    assert len(shares) == shape.layers()[-2][0] == 2 + 3 * 5 * 4 + 18 * 3
    assert shares.tolist() == pytest.approx([0.0] * 2 + [0.3] * 60 + [0.0] * 54)


def bright_sensor(count: int, rng: np.random.Generator) -> tuple[list[Sight], LessonSet]:
    """Readings of four light sensors, and a human who steers by the first."""
    light = rng.random((count, 1, 1, 5), np.float32)
    commands = np.column_stack((light[:, 0, 0, 0], np.ones(count, np.float32)))
    return [Sight("light", "light", (1, 1, 5))], LessonSet(
        Seen((light,)), commands, np.ones(count, np.float32), 0.1 * np.arange(count)
    )


def test_numbers_alone_have_two_layers_and_convolutions_one() -> None:
    for (sights, lessons), dense in (
        (bright_sensor(100, np.random.default_rng(4)), (64, 64)),
        (bright_side(100, np.random.default_rng(5)), (32,)),
    ):
        assert train(sights, lessons, Recipe(members=1, epochs=1)).networks[0].shape.dense == dense


def test_the_same_seed_makes_the_same_networks():
    sights, lessons = bright_side(100, np.random.default_rng(2))
    one, other = (train(sights, lessons, Recipe(members=1, epochs=2, dense=(4,))) for _ in range(2))
    assert all((a == b).all() for a, b in zip(one.networks[0].weights, other.networks[0].weights, strict=True))


def test_no_lesson_near_a_held_out_block_is_taught():
    times = 0.1 * np.arange(100)
    for taught, held in blocks(times, 5, 1.0):
        assert np.abs(times[taught][:, None] - times[held][None]).min() >= 1.0 - 1e-9
    assert sum(len(held) for _, held in blocks(times, 5, 1.0)) == 100
