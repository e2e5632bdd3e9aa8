"""The guard of a map's keep-out areas as an addition; it takes part when the robot drives in a map."""

from txt1.additions import Addition

ADDITION = Addition(
    name="keep_out",
    order=25,
    wanted=lambda config: "mapping" in config.given,
    prepare="txt1.guards.keep_out.guard:prepare",
)
