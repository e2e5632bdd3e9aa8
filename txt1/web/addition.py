"""The web page as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="web",
    order=100,
    beside="txt1.web.robot_end:beside",
    options="txt1.web.options:OPTIONS",
    sources={"web": 30},
    parts={"txt1.bridges": {"web": "txt1.web.server:main", "web_camera": "txt1.web.camera_server:main"}},
)
