"""Small networks of convolutions and dense layers, trained with numpy alone.

How it works. A network has a trunk for each sensor: convolutions over a picture, or over a scan, which is a picture of
a single row. Numbers such as a light sensor's have no convolution. The outputs of the trunks are joined, and go through
dense layers to the outputs. Every layer but the last is followed by max(0, x).

A convolution is one product of matrices: the windows of the picture are laid out as rows (`_windows`), and the filters
are columns. Its gradient goes back the same way. Adam (arXiv 1412.6980) takes the steps. At the size of these networks,
some ten thousand parameters, this is as fast on a plain processor as a library of hundreds of megabytes.

Arrays are float32, pictures (n, height, width, channels).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.random import Generator
from numpy.typing import NDArray

Array = NDArray[np.float32]
BETAS: Final = (0.9, 0.999)
EPSILON: Final = 1e-7


class Convolution(NamedTuple):
    """Filters, the size of their window and its steps, (high, wide) in pixels; no padding."""

    filters: int
    window: tuple[int, int]
    stride: tuple[int, int]

    def size(self, height: int, width: int) -> tuple[int, int]:
        """Return the size of the output for a picture of this size."""
        (high, wide), (down, along) = self.window, self.stride
        return (height - high) // down + 1, (width - wide) // along + 1


class Shape(NamedTuple):
    """The shape of a network."""

    inputs: tuple[tuple[int, int, int], ...]
    """Height, width and channels of each sensor's input; numbers are 1, 1, n."""
    trunks: tuple[tuple[Convolution, ...], ...]
    """The convolutions of each sensor."""
    dense: tuple[int, ...]
    """Units of the dense layers."""
    outputs: int

    def features(self) -> list[int]:
        """Return how many numbers each sensor's trunk gives to the dense layers."""
        found = []
        for (height, width, channels), trunk in zip(self.inputs, self.trunks, strict=True):
            for each in trunk:
                height, width = each.size(height, width)
                channels = each.filters
            found.append(height * width * channels)
        return found

    def layers(self) -> list[tuple[int, int]]:
        """Return rows and columns of every layer's weights, in the order of `PolicyNetwork.weights`."""
        found = []
        for (_, _, channels), trunk in zip(self.inputs, self.trunks, strict=True):
            for each in trunk:
                found.append((each.window[0] * each.window[1] * channels, each.filters))
                channels = each.filters
        features = sum(self.features())
        for units in (*self.dense, self.outputs):
            found.append((features, units))
            features = units
        return found

    @property
    def parameters(self) -> int:
        """The number of trained parameters."""
        return sum((rows + 1) * columns for rows, columns in self.layers())


