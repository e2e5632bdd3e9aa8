"""R/C cars on a Raspberry Pi as an addition: the HAL, a virtual bus, and the doctor's checks."""

from txt1.additions import Addition

ADDITION = Addition(
    name="pi",
    parts={
        "txt1.hal": {"pi": "txt1.cars.pi.driver:create"},
        "txt1.buses": {"pi": "txt1.cars.pi.virtual_pi:virtual_bus"},
        "txt1.doctors": {"pi": "txt1.cars.pi.command:findings"},
    },
)
