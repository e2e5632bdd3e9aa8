"""Keys that drive a robot of txt1 under LeRobot; importing it registers the type ``txt1_keys``."""

from lerobot_teleoperator_txt1.keys import Txt1Keys, Txt1KeysConfig

__all__ = ["Txt1Keys", "Txt1KeysConfig"]
