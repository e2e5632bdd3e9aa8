"""The topics of a recording: names, messages, and the numbers of their channels."""

from __future__ import annotations

from typing import Final, NamedTuple

from txt1.record.definitions import schema_name


class Topic(NamedTuple):
    """One topic: its name, its message as ``package/Name``, and what is in it, for people."""

    name: str
    message: str
    about: str

    @property
    def schema(self) -> str:
        """The name of its message for ROS 2 tools."""
        return schema_name(self.message)


ODOMETRY: Final = "/odom"
SETPOINT: Final = "/setpoint"
PWM: Final = "/pwm"
GAINS: Final = "/gains"
ENCODERS: Final = "/encoders"
TRANSFORM: Final = "/tf"
POSE: Final = "/pose"
COMMAND: Final = "/cmd_vel"
BATTERIES: Final = ("/battery1", "/battery2")
MODE: Final = "/mode"
DIAGNOSTICS: Final = "/diagnostics"
FAULTS: Final = "/faults"
LOG: Final = "/rosout"
LINK: Final = "/link"
INPUT: Final = "/input"
LIGHT: Final = "/light"
LEARNING: Final = "/learning/step"
SNAPSHOT: Final = "/snapshot"
TICKS: Final = "/ticks"

TOPICS: Final = tuple(
    Topic(*row)
    for row in (
        (ODOMETRY, "nav_msgs/Odometry", "the odometry the loops use, odom -> base_footprint; every controller cycle"),
        (SETPOINT, "geometry_msgs/TwistStamped", "the set-point in force behind the safety gate; every cycle"),
        (PWM, "txt1_msgs/Pwm", "the counts on the five channels; every cycle"),
        (GAINS, "txt1_msgs/Gains", "the gains in force; every cycle"),
        (ENCODERS, "txt1_msgs/Encoders", "encoder ticks of the cycle; every cycle, where there are encoders"),
        (TRANSFORM, "tf2_msgs/TFMessage", "the odometry once more, for tools that want transforms; every cycle"),
        (POSE, "geometry_msgs/PoseStamped", "the true pose in the room; every cycle, in simulation"),
        (COMMAND, "geometry_msgs/TwistStamped", "what the host asked for, before the safety gate; as it comes"),
        (BATTERIES[0], "sensor_msgs/BatteryState", "battery 1; once a second"),
        (BATTERIES[1], "sensor_msgs/BatteryState", "battery 2; once a second"),
        (MODE, "txt1_msgs/Mode", "armed, manual, link, power switches; when they change"),
        (DIAGNOSTICS, "diagnostic_msgs/DiagnosticArray", "the tasks' cycles, misses and times"),
        (FAULTS, "diagnostic_msgs/DiagnosticArray", "everything counted as a fault; when it changes"),
        (LOG, "rcl_interfaces/Log", "the event log"),
        (LINK, "txt1_msgs/LinkBytes", "the bytes on the line to the board, with their direction"),
        (INPUT, "txt1_msgs/Input", "everything given to the tasks from outside, exact: what a replay needs"),
        (LIGHT, "txt1_msgs/Light", "the four light sensors"),
        (LEARNING, "txt1_msgs/LearningStep", "each decision of the learner, and the end of each episode: action -1"),
        (SNAPSHOT, "std_msgs/String", "all of the state as one line of JSON, once a second: what the screens show"),
        (
            TICKS,
            "txt1_msgs/Ticks",
            "which of the robot's tasks ran when, exact; in simulation on the real clock, in batches",
        ),
    )
)

CHANNELS: Final = {topic.name: number for number, topic in enumerate(TOPICS, start=1)}
"""The number of each topic's channel in every file."""
