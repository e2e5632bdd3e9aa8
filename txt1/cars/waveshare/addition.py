"""Waveshare's rover boards as an addition: the HAL, and a virtual device as a port and as a device."""

from txt1.additions import Addition

ADDITION = Addition(
    name="waveshare",
    parts={
        "txt1.hal": {"waveshare": "txt1.cars.waveshare.driver:create"},
        "txt1.languages": {"waveshare": "txt1.cars.waveshare.language:LANGUAGE"},
        "txt1.ports": {"waveshare": "txt1.cars.waveshare.virtual_rover:port"},
        "txt1.devices": {"waveshare": "txt1.cars.waveshare.virtual_rover:Waveshare"},
    },
)
