"""Gamepads as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="gamepad",
    order=110,
    settings="txt1.gamepad.pad:PadParameters",
    on_request=True,
    beside="txt1.gamepad.robot_end:beside",
    options="txt1.gamepad.options:OPTIONS",
    sources={"gamepad": 40},
    commands={
        "gamepad": (
            "txt1.gamepad.command",
            "show the gamepads that are plugged in, live, or teach SDL an unknown gamepad",
        )
    },
    parts={"txt1.bridges": {"gamepad": "txt1.gamepad.bridge:main"}},
)
