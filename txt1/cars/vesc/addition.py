"""The VESC as an addition: the HAL, its IMU, and a virtual device as a port and as a device."""

from txt1.additions import Addition

ADDITION = Addition(
    name="vesc",
    parts={
        "txt1.hal": {"vesc": "txt1.cars.vesc.driver:create"},
        "txt1.sensors": {"imu_vesc": "txt1.cars.vesc.imu:create"},
        "txt1.languages": {"vesc": "txt1.cars.vesc.language:LANGUAGE"},
        "txt1.ports": {"vesc": "txt1.cars.vesc.virtual_vesc:port"},
        "txt1.devices": {"vesc": "txt1.cars.vesc.virtual_vesc:Vesc"},
    },
)
