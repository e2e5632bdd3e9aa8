"""The settings of a robot of txt1 under LeRobot."""

from dataclasses import dataclass, field

from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("txt1")
@dataclass(kw_only=True)
class Txt1Config(RobotConfig):
    """``--robot.type=txt1``: a simulated TXT-1, or a car on the hardware layer `hal`."""

    hal: str = "sim"
    settings: list[str] = field(default_factory=list)
    """Settings of txt1, each as after ``--set``: ``serial.port=/dev/ttyUSB0``."""
    camera: str = ""
    """The camera's name among txt1's sensors; "": none."""
    width: int = 160
    """Of its pictures, pixels."""
    height: int = 120
    """Of its pictures, pixels."""
    arm: bool = False
    """Whether to arm it on connecting; a simulated robot arms by itself."""
    seed: int | None = None
    """Repeats the random values of a simulation."""
