"""The TXT-1 for MuJoCo: a body on four sprung wheels, all of which steer, drawn from the configuration's geometry.

    python -m txt1_physics.mjcf > txt1.xml        # for MuJoCo's own viewer

A wheel has three joints: it slides up and down on its spring, turns about its king pin, and rolls. The linkage turns
both wheels of an axle by the same angle. The wheels' middles are `geometry.track_width` apart. Their radius follows
from `geometry.circumference`. There is no slip angle and no flexible carcass.

A tyre is crowned: an ellipsoid, which touches the floor at a point, with the same dry friction in every direction. A
cylinder would touch the floor only at its two edges. In a curve the edges would roll different distances, so they would
stick and slip against each other. A real tyre's patch lies in between. A wheel that turns about its king pin meets
MuJoCo's torsional
friction (condim 4): 2/3 of the friction times the radius of a round patch with even pressure (V. L. Popov, *Contact
Mechanics and Friction*, 2010). The patch is assumed to be half as wide as the tyre.
"""

from math import pi
from typing import Final

from txt1.model.vehicle import Geometry
from txt1.units import GRAVITY
from txt1_physics.settings import PhysicsSettings

# longest step of the integration, s
STEP: Final = 0.001
WHEELS: Final = ("front_left", "front_right", "rear_left", "rear_right")
# radius of the tyre's patch on the floor, as a share of the tyre's width; assumed
PATCH: Final = 0.25
# travel of a wheel up and down from rest, m
TRAVEL: Final = 0.04
# N m/rad a wheel: stiffness of servo and linkage, which no floor turns back; assumed
LINKAGE: Final = 40.0


def wheel_radius(body: Geometry) -> float:
    """Return the radius of a wheel, m."""
    return body.circumference / (2.0 * pi)


def roll_gradient(body: Geometry, settings: PhysicsSettings) -> float:
    """Return how far the body leans in a curve, rad per m/s^2: the moment m a h against the springs and the
    leaning weight.

    The springs' stiffness in roll is m (2 pi f)^2 (track_width / 2)^2; the weight's is -m g h.
    """
    stiffness = (pi * settings.suspension * body.track_width) ** 2 - GRAVITY * settings.gravity_height
    return settings.gravity_height / stiffness


def mjcf(body: Geometry, settings: PhysicsSettings) -> str:
    """Return the model's XML."""
    radius = wheel_radius(body)
    sprung = settings.mass - 4.0 * settings.wheel_mass
    height = settings.gravity_height
    # the body's frequency on the springs is 2 pi f = sqrt(4 k / m)
    bounce = 2.0 * pi * settings.suspension
    stiffness = 0.25 * sprung * bounce**2
    damping = 0.25 * 2.0 * settings.damping * sprung * bounce
    sag = 0.25 * sprung * GRAVITY / stiffness
    spin = 0.5 * settings.wheel_mass * (radius**2 + (0.6 * radius) ** 2)
    across = settings.wheel_mass * (0.25 * radius**2 + settings.tyre_width**2 / 12.0)
    half = 0.3 * height
    torsion = 2.0 / 3.0 * settings.friction * PATCH * settings.tyre_width
    wheels, actuators = [], []
    for name in WHEELS:
        x = 0.5 * body.wheelbase * (1.0 if name.startswith("front") else -1.0)
        y = 0.5 * body.track_width * (1.0 if name.endswith("left") else -1.0)
        wheels.append(
            f"""
      <body name="{name}" pos="{x:.9g} {y:.9g} {radius - height:.9g}">
        <inertial pos="0 0 0" mass="{settings.wheel_mass:.9g}" diaginertia="{across:.9g} {spin:.9g} {across:.9g}"/>
        <joint name="{name}_spring" type="slide" axis="0 0 1" stiffness="{stiffness:.9g}" damping="{damping:.9g}"
               springref="{-sag:.9g}" limited="true" range="{-TRAVEL:.9g} {TRAVEL:.9g}"/>
        <joint name="{name}_pin" type="hinge" axis="0 0 1"/>
        <joint name="{name}_roll" type="hinge" axis="0 1 0"/>
        <geom name="{name}" type="ellipsoid" size="{radius:.9g} {radius:.9g} {0.5 * settings.tyre_width:.9g}"
              euler="90 0 0" mass="0" condim="4" friction="{settings.friction:.9g} {torsion:.9g} 0"
              rgba="0.15 0.15 0.15 1"/>
        <geom type="cylinder" size="{0.5 * radius:.9g} {0.51 * settings.tyre_width:.9g}" euler="90 0 0" mass="0"
              contype="0" conaffinity="0" rgba="0.8 0.8 0.8 1"/>
      </body>"""
        )
        actuators.append(
            f"""
    <position name="{name}_pin" joint="{name}_pin" kp="{LINKAGE:.9g}" dampratio="1"/>
    <motor name="{name}_roll" joint="{name}_roll"/>"""
        )
    return f"""<mujoco model="txt1">
  <compiler angle="degree"/>
  <option timestep="{STEP:.9g}" gravity="0 0 {-GRAVITY}" cone="elliptic" impratio="10" integrator="implicitfast"/>
  <visual>
    <global offwidth="960" offheight="600"/>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.35 0.35 0.35" specular="0 0 0"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="flat" rgb1="0.9 0.92 0.95" rgb2="0.9 0.92 0.95" width="64" height="64"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1="0.75 0.72 0.66" rgb2="0.68 0.65 0.6" width="200"
             height="200"/>
    <material name="tiles" texture="tiles" texrepeat="4 4" texuniform="true"/>
  </asset>
  <worldbody>
    <light directional="true" castshadow="false" pos="0 0 3" dir="-0.4 0.5 -1" diffuse="0.6 0.6 0.6"/>
    <geom name="floor" type="plane" size="0 0 1" friction="{settings.friction:.9g} {torsion:.9g} 0"
          material="tiles"/>
    <body name="body" pos="0 0 {height:.9g}">
      <freejoint name="body"/>
      <inertial pos="0 0 0" mass="{sprung:.9g}" diaginertia="{sprung * (body.width**2 + (2.0 * half) ** 2) / 12.0:.9g}
                {sprung * (body.length**2 + (2.0 * half) ** 2) / 12.0:.9g}
                {sprung * (body.length**2 + body.width**2) / 12.0:.9g}"/>
      <geom name="plate" type="box" size="{0.45 * body.length:.9g} {0.28 * body.width:.9g} 0.01" mass="0"
            friction="0.4 0 0" rgba="0.7 0.72 0.75 1"/>
      <geom name="top" type="box" size="{0.3 * body.length:.9g} {0.22 * body.width:.9g} {half:.9g}"
            pos="0 0 {0.01 + half:.9g}" mass="0" friction="0.4 0 0" rgba="0.75 0.25 0.2 1"/>
      <geom name="mast" type="cylinder" size="0.015 0.04" mass="0"
            pos="{0.2 * body.length:.9g} 0 {2.0 * half + 0.05:.9g}" friction="0.4 0 0"
            rgba="0.2 0.3 0.6 1"/>{"".join(wheels)}
    </body>
  </worldbody>
  <contact>{"".join(f'<exclude body1="body" body2="{name}"/>' for name in WHEELS)}</contact>
  <actuator>{"".join(actuators)}
  </actuator>
</mujoco>
"""


if __name__ == "__main__":
    print(mjcf(Geometry(), PhysicsSettings()), end="")
