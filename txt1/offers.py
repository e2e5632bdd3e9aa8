"""The topics that a robot offers on its bus. Recorder, screens and bridges read them when they want a value."""

from collections.abc import Callable, Mapping
from math import isfinite
from typing import NamedTuple

from txt1.config import Config
from txt1.control.limits import Gate
from txt1.hal.base import Hal
from txt1.model.odometry import Odometry
from txt1.sim.battery import range_left
from txt1.sim.obstacles import outline
from txt1.tasks import battery, controller, encoder, fields, mode, standstill
from txt1.tasks.diagnostics import FAULTS, TASKS, Reports
from txt1.tasks.fields import GainTable
from txt1.tasks.markers import MARKERS
from txt1.tasks.state import State
from txt1.telemetry.bus import Bus
from txt1.telemetry.snapshot import SNAPSHOT, Snapshot


class Offers(NamedTuple):
    """Offers a robot's topics, and reads their values."""

    bus: Bus
    state: State
    gate: Gate
    hal: Hal
    config: Config
    watch: standstill.Watch | None
    tasks: Reports
    now: Callable[[], float]

    def offer(
        self, faults: Callable[[], Mapping[str, int]], runs: Callable[[], bool], snapshot: Callable[[], Snapshot]
    ) -> None:
        """Offer all topics: causes before effects, as a replay names the first difference."""
        self._offer_cycle()
        self._offer_state(faults, runs, snapshot)
        self._offer_to_snapshots()

    def _offer_cycle(self) -> None:
        """Offer the topics that change in every cycle, and the states of the safety gate and the gains."""
        state, gate, bus, can = self.state, self.gate, self.bus, self.hal.capabilities

        def odometry() -> Odometry | None:
            return state.odometry if state.odometry_time or can.ticks else None

        bus.offer(encoder.ODOMETRY, odometry)
        bus.offer(controller.SETPOINT, lambda: state.control)
        if can.pwm:
            bus.offer(controller.PWM, lambda: state.control)
        bus.offer(encoder.TRANSFORM, odometry)
        if can.ticks:
            bus.offer(encoder.ENCODERS, lambda: state.encoders)
        if can.pose:
            bus.offer(encoder.POSE, lambda: state.pose)
        bus.offer(
            mode.MODE,
            lambda: mode.Mode(gate.armed, gate.stopped, gate.told, state.link, state.power, state.panel),
        )
        if can.pwm:
            bus.offer(controller.MEASURED_BY, lambda: state.control.source)
            bus.offer(controller.GAINS, lambda: (state.gains.linear, state.control.gains))

    def _offer_state(
        self, faults: Callable[[], Mapping[str, int]], runs: Callable[[], bool], snapshot: Callable[[], Snapshot]
    ) -> None:
        state, bus, hal, watch = self.state, self.bus, self.hal, self.watch
        if hal.capabilities.pose:
            bus.offer(encoder.ROOM, lambda: None if state.pose is None else encoder.origin(state.pose, state.odometry))
        if watch is not None:
            bus.offer(standstill.STOP, lambda: watch.standstill.stop)
        for topic in battery.BATTERIES:
            bus.offer(topic, lambda: None if state.battery.state is None else state.battery)
        bus.offer(battery.RANGE, self._range_left)
        bus.offer(FAULTS, lambda: {name: count for name, count in faults().items() if count})
        bus.offer(TASKS, lambda: self.tasks.counts(self.now(), runs()))
        bus.offer(SNAPSHOT, snapshot)

    def _range_left(self) -> float | None:
        """Return the distance (m) that the batteries last; None if it is unknown."""
        remaining, config = self.state.battery.remaining, self.config
        return None if remaining is None else round(range_left(config.sim.battery, remaining, config.safety.v_max))

    def _offer_to_snapshots(self) -> None:
        """Offer the other topics of snapshots, and the surroundings for views in three dimensions."""
        state, bus, sim, can = self.state, self.bus, self.config.sim, self.hal.capabilities
        size, shape = (sim.room.length, sim.room.width), self.config.geometry
        body = shape.length, shape.width, shape.centre
        surroundings = fields.Surroundings(body=body)
        if can.simulated:
            room, obstacles = size if all(map(isfinite, size)) else None, tuple(map(outline, sim.obstacles))
            surroundings = fields.Surroundings(room, sim.room.light, body, obstacles)
        walls = sim.room.built().walls if can.simulated else None
        lines = () if walls is None else walls.outlines
        if can.pose:
            bus.offer(fields.VEHICLES, lambda: self.hal.others() or None)
        bus.offer(fields.HAND, self.config.hand)
        bus.offer(fields.CAPABILITIES, lambda: can)
        bus.offer(fields.BOARD, lambda: state.board)
        bus.offer(fields.COMMAND, lambda: state.command)
        bus.offer(fields.GAIN_TABLE, self._gains)
        bus.offer(fields.SERVOS, lambda: state.servos)
        bus.offer(
            fields.TRAFFIC, lambda: fields.Traffic(state.received, state.transmitted, self.now() - state.odometry_time)
        )
        bus.offer(fields.BACKLIGHT, lambda: state.backlight)
        bus.offer(fields.SURROUNDINGS, lambda: surroundings)
        bus.offer(fields.WALLS, lambda: lines or None)
        standing = surroundings._replace(obstacles=(*surroundings.obstacles, *lines))
        movers = self.hal.movers
        bus.offer(fields.MOVERS, lambda: tuple(map(outline, movers())) or None)
        bus.offer(MARKERS, lambda: standing._replace(obstacles=(*standing.obstacles, *map(outline, movers()))))
        bus.offer(fields.TASK_REPORTS, self.tasks.newest)
        bus.offer(fields.EVENTS, lambda: tuple(state.events))
        bus.offer(fields.WARNINGS, lambda: state.warned() or None)

    def _gains(self) -> GainTable:
        """Return the gains, loaded or not: a board that was away has to acknowledge them again."""
        gains, board = self.state.gains, self.state.board
        return gains if board is None or board.gains else gains._replace(loaded=False)
