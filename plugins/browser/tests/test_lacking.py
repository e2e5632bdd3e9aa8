"""What stands in for modules that a browser's Python lacks, and what a robot can do without them."""

import subprocess
import sys

import pytest

from txt1_browser.lacking import AtOnce, absent


def test_names_of_an_absent_module_serve_as_types_and_nothing_is_one_of_them() -> None:
    module = absent("numpy")
    assert not isinstance(1.0, module.ndarray)
    assert module.float64[int] is not None
    assert (module.ndarray | None) is not None


def test_whoever_calls_an_absent_name_is_told_which() -> None:
    with pytest.raises(ImportError, match=r"numpy\.linalg\.norm: it is not to be had in a browser"):
        absent("numpy").linalg.norm([1.0])


def test_jobs_are_done_when_they_are_submitted() -> None:
    executor = AtOnce(1, "recorder")
    assert executor.submit(max, 1, 2).result(timeout=0) == 2
    assert isinstance(executor.submit(int, "x").exception(timeout=0), ValueError)


LEARNS = """
import asyncio, sys
if {without}:
    # as in a browser, where numba is missing, too, and Python is 3.14
    sys.modules.update({{"numba": None, "compression.zstd": sys}})
    from txt1_browser.lacking import stand_in
    stand_in()
import txt1
from txt1.config import load
from txt1.learning import task
from txt1.learning.registry import agent_of

async def main():
    config = load(None, ["seed=5"], {{}}, {{}}).config
    agent = agent_of(config, "thesis", None)
    async with txt1.Robot.open("sim", config=config) as robot:
        robot.runtime.bus.subscribe(lambda topic, step, time: print(time, *step), [task.STEP])
        await task.need_light(robot)
        task.start(robot, agent, episodes=3)
        robot.arm()
        await asyncio.sleep(20.0)
        print(agent.table().values, "numpy" in sys.modules and hasattr(sys.modules["numpy"], "__version__"))

txt1.run(main(), speed="max")
"""


def test_without_numpy_the_thesiss_learner_decides_the_same_to_the_last_bit() -> None:
    *told, end = (
        subprocess.run(
            [sys.executable, "-c", LEARNS.format(without=without)], capture_output=True, text=True, check=True
        ).stdout
        for without in (True, False)
    )
    [without] = told
    assert without.count("\n") > 20
    assert without.replace("False", "True") == end, "each decision, reward and value"
    assert without.endswith("False\n") and end.endswith("True\n")


RECORDS = """
import sys
if {without}:
    sys.modules.update({{"numba": None, "compression.zstd": sys}})
    from txt1_browser.lacking import stand_in
    stand_in()
import txt1.robot
from txt1.record import recorder
from txt1.model.odometry import Odometry
from txt1.tasks.encoder import ODOMETRY, POSE

encoder = recorder.Encoder(0.0)
encoder.take([(0.02, (ODOMETRY, POSE), (Odometry(1.0, 2.0, 0.5, 0.3, 0.1), (1.0, 2.0, 0.5)))])
print(encoder.block().data.hex())
"""


def test_without_numpy_a_cycle_is_recorded_the_same_to_the_last_byte() -> None:
    without, usual = (
        subprocess.run(
            [sys.executable, "-c", RECORDS.format(without=without)], capture_output=True, text=True, check=True
        ).stdout
        for without in (True, False)
    )
    assert len(without) > 1000 and without == usual
