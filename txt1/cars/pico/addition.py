"""A Raspberry Pi Pico as the board, as an addition: a virtual device as a port and as a device; `txt1 firmware`."""

from txt1.additions import Addition

ADDITION = Addition(
    name="pico",
    parts={
        "txt1.ports": {"pico": "txt1.cars.pico.virtual_pico:port"},
        "txt1.devices": {"pico": "txt1.cars.pico.virtual_pico:Pico"},
    },
    commands={
        "firmware": (
            "txt1.cars.pico.command",
            "put the board's firmware on a Raspberry Pi Pico, and ask for its health",
        )
    },
)
