"""Networks as ONNX files, written and read without the library: the necessary messages as protobuf bytes.

How it works. `written` makes the bytes of an ensemble of networks, with a card of text in the metadata. The same
networks and the same card always make the same bytes. So `read` trusts nothing. It takes the card and the weights from
a file, writes the file again from them, and refuses it unless each byte is the same. A graph with a hidden operator, a
loop, an external file or an endless product cannot pass, as this module would not have written it. The remaining checks
are of sizes, before they are used, and that the numbers are finite.

The graph of a network has a branch for each sensor: Sub and Mul (by the mean and deviation of the lessons), Transpose
to ONNX's order of axes, Conv and Relu, Transpose back, Reshape. Concat joins the branches; Gemm, Relu and Gemm follow.
The outputs of all networks are stacked.

Field numbers are those of onnx.proto (ONNX 1.14, IR version 8).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import Txt1Error
from txt1.teaching.network import PolicyNetwork, Shape

Array = NDArray[np.float32]
IR_VERSION: Final = 8
OPSET: Final = 13
# TensorProto.DataType
FLOAT: Final = 1
INT64: Final = 7
# kinds of fields on the wire
_VARINT, _BYTES = 0, 2


class PolicyError(Txt1Error):
    """A file is no policy, or a policy that cannot be used here; the text gives the reason in a line."""


# -- protobuf ----------------------------------------------------------------------------------------------------


def _varint(value: int) -> bytes:
    value &= (1 << 64) - 1
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


def _field(number: int, value: int | str | bytes) -> bytes:
    if isinstance(value, int):
        return _varint(number << 3 | _VARINT) + _varint(value)
    data = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | _BYTES) + _varint(len(data)) + data


def _fields(data: memoryview) -> Iterator[tuple[int, Any]]:
    """Yield each field's number and its value, an integer or bytes; raises PolicyError for any other field."""
    at = 0
    while at < len(data):
        tag, at = _read_varint(data, at)
        value, at = _read_varint(data, at)
        if tag & 7 == _BYTES:
            if value > len(data) - at:
                raise PolicyError("it breaks off")
            yield tag >> 3, data[at : at + value]
            at += value
        elif tag & 7 == _VARINT:
            yield tag >> 3, value
        else:
            raise PolicyError("it is no ONNX file of txt1's")


def _read_varint(data: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 64, 7):
        if at >= len(data):
            raise PolicyError("it breaks off")
        byte, at = data[at], at + 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise PolicyError("it is no ONNX file")


# -- writing -----------------------------------------------------------------------------------------------------


class _Graph:
    """A graph that is being built."""

    def __init__(self) -> None:
        self.nodes = bytearray()
        self.constants = bytearray()
        self._count = 0

    def node(self, kind: str, inputs: Sequence[str], output: str = "", **attributes: int | Sequence[int]) -> str:
        """Add an operator; return the name of its output."""
        self._count += 1
        output = output or f"{kind.lower()}_{self._count}"
        data = b"".join(_field(1, each) for each in inputs) + _field(2, output) + _field(4, kind)
        for name, value in attributes.items():
            if isinstance(value, int):
                attribute = _field(1, name) + _field(3, value) + _field(20, 2)
            else:
                attribute = _field(1, name) + b"".join(_field(8, each) for each in value) + _field(20, 7)
            data += _field(5, attribute)
        self.nodes += _field(1, data)
        return output

    def constant(self, name: str, values: NDArray[Any]) -> str:
        """Add a constant; return its name."""
        data = b"".join(_field(1, each) for each in values.shape)
        data += _field(2, INT64 if values.dtype == np.int64 else FLOAT) + _field(8, name)
        little = values.astype(values.dtype.newbyteorder("<"))
        self.constants += _field(5, data + _field(9, little.tobytes()))
        return name


def _value(number: int, name: str, shape: Sequence[int]) -> bytes:
    """Return an input or output of the graph, of floats in this shape."""
    dimensions = b"".join(_field(1, _field(1, each)) for each in shape)
    tensor = _field(1, FLOAT) + _field(2, dimensions)
    return _field(number, _field(1, name) + _field(2, _field(1, tensor)))


class Norm(NamedTuple):
    """Mean and deviation of each channel in the lessons."""

    mean: Array
    deviation: Array


def written(networks: Sequence[PolicyNetwork], norms: Sequence[Norm], names: Sequence[str], card: str) -> bytes:
    """Return the bytes of an ensemble of networks of equal shape; `norms` and `names` are those of its sensors."""
    shape = networks[0].shape
    graph = _Graph()
    normal = []
    for name, norm, size in zip(names, norms, shape.inputs, strict=True):
        mean = graph.constant(f"{name}.mean", norm.mean.astype(np.float32))
        scale = graph.constant(f"{name}.scale", (1.0 / norm.deviation).astype(np.float32))
        centred = graph.node("Sub", [f"{name}", mean])
        normal.append((graph.node("Mul", [centred, scale]), size))
    outputs = [_one(graph, network, number, normal) for number, network in enumerate(networks)]
    graph.node("Concat", outputs, "commands", axis=0)
    data = bytes(graph.nodes) + _field(2, "txt1") + bytes(graph.constants)
    for name, size in zip(names, shape.inputs, strict=True):
        data += _value(11, name, (1, *size))
    data += _value(12, "commands", (len(networks), shape.outputs))
    opset = _field(1, "") + _field(2, OPSET)
    metadata = _field(1, "card") + _field(2, card)
    head = _field(1, IR_VERSION) + _field(2, "txt1")
    return head + _field(7, data) + _field(8, opset) + _field(14, metadata)


