"""`txt1 replay`: a recording on the screens again, or its inputs through the tasks again."""

import argparse
from typing import Final

from txt1.commands import FAULT, OK, add, busy, flag, number, positive, takes
from txt1.kernel.loop import run
from txt1.plugins import Registry
from txt1.record.options import ONE_ROBOT, RECORDING

PLAYERS: Final = Registry("player", "txt1.players", {})
"""Functions that play a recording to another program, until its end."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the recording and how it is to be shown."""
    add(
        parser,
        RECORDING
        | ONE_ROBOT
        | {
            "--verify": flag("run the recorded inputs through the tasks and compare"),
            "--speed": takes("N", "as a multiple of real time", positive, default=1.0),
            "--from": takes("S", "begin at this time of the run", number, dest="start"),
            "--loop": flag("begin anew at the end"),
            "--ros2": flag("publish it as topics of ROS 2, its time as /clock, instead of showing it on the screens"),
            "--ros2-namespace": takes("NS", "of those topics; none by default"),
        },
    )


def main(arguments: argparse.Namespace) -> int:
    """Show a recording on the screens or to ROS 2, or run it again and say where it first differs."""
    if arguments.ros2:
        options = arguments.speed, arguments.start, arguments.loop
        PLAYERS.make("--ros2", "ros2", arguments.file, arguments.robot, *options, arguments.ros2_namespace or "")
        return OK
    if not arguments.verify:
        from txt1.record.player import play
        from txt1.record.snapshots import Snapshots

        run(play(Snapshots(arguments.file, arguments.robot), arguments.speed, arguments.start, arguments.loop))
        return OK
    from txt1.record.comparison import NUMBERS_CLOSE
    from txt1.record.verification import verify

    with busy(f"running {arguments.file} again"):
        verdict = verify(arguments.file, arguments.robot)
    within = (
        ""
        if verdict.exact
        else f", numbers compared within {NUMBERS_CLOSE:g}: recorded with another processor or library"
    )
    left = sum(verdict.uncompared.values())
    same = f"no difference in {verdict.compared} of {verdict.compared + left} messages"
    print(f"{arguments.file}: {verdict.difference or same}{within}")
    if verdict.difference is None and left:
        print(f"not compared: {', '.join(f'{topic} {count}' for topic, count in verdict.uncompared.items())}")
    if verdict.difference is not None and verdict.former:
        print(f"{arguments.file}: txt1 {verdict.former} recorded it; a simulation of now drives otherwise")
    if verdict.lacks:
        print(f"{arguments.file}: {verdict.lacks}")
    return OK if verdict.difference is None else FAULT
