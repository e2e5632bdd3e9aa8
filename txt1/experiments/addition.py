"""Experiments as an addition: drive tests, tuning, calibration, sweeps."""

from txt1.additions import Addition

ADDITION = Addition(
    name="experiments",
    commands={
        "experiment": (
            "txt1.experiments.command.experiment",
            "drive one of the thesis's tests, or your own, and measure it; or compare runs",
        ),
        "calibrate": (
            "txt1.experiments.command.calibrate",
            "find out in a dialogue how your vehicle is wired and moves, and write its file",
        ),
        "tune": (
            "txt1.experiments.command.tune",
            "identify the vehicle from a short drive, propose gains, and try them on the drive tests",
        ),
    },
)
