"""Steps that find the model of the vehicle's motion: the speeds for motor counts, and the loops' gains."""

import asyncio
from itertools import pairwise
from typing import Final

import numpy as np

from txt1.control.open_loop import counts_for
from txt1.experiments.calibration.bench import STEERING_TIME, Bench
from txt1.experiments.identify import identify, try_out
from txt1.experiments.tune import angular_gains, linear_gains

# shares of the largest speed for the speed map, in this order
LEVELS: Final = (1.0, 0.3, 0.6, -0.3, -0.8)
# smallest difference of two of them, as a share of the largest speed
TOO_NEAR: Final = 0.15
# s after which a vehicle is nearly at its speed
ACCELERATED: Final = 1.3


async def speeds(bench: Bench) -> None:
    """Find the speeds for motor counts, each from the distance of some additional seconds."""
    v_max = bench.config.safety.v_max
    measured: list[tuple[float, float]] = []
    for share in (None, *LEVELS):
        wanted = 0.5 * v_max if share is None else share * v_max
        near = min((abs(wanted - v) for _, v in measured), default=v_max)
        if near < TOO_NEAR * v_max:
            continue
        counts = bench.cruise
        if len(measured) == 1:
            counts = bench.config.car.dead_band + wanted * (counts - bench.config.car.dead_band) / measured[0][1]
        elif measured:
            counts = counts_for(wanted, tuple(measured))
        counts = float(round(min(max(counts, -bench.config.safety.motor_max), bench.config.safety.motor_max)))
        speed = await _speed_at(bench, counts, wanted)
        if speed * wanted <= 0.0:
            bench.operator.tell("It went no further in the longer time: that speed is left out.")
            continue
        entries = sorted([*measured, (counts, round(speed, 4))])
        if any(v1 <= v0 for (_, v0), (_, v1) in pairwise(entries)):
            bench.operator.tell("That speed does not fit the other speeds, and is left out.")
            continue
        measured = entries
        bench.found({"control.speed_map": [list(each) for each in measured]})
    forward = [(u, v) for u, v in measured if u > 0.0]
    if len(forward) > 1:
        gain, offset = np.polyfit([u for u, _ in forward], [v for _, v in forward], 1)
        band = max(0.0, round(float(-offset / gain), 1))
        bench.found(
            {
                "car.dead_band": band,
                "sim.vehicle.dead_band": band,
                "sim.vehicle.speed_gain": round(float(gain), 8),
            }
        )


async def _speed_at(bench: Bench, counts: float, wanted: float) -> float:
    """Return the speed for motor counts, m/s.

    It is driven twice from rest, so that starting and stopping cancel out.
    """
    ask, longer = bench.operator, min(max(1.5, 1.5 / abs(wanted)), 5.0)
    way = "forward" if counts > 0.0 else "backward"
    gone = []
    for seconds in (ACCELERATED, ACCELERATED + longer):
        await ask.ready(
            "line", f"Put the vehicle on a mark: it drives {seconds:.1f} s {way}, at some {abs(wanted):.1f} m/s."
        )
        async with bench.by_hand() as hands:
            await hands.wait(STEERING_TIME)
            hands.steer(counts)
            await hands.wait(seconds)
        gone.append(await ask.number("gone", "How far did it come from the mark?", "m"))
    return (gone[1] - gone[0]) / longer * (1.0 if counts > 0.0 else -1.0)


async def tune(bench: Bench) -> None:
    """Find gains of the velocity loops on a model of the vehicle, which a drive of a minute gives."""
    await bench.operator.ready(
        "line", "Put the vehicle on a dozen metres of free floor: it drives to and fro, and turns."
    )
    async with bench.robot() as robot:
        plant = identify(await try_out(robot))
    bench.found(
        {
            "car.speed_gain": round(plant.speed_gain, 8),
            "car.dead_band": round(plant.dead_band, 1),
            "car.time_constant": round(max(plant.time_constant, 0.01), 4),
            "sim.vehicle.speed_gain": round(plant.speed_gain, 8),
            "sim.vehicle.dead_band": round(plant.dead_band, 1),
            "sim.vehicle.speed_time_constant": round(max(plant.time_constant, 0.01), 4),
        }
    )
    bench.operator.tell("Trying gains on its model: that takes some seconds.")
    control, geometry = bench.config.control, bench.config.geometry
    linear = await asyncio.to_thread(
        lambda: linear_gains(plant, geometry, control.linear.gains(), bench.config.safety.motor_max)
    )
    angular = await asyncio.to_thread(lambda: angular_gains(plant, geometry, control.schedule()))
    sets = [{"v_max": each.v_max, **each.gains._asdict()} for each in angular]
    bench.found({"control.linear": linear._asdict(), "control.angular": sets})
