"""The TXT-1 of MuJoCo as a picture: docs/mujoco-car.png.

    MUJOCO_GL=egl .venv/bin/python docs/mujoco_picture.py        # or glfw, under a screen

It drives a left turn at full lock for two seconds and is drawn by MuJoCo itself.
"""

from pathlib import Path

import mujoco
from PIL import Image

from txt1.config import load
from txt1_physics.four_wheels import create

OUT = Path(__file__).with_name("mujoco-car.png")


def main() -> None:
    """Draw it."""
    car = create(load(None, ["sim.physics=mujoco"], {}, {}).config)
    motion = (0.0,) * 8
    for _ in range(100):
        motion = car(motion, 3000.0, -18000.0, 18000.0, 0.02, 0.0)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = motion[0], motion[1], 0.1
    camera.distance, camera.azimuth, camera.elevation = 1.15, 205.0, -20.0
    with mujoco.Renderer(car.model, 600, 960) as renderer:
        renderer.update_scene(car.data, camera)
        Image.fromarray(renderer.render()).quantize(128).save(OUT, optimize=True)


if __name__ == "__main__":
    main()
