"""Robots struck by faults: a slice of the campaigns, and the eyes that would see something break."""

from math import inf

import pytest

from torture.campaign import once, plan, shortest
from torture.strikes import KINDS, STRIKES, Strike, names
from txt1.cars.pi.virtual_pi import Monostable
from txt1.cars.pico.virtual_pico import interpreter
from txt1.cars.vesc.driver import VescHal
from txt1.cars.waveshare.driver import WaveshareHal
from txt1.control.limits import Gate
from txt1.errors import MissingExtra
from txt1.hal.base import Outputs
from txt1.robot import Robot


def firmware_is_here() -> bool:
    try:
        interpreter()
    except MissingExtra:
        return False
    return True


FIRMWARE = pytest.mark.skipif(not firmware_is_here(), reason="MicroPython is not installed")
MARKED = [pytest.param(kind, marks=[FIRMWARE] if kind == "pico" else []) for kind in KINDS]
# every fault strikes each kind below; in a random order only these, beside the long tests
USUAL = ("ours", "original", "vesc")
RUNS = [
    pytest.param(
        kind,
        1_000_000 + k,
        marks=[*([pytest.mark.long] if k or kind not in USUAL else []), *([FIRMWARE] * (kind == "pico"))],
    )
    for kind in KINDS
    for k in range(12)
]


@pytest.mark.parametrize("kind, seed", RUNS)
def test_struck_by_faults_the_robot_keeps_every_promise_and_drives_on(kind: str, seed: int) -> None:
    result = once(kind, seed, plan(kind, seed, 20.0))
    assert result.broken == ""
    # an original board whose wheels spun has no ESC for some seconds
    assert result.moving > (0.05 if kind == "original" else 0.2) * result.cycles


@pytest.mark.parametrize("kind", MARKED)
def test_every_fault_there_is_strikes_at_once_and_nothing_breaks(kind: str) -> None:
    strikes = [Strike(name, 1.0 + 0.05 * k, (0.37 * k) % 1.0) for k, name in enumerate(names(kind))]
    assert once(kind, 5, strikes, duration=8.0).broken == ""


def test_a_plan_is_the_same_for_the_same_seed_and_every_fault_is_in_some() -> None:
    assert plan("ours", 7, 20.0) == plan("ours", 7, 20.0)
    struck = {each.name for kind in KINDS for seed in range(200) for each in plan(kind, seed, 20.0)}
    assert struck == set(STRIKES)


def test_a_gate_that_lets_stale_commands_through_is_seen_and_its_cause_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = Gate.passes
    monkeypatch.setattr(Gate, "passes", lambda gate, given, epoch, now: right(gate, now if given else None, epoch, now))
    strikes = [Strike("buttons", 1.0, 0.1), Strike("silence", 2.0, 0.9), Strike("servos", 3.0, 0.5)]
    broken = once("sim", 1, strikes, duration=6.0).broken
    assert "the newest command 0.2" in broken
    assert shortest("sim", 1, strikes, duration=6.0) == [1]


def test_a_stop_that_does_nothing_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Robot, "stop", lambda robot: None)
    assert "armed=True" in once("sim", 1, [Strike("emergency stop", 2.0, 0.9)], duration=5.0).broken


def test_a_robot_that_arms_by_itself_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    right = Robot.disarm

    def disarm(robot: Robot, reason: str = "") -> None:
        right(robot, reason)
        robot.runtime.gate.arm(robot.now)

    monkeypatch.setattr(Robot, "disarm", disarm)
    assert "nobody armed it" in once("sim", 1, [Strike("disarm", 2.0, 0.9)], duration=5.0).broken


def test_outputs_beyond_the_limits_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("txt1.control.limits.clip", lambda value, limit: value)
    strikes = [Strike("gains", 2.0, 0.3), Strike("command huge", 2.5, 0.0)]
    assert "outside the limits" in once("sim", 1, strikes, duration=5.0).broken


def test_a_vehicle_that_does_not_come_to_rest_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torture.struck_robot.coasting", lambda v, vehicle: -inf)
    assert "after it was allowed to move last" in once("sim", 1, [Strike("silence", 2.0, 0.9)], duration=5.0).broken


@pytest.mark.parametrize("kind, hal", [("vesc", VescHal), ("waveshare", WaveshareHal)])
def test_a_speed_that_goes_to_a_motor_controller_of_a_disarmed_robot_is_seen(
    kind: str, hal: type[VescHal | WaveshareHal], monkeypatch: pytest.MonkeyPatch
) -> None:
    right = hal.write
    moving = Outputs(v=0.5)
    monkeypatch.setattr(hal, "write", lambda self, outputs, now: right(self, outputs if outputs.v else moving, now))
    assert "goes to the controller, armed=False" in once(kind, 1, [Strike("emergency stop", 2.0, 0.9)], 5.0).broken


def test_a_watchdog_that_does_not_end_the_pulses_of_a_guard_that_hangs_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Monostable, "ends", inf)
    strikes = [Strike("guard hangs", 2.0, 1.0), Strike("emergency stop", 2.1, 0.9)]
    assert "after it was allowed to move last" in once("pi", 1, strikes, 8.0).broken


def test_a_stop_of_a_peer_that_is_not_obeyed_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("txt1.fleet.link.FleetLink._stop", lambda link, who="", stop="": None)
    assert "was not obeyed" in once("sim", 1, [Strike("hostile peers", 2.0, 0.6)], 5.0).broken


def test_combined_odometry_of_a_speed_from_before_the_line_was_lost_moves_nothing() -> None:
    strikes = [Strike("line dead", 3.035, 0.25125959361052397), Strike("combined odometry", 5.759, 0.262473685361712)]
    assert once("ours", 241, strikes, 9.0).broken == ""
