"""The sight of a policy: the numbers computed from a sensor's reading, the same for teaching and driving.

| kind | of the reading | numbers |
|---|---|---|
| laser | the nearest range of each of some rays, r | r / (r + 1 m), 1 where nothing is in range |
| camera | the picture below the horizon, in few pixels | 0 to 1, red, green, blue |
| light | the four readings I, FL FR RL RR | I / sum(I), and log10(sum(I)) |
| odometry | the velocities | v in m/s, omega in rad/s |

The thesis's outlook (6) asks for networks on raw sensor inputs. These inputs are raw, but scaled: they do not depend on
the laser's range, the lamp's brightness or the picture's size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from math import pi
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Le, MaxLen
from numpy.typing import NDArray

from txt1.errors import MissingExtra, Txt1Error
from txt1.sensors.readings import Image, Scan
from txt1.teaching.network import Convolution, Shape

Array = NDArray[np.float32]
Kind = Literal["laser", "camera", "light", "odometry"]
KINDS: Final[tuple[Kind, ...]] = ("laser", "camera", "light", "odometry")
Count = Annotated[int, Ge(1), Le(4096)]
Window = tuple[Annotated[int, Ge(1), Le(15)], Annotated[int, Ge(1), Le(15)]]

RAYS_MAX: Final = 108
"""Largest number of a laser's rays."""
PICTURE: Final = (30, 40)
"""Rows and columns of a picture."""
HORIZON_SHARE: Final = 0.4
"""Share of a picture's height above the horizon, which is left out."""
PIXELS_MAX: Final = 4096 * 4096
"""A picture larger than this is not unpacked."""


class Unfit(Txt1Error):
    """A reading of another kind than in the lessons; the text gives the difference."""


@dataclass(frozen=True)
class Layer:
    """A convolution, as `Convolution`."""

    filters: Annotated[int, Ge(1), Le(256)]
    window: Window
    stride: Window


@dataclass(frozen=True)
class Sight:
    """How a sensor's readings become a network's input."""

    kind: Kind
    sensor: str
    """The sensor's name in the configuration; empty for odometry."""
    size: tuple[Count, Count, Count]
    """Rows, columns and channels of the network's input."""
    trunk: Annotated[tuple[Layer, ...], MaxLen(8)] = ()
    mean: Annotated[tuple[float, ...], MaxLen(4096)] = ()
    """Mean of each channel in the lessons."""
    deviation: Annotated[tuple[float, ...], MaxLen(4096)] = ()
    """Deviation of each channel in the lessons."""
    device: tuple[float, ...] = ()
    """Required properties of the device: a laser's beams, angle_min and angle_step (rad); a camera's columns
    and rows.
    """
    mount: tuple[float, ...] = ()
    """Place of the device: x, y, z (m) and yaw (rad)."""
    top: Annotated[float, Ge(0.0), Le(0.9)] = HORIZON_SHARE
    """Share of a camera's picture that is left out above."""

    @property
    def name(self) -> str:
        """Its name in the network and in messages."""
        return self.sensor or self.kind


CAMERA_TRUNK: Final = (Layer(12, (5, 5), (2, 2)), Layer(16, (3, 3), (2, 2)), Layer(24, (3, 3), (2, 2)))
LASER_TRUNK: Final = (Layer(16, (1, 7), (1, 3)), Layer(24, (1, 5), (1, 2)), Layer(24, (1, 3), (1, 2)))


def sight_of(kind: Kind, sensor: str, value: Any) -> Sight:
    """Return the sight for readings like this one, before the lessons are known; raises Unfit: it is of another
    kind.
    """
    match kind, value:
        case "laser", Scan():
            beams = len(value.ranges)
            device = float(beams), value.angle_min, value.angle_step
            rays = min(RAYS_MAX, beams)
            if rays < 40:
                raise Unfit(f"'{sensor}' has {beams} beams; a laser needs at least 40 to be learned from")
            return Sight("laser", sensor, (1, rays, 1), LASER_TRUNK, device=device, mount=tuple(value.mount))
        case "camera", Image():
            pixels = float(value.width), float(value.height)
            return Sight("camera", sensor, (*PICTURE, 3), CAMERA_TRUNK, device=pixels, mount=tuple(value.mount))
        case "light", tuple() if len(value) == 4:
            return Sight("light", sensor, (1, 1, 5))
        case "odometry", _:
            return Sight("odometry", sensor, (1, 1, 2))
    raise Unfit(f"'{sensor}' tells no {kind}'s readings, but {type(value).__name__}")


