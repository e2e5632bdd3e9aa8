"""Recognises a VESC: it answers a request for its firmware."""

from typing import Final

from txt1.cars.vesc.driver import PacketId, Unpacker, ask
from txt1.hal.languages import Language


def _speaks(data: bytes) -> bool:
    return bool(Unpacker().feed(data))


LANGUAGE: Final = Language("a VESC", 115200, ask(PacketId.FW_VERSION), _speaks)
