"""The pictures of a report: walls and light, legends for all colours, no text that is cut, and one that moves."""

import re
from math import pi
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from rigs.figure_texts import faults
from txt1.cli import execute
from txt1.record.moving_drawing import POSES, DrawnRoom, moving_drawing

BODY = (0.51, 0.385, 0.0)
WALLS = DrawnRoom((((2.0, 2.0), (-2.0, 2.0), (-2.0, -2.0), (2.0, -2.0)),), (1.0, 1.0))
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A drive into a wall."""
    from txt1.record.report import Content

    log = tmp_path_factory.mktemp("report") / "wall.mcap"
    words = ["--headless", "--speed", "max", "--seed", "1", "--duration", "9", "--drive", "0.5,0", "--log", str(log)]
    box = "sim.obstacles=[{kind: box, x: 1.5, y: 1.5, length: 0.4, width: 0.4}]"
    assert execute(["run", "--set", box, *words]) == 3
    return Content(log)


def test_no_text_of_a_report_is_cut_or_stands_over_another(content: Any) -> None:
    from matplotlib.text import Text

    from txt1.record.report import figure_of

    figure = figure_of(content)
    assert faults(figure) == []
    assert len([each for each in figure.findobj(Text) if re.search("[A-Za-z]{2}", each.get_text())]) > 25


def test_walls_obstacles_and_light_are_drawn_and_every_colour_has_a_legend(content: Any) -> None:
    from txt1.record.report import figure_of

    path = next(axes for axes in figure_of(content).axes if axes.get_title("left") == "Path")
    assert {text.get_text() for text in path.get_legend().get_texts()} >= {"walls", "light", "true pose in the room"}
    assert len([line for line in path.lines if len(line.get_xdata()) == 5]) == 2, "the room, and the box"


def test_the_page_has_the_drive_as_a_moving_picture(content: Any, tmp_path: Path) -> None:
    from txt1.record.report import draw, page

    text = page("wall.mcap", content, draw(content))
    drawing = re.search(r"<svg.*?</svg>", text, re.DOTALL)
    assert drawing is not None
    moving = ElementTree.fromstring(drawing[0])
    (places, turns) = (each.get("values", "").split(";") for each in moving.iter(f"{SVG}animateTransform"))
    assert len(places) == len(turns) == POSES
    first, last = (tuple(map(float, place.split())) for place in (places[0], places[-1]))
    assert last[0] > first[0] + 100.0 and last[1] == pytest.approx(first[1], abs=2.0), "it drives to the right"
    assert {each.text for each in moving.iter(f"{SVG}text")} >= {"walls", "path", "car", "light"}


def test_a_car_that_is_put_down_elsewhere_leaves_no_path_between() -> None:
    time = np.linspace(0.0, 10.0, 500)
    x = np.where(time < 5.0, 0.1 * time, -1.0 + 0.1 * time)
    poses = np.array((time, x, np.where(time < 5.0, -1.0, 1.0), np.zeros(500)))
    drawn = ElementTree.fromstring(moving_drawing(poses, WALLS, BODY))
    assert len(list(drawn.iter(f"{SVG}polyline"))) == 2


def test_a_turn_beyond_half_a_circle_goes_on_the_same_way() -> None:
    time = np.linspace(0.0, 10.0, 500)
    theta = (time * 0.8 + pi) % (2.0 * pi) - pi
    drawn = ElementTree.fromstring(moving_drawing(np.array((time, time, time, theta)), DrawnRoom(), BODY))
    turns = [float(each) for each in list(drawn.iter(f"{SVG}animateTransform"))[1].get("values", "").split(";")]
    assert np.all(np.diff(turns) < 0.0), "to the left, anticlockwise, which is negative on a screen"


def test_a_drive_of_a_single_pose_has_no_picture() -> None:
    assert moving_drawing(np.empty((4, 1)), DrawnRoom(), BODY) == ""
