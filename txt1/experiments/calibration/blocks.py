"""Steps on blocks, with no wheel on the floor: directions of motor, steering and encoders, and their neutrals."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Any, Final

from txt1.errors import HalError
from txt1.experiments.calibration.bench import HAND_PERIOD, STAND, STEERING_TIME, Bench, Hands, Operator
from txt1.model.channels import NEUTRAL_MAX
from txt1.model.vehicle import PWM_MAX, SIDES, STEERING_MAX

# counts a second by which the motor's output rises until encoders count
RAMP: Final = 200.0
# the same, until a person sees something turn
SLOW_RAMP: Final = 100.0
# encoder counts above the noise
TURNED_COUNTS: Final = 4
# counts beyond the start of turning at which the wheels surely turn
BEYOND: Final = 400
# encoder counts of a wheel in the second after that, at least
WELL_TURNED: Final = 20
# counts a second by which the steering is turned to its stop
STEERING_SWEEP: Final = 1500.0
# counts at which it begins
SWEEP_FROM: Final = 3000.0
# s by which an operator is late to report that wheels have stopped turning
REACTION: Final = 0.7
# counts of a jump, which shows whether they had stopped
FURTHER: Final = 2000.0
# scale of a steering that may use the whole range of pulses
WIDEST: Final = PWM_MAX / STEERING_MAX

# counts beyond the start of turning at which an ESC surely brakes, wherever its neutral is, and s of this
BRAKED: Final = 2.0 * NEUTRAL_MAX
CLICK: Final = 0.2
# s of driving, after which the other direction is a brake to an ESC, and s that the other direction may take
FORWARD_TIME: Final = 1.5
BACKWARD_TIME: Final = 3.0
REVERSE: Final = "hal_options.reverse"

MOTORS: Final = ("motor",)
OUTPUTS: Final = ("right", "left")
# settings of a channel that passes counts on unchanged
AS_IT_IS: Final = {"direction": 1, "trim": 0.0, "scale": 1.0}


async def motor(bench: Bench) -> None:
    """Find direction, neutral and dead band of the motor, or of both sides, and the encoders' directions."""
    ask = bench.operator
    await ask.ready("blocks", "Put the vehicle on blocks: no wheel may touch the floor.")
    names = OUTPUTS if bench.skids else MOTORS
    as_they_are: dict[str, Any] = {f"channels.{name}.{key}": each for name in names for key, each in AS_IT_IS.items()}
    encoders = {"right_encoder": 1, "left_encoder": 1, "encoders_swapped": False}
    as_they_are |= {f"channels.{key}": value for key, value in encoders.items()}
    if bench.esc:
        # the ESC gets the pulses as they are, and its brake from here
        as_they_are |= {REVERSE: "direct"}
    bands, turned = [], []
    for name in names:
        side = "wheels" if name == "motor" else f"{name} wheels"
        await ask.ready("watch", f"Watch the {side}: they are about to turn slowly, one way and then the other.")
        async with bench.by_hand(as_they_are, unseen=True) as hands:
            begins = await _until_it_turns(hands, ask, name, 1, side)
            before = hands.counts
            _give(hands, name, begins + BEYOND)
            await hands.wait(1.0)
            after = hands.counts
            hands.steer(0.0)
            await hands.wait(STAND)
            way = await ask.choose("turned", f"Which way did the {side} turn?", ("forward", "backward"))
            if bench.esc:
                _give(hands, name, -begins - BRAKED)
                await hands.wait(CLICK)
                hands.steer(0.0)
                await hands.wait(STAND)
                await ask.ready("watch", f"Watch the {side} again: they turn the other way.")
            ends = await _until_it_turns(hands, ask, name, -1, side)
        direction = 1 if way == "forward" else -1
        bands.append(0.5 * (begins - ends))
        trim = round(0.5 * (begins + ends))
        bench.found({f"channels.{name}.direction": direction, f"channels.{name}.trim": float(trim)})
        if before is not None and after is not None:
            turned.append((direction * (after[0] - before[0]), direction * (after[1] - before[1])))
    band = round(sum(bands) / len(bands))
    bench.found({"car.dead_band": float(band), "sim.vehicle.dead_band": float(band)})
    if turned:
        bench.found(_encoders(turned))


