"""Wheels that spin or lock: the part of `txt1.sim.dynamics` that is needed while the tyres do not hold.

The two speeds, of the car and of its wheels, go on in steps of at most `SLIP_STEP`. A step is implicit in the slip,
because tyres are much stiffer than a step is short. The wheels roll again when the tyres hold the demand, and either
the slip changes its sign, or it is so small that the tyres do not slide.

Plain scalars and tuples only, so that numba can compile it.
"""

from math import sqrt, tanh
from typing import Final

from txt1.units import GRAVITY

# longest step, s
SLIP_STEP: Final = 0.001
# m/s below which slip counts as if the car or its wheels had this speed
SLIP_SPEED_MIN: Final = 0.05


def slide(
    v: float,
    spin: float,
    v_free: float,
    tau: float,
    loss: float,
    bend: float,
    h: float,
    coasting: bool,
    hold: float,
    stiffness: float,
    inertia: float,
    understeer: float,
) -> tuple[float, float, float, float, float]:
    """Return distance, the wheels' path, the speed, the wheels' speed beyond it, and the share of the curvature that is
    left, after h s in which the wheels slip.
    """
    steps = int(h / SLIP_STEP) + 1
    dt = h / steps
    friction = abs(v_free)
    distance = rolled = left = 0.0
    for _ in range(steps):
        wheel = v + spin
        if coasting:
            # dry friction is against the wheels' turning
            v_free = -friction if wheel > 0.0 else friction
        pull = (v_free - loss * wheel) / tau
        across = v * v * bend / (1.0 + understeer * v * v)
        fastest = max(abs(v), abs(wheel), SLIP_SPEED_MIN)
        slope = GRAVITY * stiffness / fastest
        grown = tanh(slope * spin / hold)
        along = hold * grown
        asked = sqrt(along * along + across * across)
        share = hold / asked if asked > hold else 1.0
        rate = slope * (1.0 - grown * grown) * share
        change = dt * (pull - share * along) / (inertia + dt * rate)
        gained = share * dt * along + dt * rate * change
        # no more than the circle leaves beside the force across
        most = dt * sqrt(hold * hold - min(share * abs(across), hold) ** 2)
        gained = min(max(gained, -most), most)
        distance += dt * (v + 0.5 * gained)
        rolled += dt * (wheel + 0.5 * (gained + change))
        left += share / steps
        after = spin + change
        v += gained
        holds = pull * pull + across * across <= hold * hold
        if holds and (after * spin < 0.0 or slope * abs(after) <= hold):
            # they roll again; what they have too much of goes into the car
            v += inertia * after
            after = 0.0
        spin = after
    return distance, rolled, v, spin, left
