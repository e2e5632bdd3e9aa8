"""Recognises a Waveshare rover's board by its reports, which it sends on request."""

from typing import Final

from txt1.cars.waveshare.driver import FEEDBACK, Lines, line, report_of
from txt1.hal.languages import Language


def _speaks(data: bytes) -> bool:
    return any(report_of(found) is not None for found in Lines().feed(data))


LANGUAGE: Final = Language("a Waveshare rover's board", 115200, b"\n" + line(FEEDBACK, cmd=1), _speaks)