async def reverse(bench: Bench) -> None:
    """Find out whether the ESC brakes before it reverses, which only you can see."""
    ask = bench.operator
    await ask.ready("blocks", "Put the vehicle on blocks: no wheel may touch the floor.")
    await ask.ready(
        "watch", "Watch the wheels: they are told to turn backwards, forward and backwards, without a stop between."
    )
    forward, backwards = await _turn_round(bench, "direct")
    if not forward:
        raise HalError(
            "the wheels do not turn forward after a drive backwards: the ESC has its reverse on the side that drives "
            "forward. Swap two wires of the motor, then do the step 'motor' again"
        )
    if backwards:
        bench.found({REVERSE: "direct"})
        return
    await ask.ready("watch", "It brakes first. Watch once more: now neutral and a second pulse follow.")
    if not (await _turn_round(bench, "brake_first"))[1]:
        raise HalError(
            f"the wheels do not turn backwards: has the ESC a mode with reverse? {REVERSE} stays unset, so the vehicle "
            "drives forward only"
        )
    bench.found({REVERSE: "brake_first"})


async def _turn_round(bench: Bench, mode: str) -> tuple[bool, bool]:
    """Return whether the wheels turn forward after a drive backwards, and then backwards again.

    The ESC is driven as one of this mode, and nothing is between the directions.
    """
    ask = bench.operator
    async with bench.by_hand({REVERSE: mode}, unseen=True) as hands:
        # an ESC that is in reverse already would show nothing
        hands.steer(-bench.cruise)
        await hands.wait(FORWARD_TIME)
        hands.steer(bench.cruise)
        await hands.wait(FORWARD_TIME)
        forward = await ask.choose("forward", "Do the wheels turn forward now?", ("yes", "no"))
        hands.steer(-bench.cruise)
        await hands.wait(BACKWARD_TIME)
        backwards = await ask.choose("backwards", "Do the wheels turn backwards now?", ("yes", "no"))
    return forward == "yes", backwards == "yes"


def _give(hands: Hands, name: str, counts: float) -> None:
    """Put counts on the motor, or on one side only."""
    if name == "motor":
        hands.steer(counts)
    else:
        hands.steer(0.5 * counts, (0.5 if name == "right" else -0.5) * SIDES * counts)


async def _until_it_turns(hands: Hands, ask: Operator, name: str, sign: int, side: str) -> float:
    """Raise the output until a wheel turns; return the counts at which it does."""
    limit, counts = hands.robot.config.safety.motor_max, 0.0
    before = hands.counts
    seeing = None
    if before is None:
        seeing = asyncio.ensure_future(ask.seen("turning", f"Press Enter as soon as the {side} turn."))
    try:
        while counts < limit:
            counts += HAND_PERIOD * (SLOW_RAMP if before is None else RAMP)
            _give(hands, name, sign * counts)
            await hands.wait(HAND_PERIOD)
            now = hands.counts
            if before is not None and now is not None:
                if max(abs(now[0] - before[0]), abs(now[1] - before[1])) >= TURNED_COUNTS:
                    return sign * counts
            elif seeing is not None and seeing.done():
                seeing.result()
                return sign * counts
    finally:
        if seeing is not None:
            seeing.cancel()
    raise HalError(
        f"the {side} do not turn at {limit} counts, the most that safety.motor_max allows: is the motor's power on? "
        "Does its controller want neutral first? Is it an ESC that takes these pulses for its reverse? Then give "
        "hal_options.motor_range the other sign"
    )


def _encoders(turned: Sequence[tuple[int, int]]) -> dict[str, Any]:
    """Return the encoders' directions, from their counts while wheels turned forward: all wheels, or one side
    at a time.
    """
    right, left = turned[0][0], turned[0][1]
    swapped = False
    # the right side alone, then the left side alone
    if len(turned) == 2:
        swapped = abs(turned[0][1]) > abs(turned[0][0])
        right, left = (turned[0][1], turned[1][0]) if swapped else (turned[0][0], turned[1][1])
    for name, counted in (("right", right), ("left", left)):
        if abs(counted) < WELL_TURNED:
            raise HalError(f"the {name} encoder does not count, though its wheel turns: check its supply and its wires")
    return {
        "channels.right_encoder": 1 if right > 0 else -1,
        "channels.left_encoder": 1 if left > 0 else -1,
        "channels.encoders_swapped": swapped,
    }


