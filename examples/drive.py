"""The thesis's example client (its appendix B.4): every topic and service of the original driver, in one program.

python examples/drive.py            # in real time
python examples/drive.py max        # as fast as the processor
"""

import asyncio
import sys

import txt1


async def main() -> None:
    async with txt1.Robot.open(hal="sim", seed=1) as robot:
        print("gains accepted:", await robot.load_gains())

        async def watch() -> None:
            count = 0
            async for odometry in robot.odometry_stream():
                count += 1
                if count % 10 == 0:  # twice a second
                    print(f"x={odometry.x:+.3f} m  y={odometry.y:+.3f} m  theta={odometry.theta:+.3f} rad")

        watcher = asyncio.create_task(watch())
        await robot.drive(v=0.5, omega=0.3, duration=2.0)
        watcher.cancel()

        robot.servos(pwm4=12000, pwm5=-24000)
        robot.combined_odometry(*robot.odometry)
        await robot.set_manual(True)
        await robot.hold_pwm(motor=0, front=12000, rear=0, pwm4=-12000, pwm5=-24000, duration=0.5)
        await robot.set_manual(False)

        robot.disarm()
        robot.switch_power(txt1.Switch.ESC, on=False)
        await asyncio.sleep(1.0)
        print(robot.odometry)
        print(robot.battery)


if __name__ == "__main__":
    txt1.run(main(), speed="max" if sys.argv[1:] == ["max"] else None)
