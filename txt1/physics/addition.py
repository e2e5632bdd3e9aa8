"""Others' physics as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="physics",
    settings="txt1.physics.settings:PhysicsSettings",
    prepare="txt1.physics.settings:prepare",
    parts={
        "txt1.sim.physics": {
            "single-track-drift": "txt1.physics.commonroad:single_track_drift",
            "multi-body": "txt1.physics.commonroad:multi_body",
            "mujoco": "txt1.physics.four_wheels:create",
        }
    },
)