class PolicyNetwork:
    """A network of this shape, its weights drawn at random (He, arXiv 1502.01852)."""

    def __init__(self, shape: Shape, rng: Generator) -> None:
        self.shape = shape
        self.weights: list[Array] = []
        """Weights of each layer."""
        self.biases: list[Array] = []
        """Biases of each layer."""
        layers = shape.layers()
        for number, (rows, columns) in enumerate(layers):
            # the last layer starts small, so that the first outputs are near the middle
            scale = np.sqrt(2.0 / rows) * (0.1 if number == len(layers) - 1 else 1.0)
            self.weights.append((rng.standard_normal((rows, columns)) * scale).astype(np.float32))
            self.biases.append(np.zeros(columns, np.float32))

    def __call__(self, seen: Sequence[Array], kept: list[Any] | None = None, keep: Sequence[Array] = ()) -> Array:
        """Return the outputs, (n, outputs), of the sensors' inputs, each (n, height, width, channels).

        `kept` receives the values for `gradients`. `keep` has factors for the inputs of the dense layers, for drop-out.
        """
        number, features = 0, []
        for x, trunk in zip(seen, self.shape.trunks, strict=True):
            for each in trunk:
                rows = _windows(x, each)
                y = rows.reshape(-1, rows.shape[-1]) @ self.weights[number] + self.biases[number]
                y = np.maximum(y, 0.0).reshape(*rows.shape[:3], each.filters)
                if kept is not None:
                    kept.append((x.shape, rows, y))
                x, number = y, number + 1
            features.append(x.reshape(len(x), -1))
        x = np.concatenate(features, axis=1)
        last = len(self.weights) - 1
        for layer, index in enumerate(range(number, last + 1)):
            if layer < len(keep):
                x = x * keep[layer]
            y = x @ self.weights[index] + self.biases[index]
            if index < last:
                y = np.maximum(y, 0.0)
            if kept is not None:
                kept.append((x, y))
            x = y
        return x

    def gradients(
        self, seen: Sequence[Array], slope: Array, kept: list[Any], keep: Sequence[Array] = ()
    ) -> tuple[list[Array], list[Array], list[Array]]:
        """Return the loss's gradients with respect to weights, biases and inputs, from its `slope` with respect
        to the outputs.
        """
        by_weights: list[Array] = [np.zeros(0, np.float32)] * len(self.weights)
        by_biases = list(by_weights)
        first, last = len(self.weights) - len(self.shape.dense) - 1, len(self.weights) - 1
        for index in range(last, first - 1, -1):
            x, y = kept[index]
            if index < last:
                slope = slope * (y > 0.0)
            by_weights[index], by_biases[index] = x.T @ slope, slope.sum(0)
            slope = slope @ self.weights[index].T
            if index - first < len(keep):
                slope = slope * keep[index - first]
        by_inputs: list[Array] = []
        end, number = slope.shape[1], first
        for x, trunk in zip(reversed(seen), reversed(self.shape.trunks), strict=True):
            shape = kept[number - 1][2].shape if trunk else x.shape
            width = int(np.prod(shape[1:]))
            part = slope[:, end - width : end].reshape(shape)
            end -= width
            for each in reversed(trunk):
                number -= 1
                shape, rows, y = kept[number]
                flat = (part * (y > 0.0)).reshape(-1, each.filters)
                by_weights[number] = rows.reshape(-1, rows.shape[-1]).T @ flat
                by_biases[number] = flat.sum(0)
                part = _spread((flat @ self.weights[number].T).reshape(rows.shape), shape, each)
            by_inputs.insert(0, part)
        return by_weights, by_biases, by_inputs


def _windows(x: Array, layer: Convolution) -> Array:
    """Return every window of the pictures as a row, (n, high, wide, window's rows * columns * channels)."""
    (down, along) = layer.stride
    found = sliding_window_view(x, layer.window, axis=(1, 2))[:, ::down, ::along]
    found = found.transpose(0, 1, 2, 4, 5, 3)
    return found.reshape(*found.shape[:3], -1)


def _spread(rows: Array, shape: tuple[int, ...], layer: Convolution) -> Array:
    """Return the sum of windows, given as rows, over their pictures: the reverse of `_windows`."""
    (high, wide), (down, along) = layer.window, layer.stride
    count, tall, broad = rows.shape[:3]
    parts = rows.reshape(count, tall, broad, high, wide, shape[3])
    found = np.zeros(shape, np.float32)
    for row in range(high):
        for column in range(wide):
            end_row, end_column = row + (tall - 1) * down + 1, column + (broad - 1) * along + 1
            found[:, row:end_row:down, column:end_column:along] += parts[:, :, :, row, column]
    return found


class Adam:
    """Adam's steps for the parameters of a network, with weights that decay (arXiv 1711.05101)."""

    def __init__(self, network: PolicyNetwork, decay: float) -> None:
        self._parameters = [*network.weights, *network.biases]
        self._decays = [decay] * len(network.weights) + [0.0] * len(network.biases)
        self._first = [np.zeros_like(each) for each in self._parameters]
        self._second = [np.zeros_like(each) for each in self._parameters]
        self._steps = 0

    def step(self, by_weights: Sequence[Array], by_biases: Sequence[Array], rate: float) -> None:
        """Move the parameters, in place."""
        self._steps += 1
        one, two = BETAS
        scale = rate * np.sqrt(1.0 - two**self._steps) / (1.0 - one**self._steps)
        moments = zip(self._parameters, self._decays, self._first, self._second, strict=True)
        for slope, (parameter, decay, first, second) in zip([*by_weights, *by_biases], moments, strict=True):
            first += (1.0 - one) * (slope - first)
            second += (1.0 - two) * (slope * slope - second)
            parameter -= np.float32(scale) * first / (np.sqrt(second) + EPSILON) + np.float32(rate * decay) * parameter
