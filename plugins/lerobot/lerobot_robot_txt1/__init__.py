"""A robot of txt1 as a robot of LeRobot; importing it registers the type ``txt1``, and its teleoperator."""

import lerobot_teleoperator_txt1 as _teleoperator
from lerobot_robot_txt1.config_txt1 import Txt1Config
from lerobot_robot_txt1.txt1 import Txt1

__all__ = ["Txt1", "Txt1Config"]

del _teleoperator