async def steering(bench: Bench) -> None:
    """Find direction and range of the steering, and roughly its straight position."""
    ask = bench.operator
    axles = ("front", "rear") if bench.config.geometry.steering == "both" else ("front",)
    await ask.ready("blocks", "Put the vehicle on blocks, or hold it up: its wheels are about to steer.")
    changes = {f"channels.{axle}.{key}": value for axle in axles for key, value in AS_IT_IS.items()}
    changes |= {f"channels.{axle}.scale": WIDEST for axle in axles}
    for axle in axles:

        def turn(hands: Hands, wire: float, place: int = 1 if axle == "front" else 2) -> None:
            outputs = [0.0, 0.0, 0.0]
            outputs[place] = wire / WIDEST
            hands.outputs = (outputs[0], outputs[1], outputs[2])

        await ask.ready("watch", f"Watch the {axle} wheels: they are about to steer.")
        async with bench.by_hand(changes) as hands:
            turn(hands, 2.0 * SWEEP_FROM)
            await hands.wait(STEERING_TIME)
            way = await ask.choose(axle, f"Which way do the {axle} wheels point, seen from above?", ("left", "right"))
            stops = [await _stop(ask, hands, axle, sign, turn) for sign in (1, -1)]
        bench.found(
            {
                f"channels.{axle}.direction": 1
                if way == "right"
                # positive counts point either axle to the right
                else -1,
                f"channels.{axle}.trim": float(round(0.5 * (stops[0] + stops[1]))),
                f"channels.{axle}.scale": round(0.5 * (stops[0] - stops[1]) / STEERING_MAX, 4),
            }
        )


async def _stop(ask: Operator, hands: Hands, axle: str, sign: int, turn: Callable[[Hands, float], None]) -> float:
    """Turn an axle until it turns no further; return the counts on the wire at its stop.

    Wheels that steer by a few degrees turn so slowly that they seem to stand. So each answer is checked by a jump,
    which is easy to see. If the jump turns the wheels, the turning goes on from there.
    """
    wire = SWEEP_FROM
    while True:
        turn(hands, sign * wire)
        await hands.wait(STEERING_TIME)
        text = f"Press Enter as soon as the {axle} wheels turn no further."
        seeing = asyncio.ensure_future(ask.seen(f"{axle}_stop", text))
        while wire < PWM_MAX and not seeing.done():
            wire += STEERING_SWEEP * HAND_PERIOD
            turn(hands, sign * wire)
            await hands.wait(HAND_PERIOD)
        if not seeing.done():
            seeing.cancel()
            return sign * float(PWM_MAX)
        seeing.result()
        turn(hands, sign * min(wire + FURTHER, PWM_MAX))
        await hands.wait(STEERING_TIME)
        further = await ask.choose(f"{axle}_further", f"Did the {axle} wheels jump further just now?", ("yes", "no"))
        if further == "no":
            return sign * (wire - STEERING_SWEEP * REACTION)


async def servo(bench: Bench) -> None:
    """Find the directions of motor and steering, for hardware that closes the loops and has its own settings
    for them.
    """
    ask, v = bench.operator, bench.speed
    await ask.ready("blocks", "Put the vehicle on blocks: no wheel may touch the floor.")
    await ask.ready("watch", f"Watch the wheels: they are about to steer, and to turn at {v:g} m/s for six seconds.")
    async with bench.robot() as robot:
        options = robot.hal.own_channels
        driving = asyncio.ensure_future(robot.drive(v, v / bench.config.geometry.radius_min, 6.0))
        await asyncio.sleep(1.5)
        steered = await ask.choose("front", "Which way do the front wheels point, seen from above?", ("left", "right"))
        turned = await ask.choose("turned", "Which way do the wheels turn?", ("forward", "backward"))
        await driving
    bench.found(
        {
            "hal_options.backwards": options.backwards is not (turned == "backward"),
            "hal_options.servo_range": options.servo_range * (1.0 if steered == "left" else -1.0),
        }
    )
