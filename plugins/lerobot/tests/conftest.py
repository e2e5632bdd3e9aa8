"""Without the plug-in its tests are left out; `make test` installs it. Classes of LeRobot stand here for themselves."""

import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import pytest

collect_ignore_glob = [] if find_spec("txt1_lerobot") else ["test_*.py"]


class _Config:
    @classmethod
    def register_subclass(cls, name: str) -> Callable[[type], type]:
        return lambda kind: kind


class _Part:
    def __init__(self, config: object) -> None:
        pass


@pytest.fixture
def lerobot(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """LeRobot's names, as far as the plug-in imports them, without LeRobot."""
    names: dict[str, dict[str, Any]] = {
        "lerobot": {},
        "lerobot.robots": {"Robot": _Part, "RobotConfig": _Config},
        "lerobot.teleoperators": {"Teleoperator": _Part, "TeleoperatorConfig": _Config},
        "lerobot.utils": {},
        "lerobot.utils.errors": {
            name: type(name, (Exception,), {}) for name in ("DeviceAlreadyConnectedError", "DeviceNotConnectedError")
        },
    }
    for name, inside in names.items():
        module = ModuleType(name)
        module.__dict__.update(inside)
        monkeypatch.setitem(sys.modules, name, module)

    def forget() -> None:
        for name in [
            each for each in sys.modules if each.startswith(("lerobot_robot_txt1", "lerobot_teleoperator_txt1"))
        ]:
            del sys.modules[name]

    forget()
    yield
    forget()
