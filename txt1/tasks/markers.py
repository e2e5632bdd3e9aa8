"""The topic ``/markers``: the robot's body, the room, the light and obstacles for views in three dimensions."""

from collections.abc import Iterable
from typing import Any, Final

from txt1.tasks.fields import Surroundings
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

# kinds of visualization_msgs/Marker
CUBE, SPHERE, LINES = 1, 2, 4
# m, of the body
HEIGHT: Final = 0.3
# m, of the light's marker above the floor: higher than the body, which drives below it
LAMP: Final = 0.5
# m, its diameter
LAMP_SIZE: Final = 0.15
# m, width of the lines that are walls and obstacles
EDGE: Final = 0.03
# the first two of Okabe and Ito
BLUE, YELLOW, GREY = (0.0, 0.447, 0.698), (0.941, 0.894, 0.259), (0.5, 0.5, 0.5)

define("std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a")
define("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec")
define("sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data")
define("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v")
define("visualization_msgs/MeshFile", "string filename\nuint8[] data")
define(
    "visualization_msgs/Marker",
    "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\n"
    "geometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\nbool frame_locked\n"
    "geometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring texture_resource\n"
    "sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\nstring text\n"
    "string mesh_resource\nvisualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials",
)


def marker(
    kind: int,
    frame: str,
    place: tuple[float, float, float],
    size: tuple[float, float, float],
    colour: tuple[float, float, float],
    points: Iterable[tuple[float, float]] = (),
) -> dict[str, Any]:
    """Return a marker that stays where its frame is: its centre and its size in m, and the points of lines."""
    return {
        "header": {"frame_id": frame},
        "ns": "txt1",
        "type": kind,
        "frame_locked": True,
        "pose": {"position": dict(zip("xyz", place, strict=True)), "orientation": {"w": 1.0}},
        "scale": dict(zip("xyz", size, strict=True)),
        "color": {**dict(zip("rgb", colour, strict=True)), "a": 1.0},
        "points": [{"x": x, "y": y} for x, y in points],
    }


def markers(about: Surroundings) -> dict[str, Any]:
    """Return the fields of visualization_msgs/MarkerArray."""
    length, width, ahead = about.body
    shapes = [marker(CUBE, "base_footprint", (ahead, 0.0, 0.5 * HEIGHT), (length, width, HEIGHT), BLUE)]
    if about.light is not None:
        shapes.append(marker(SPHERE, "room", (*about.light, LAMP), (LAMP_SIZE, LAMP_SIZE, LAMP_SIZE), YELLOW))
    outlines = list(about.obstacles)
    if about.room is not None:
        x, y = 0.5 * about.room[0], 0.5 * about.room[1]
        outlines.append(((x, y), (-x, y), (-x, -y), (x, -y)))
    shapes += [marker(LINES, "room", (0.0, 0.0, 0.0), (EDGE, 0.0, 0.0), GREY, (*each, each[0])) for each in outlines]
    return {"markers": [shape | {"id": number} for number, shape in enumerate(shapes)]}


MARKERS: Final = declare(
    Topic(
        "/markers",
        Surroundings,
        "m",
        define("visualization_msgs/MarkerArray", "visualization_msgs/Marker[] markers"),
        Rule.SECOND,
        "body, room, light and obstacles, for views in three dimensions",
        make=markers,
        in_snapshots=False,
    )
)