def check(sight: Sight, value: Any) -> None:
    """Raise Unfit unless a reading comes from a device as in the lessons, at the same place on the vehicle."""
    same = sight_of(sight.kind, sight.sensor, value)
    if not _near(same.device, sight.device):
        there, taught = _device(same), _device(sight)
        raise Unfit(f"'{sight.name}' has {there}, and the policy was taught with {taught}")
    if not _near(same.mount, sight.mount):
        raise Unfit(
            f"'{sight.name}' sits at {_place(same.mount)} on the car, and in the lessons at {_place(sight.mount)}"
        )


def _near(one: Sequence[float], other: Sequence[float]) -> bool:
    return len(one) == len(other) and all(abs(a - b) <= 1e-4 for a, b in zip(one, other, strict=True))


def _device(sight: Sight) -> str:
    if sight.kind == "camera":
        return "pictures of {:.0f}x{:.0f} pixels".format(*sight.device)
    beams, first, step = sight.device
    return f"{beams:.0f} beams from {first * 180 / pi:.1f} degrees on, {step * 180 / pi:.4f} degrees apart"


def _place(mount: Sequence[float]) -> str:
    return "x={:g} y={:g} z={:g} m, yaw={:g} rad".format(*mount)


def seen(sight: Sight, value: Any) -> Array:
    """Return the network's input for a suitable reading, (rows, columns, channels)."""
    return _SEEN[sight.kind](sight, value)


def _laser(sight: Sight, scan: Scan) -> Array:
    ranges = np.asarray(scan.ranges, np.float32)
    # a failed ray says as little as one with nothing in range
    ranges = np.where(ranges >= 0.0, ranges, np.float32(np.inf))
    rays = sight.size[1]
    edges = np.arange(rays) * len(ranges) // rays
    near = np.minimum.reduceat(ranges, edges)
    with np.errstate(invalid="ignore"):
        found = near / (near + 1.0)
    found[np.isinf(near)] = 1.0
    return found.astype(np.float32)[None, :, None]


def _camera(sight: Sight, image: Image) -> Array:
    return picture(image.data, sight.size[0], sight.size[1], sight.top)


def picture(data: bytes, rows: int, columns: int, top: float) -> Array:
    """Return a JPEG's part below the horizon in `rows` x `columns` pixels, 0 to 1.

    Raises Unfit: it is damaged; MissingExtra.
    """
    try:
        from PIL import Image as Pillow
    except ImportError:
        raise MissingExtra("pictures as JPEG", "camera") from None
    try:
        with Pillow.open(BytesIO(data), formats=("JPEG", "PNG")) as whole:
            width, height = whole.size
            if width * height > PIXELS_MAX:
                raise Unfit(f"a picture of {width}x{height} pixels is too large to be unpacked")
            box = (0.0, top * height, float(width), float(height))
            small = whole.convert("RGB").resize((columns, rows), Pillow.Resampling.BOX, box=box)
    except (OSError, ValueError, SyntaxError) as error:
        raise Unfit(f"a picture cannot be unpacked: {error}") from None
    return np.asarray(small, np.float32) / np.float32(255.0)


def _light(sight: Sight, readings: Sequence[float]) -> Array:
    lux = np.maximum(np.asarray(readings, np.float32), 0.0)
    total = float(lux.sum()) + 1e-6
    return np.array([*(lux / total), np.log10(total)], np.float32)[None, None, :]


def _odometry(sight: Sight, velocities: Sequence[float]) -> Array:
    return np.array(velocities, np.float32)[None, None, :]


_SEEN: Final[Mapping[str, Callable[[Sight, Any], Array]]] = {
    "laser": _laser,
    "camera": _camera,
    "light": _light,
    "odometry": _odometry,
}


def mirrored(sight: Sight, found: Array) -> Array:
    """Return the inputs of the mirrored world, for inputs (n, rows, columns, channels)."""
    match sight.kind:
        case "light":
            return found[..., [1, 0, 3, 2, 4]]
        case "odometry":
            return found * np.array([1.0, -1.0], np.float32)
    return found[:, :, ::-1]


class Seen(NamedTuple):
    """Inputs at many times: (n, rows, columns, channels) for each sight."""

    parts: tuple[Array, ...]

    def at(self, index: Any) -> Seen:
        """Return the inputs at an index."""
        return Seen(tuple(each[index] for each in self.parts))

    def __len__(self) -> int:
        return len(self.parts[0])


def shape_of(sights: Sequence[Sight], dense: Sequence[int], outputs: int = 2) -> Shape:
    """Return the shape of the network for these sights."""
    trunks = tuple(tuple(Convolution(*_each(layer)) for layer in sight.trunk) for sight in sights)
    return Shape(tuple(sight.size for sight in sights), trunks, tuple(dense), outputs)


def _each(layer: Layer) -> tuple[int, tuple[int, int], tuple[int, int]]:
    return layer.filters, layer.window, layer.stride
