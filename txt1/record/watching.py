"""A recorder that watches a robot from before its first tick until after its stop."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from txt1.commands import say
from txt1.record.options import RecordingAsked
from txt1.record.session import recording
from txt1.robot import Robot
from txt1.runtime import Runtime


@asynccontextmanager
async def watch(runtime: Runtime, asked: RecordingAsked) -> AsyncIterator[None]:
    """Record, and show live, as long as the block is at work; raises as `txt1.record.session.recording`."""
    async with recording(asked.file, runtime.config, asked.speed, asked.about, say, asked.view) as attach:
        attach(runtime)
        yield


@asynccontextmanager
async def beside(robot: Robot, asked: RecordingAsked) -> AsyncIterator[None]:
    """Let the live view drive, if it may."""
    if asked.view is not None:
        hand = robot.source("view")
        asked.view.drive(lambda v, omega, age: hand.command(v, omega, max(0.0, robot.now - age)), robot.config.hand())
    yield