def _one(graph: _Graph, network: PolicyNetwork, number: int, normal: Sequence[tuple[str, tuple[int, int, int]]]) -> str:
    """Add a network to the graph; return the name of its outputs."""
    layer, features = 0, []

    def constants(weights: NDArray[Any]) -> list[str]:
        return [
            graph.constant(f"{number}.{layer}.weights", np.ascontiguousarray(weights)),
            graph.constant(f"{number}.{layer}.biases", network.biases[layer]),
        ]

    for (name, (height, width, channels)), trunk in zip(normal, network.shape.trunks, strict=True):
        x = name
        if trunk:
            x = graph.node("Transpose", [x], perm=(0, 3, 1, 2))
        for each in trunk:
            weights = network.weights[layer].reshape(*each.window, channels, each.filters).transpose(3, 2, 0, 1)
            x = graph.node("Conv", [x, *constants(weights)], kernel_shape=each.window, strides=each.stride)
            x = graph.node("Relu", [x])
            height, width = each.size(height, width)
            channels, layer = each.filters, layer + 1
        if trunk:
            x = graph.node("Transpose", [x], perm=(0, 2, 3, 1))
        features.append(graph.node("Flatten", [x], axis=1))
    x = graph.node("Concat", features, axis=1)
    for units in range(len(network.shape.dense) + 1):
        x = graph.node("Gemm", [x, *constants(network.weights[layer])])
        if units < len(network.shape.dense):
            x = graph.node("Relu", [x])
        layer += 1
    return x


# -- reading -----------------------------------------------------------------------------------------------------


def card_of(data: bytes) -> str:
    """Return the card's text; raises PolicyError: there is none."""
    for number, value in _fields(memoryview(data)):
        if number == 14 and not isinstance(value, int):
            found = dict(_fields(value))
            if found.get(1) == b"card" and not isinstance(found.get(2, 0), int):
                try:
                    return bytes(found[2]).decode()
                except UnicodeDecodeError:
                    break
    raise PolicyError("it has no card, so 'txt1 teach' has not written it; tell one from elsewhere by --card CARD.yaml")


def read(
    data: bytes, shape: Shape, members: int, norms: Sequence[Norm], names: Sequence[str], card: str
) -> list[PolicyNetwork]:
    """Return the networks of a file; raises PolicyError unless `written` makes the same bytes from them."""
    constants: dict[str, Array] = {}
    for number, value in _fields(memoryview(data)):
        if number == 7 and not isinstance(value, int):
            for inner, part in _fields(value):
                if inner == 5 and not isinstance(part, int):
                    name, values = _constant(part)
                    constants[name] = values
    networks = []
    for number in range(members):
        network = PolicyNetwork.__new__(PolicyNetwork)
        network.shape, network.weights, network.biases = shape, [], []
        convolutions = [each for trunk in shape.trunks for each in trunk]
        for layer, (rows, columns) in enumerate(shape.layers()):
            weights = constants.get(f"{number}.{layer}.weights", np.zeros(0, np.float32))
            biases = constants.get(f"{number}.{layer}.biases", np.zeros(0, np.float32))
            if weights.size != rows * columns or biases.size != columns:
                raise PolicyError("its weights differ from its card, so it is damaged")
            if layer < len(convolutions):
                high, wide = convolutions[layer].window
                weights = weights.reshape(columns, -1, high, wide).transpose(2, 3, 1, 0)
            network.weights.append(np.ascontiguousarray(weights.reshape(rows, columns)))
            network.biases.append(biases.copy())
        networks.append(network)
    if written(networks, norms, names, card) != data:
        raise PolicyError("it is not as 'txt1 teach' writes it, so it is damaged or from another program")
    if not all(np.isfinite(each).all() for network in networks for each in (*network.weights, *network.biases)):
        raise PolicyError("its weights are not finite numbers")
    return networks


def _constant(data: memoryview) -> tuple[str, Array]:
    """Return a constant's name and its numbers, flat."""
    name, values = "", np.zeros(0, np.float32)
    for number, value in _fields(data):
        if number == 8 and not isinstance(value, int):
            name = bytes(value).decode(errors="replace")
        elif number == 9 and not isinstance(value, int) and len(value) % 4 == 0:
            values = np.frombuffer(value, "<f4").astype(np.float32)
    return name, values
