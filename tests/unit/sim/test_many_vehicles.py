"""Many vehicles at once move as each of them does alone."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from math import cos, exp, pi, sin
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sim_steps import Parameters, advance, numbers

from tests.examples import examples
from txt1.sim import batch
from txt1.sim.dynamics import VehicleState
from txt1.sim.machine_code import compiled

COUNT = 40
PARAMETERS = st.fixed_dictionaries(
    {
        "steering_max": st.floats(0.1, 0.7),
        "speed_time_constant": st.floats(0.02, 2.0),  # the shortest are beyond the series
        "servo_rate": st.floats(0.5, 20.0),
        "scrub": st.floats(0.0, 0.3),
        "slip": st.floats(0.0, 0.3),
        "understeer": st.floats(0.0, 1.0),
    }
).map(lambda given: Parameters(**given))


def some_vehicles(rng: np.random.Generator, p: Parameters) -> NDArray[np.float64]:
    """Half of them with the wheels straight ahead, some at rest."""
    return np.array(
        [
            *rng.uniform(-5.0, 5.0, (2, COUNT)),
            rng.uniform(-pi, pi, COUNT),
            rng.uniform(-2.0, 2.0, COUNT) * (rng.random(COUNT) < 0.9),
            rng.uniform(-p.steering_max, p.steering_max, COUNT) * (rng.random(COUNT) < 0.5),
            *rng.uniform(-50.0, 50.0, (2, COUNT)),
            rng.uniform(-2.0, 2.0, COUNT) * (rng.random(COUNT) < 0.3),
        ]
    )


@settings(max_examples=examples(60))
@given(p=PARAMETERS, seed=st.integers(0, 2**32 - 1), dt=st.floats(0.001, 0.03))
@pytest.mark.long
def test_a_vehicle_moves_in_the_batch_as_alone(p: Parameters, seed: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    before = some_vehicles(rng, p)
    motor = np.trunc(rng.uniform(-7500.0, 7500.0, COUNT)) * (rng.random(COUNT) < 0.8)
    steering = np.trunc(rng.uniform(-20000.0, 20000.0, COUNT))
    drag = 0.03 * rng.standard_normal(COUNT)
    after = before.copy()
    batch.move(after, motor, steering, drag, dt, numbers(p), np.empty(COUNT), np.empty(COUNT))
    for i in range(COUNT):
        x, y, theta, v, phi, right, left, spin = before[:, i]
        alone = advance(
            VehicleState(x, y, theta, v, phi, -phi, right, left, spin),
            motor[i],
            -steering[i],
            steering[i],
            dt,
            drag[i],
            p,
        )
        expected = [alone.x, alone.y, alone.theta, alone.v, alone.phi_front, alone.right, alone.left, alone.spin]
        difference = after[:, i] - expected
        difference[batch.THETA] = (difference[batch.THETA] + 1.0) % (2.0 * pi) - 1.0
        assert np.abs(difference).max() < 1e-12


def test_the_series_are_exact_to_the_last_bits() -> None:
    angles = np.linspace(-20.0, 20.0, 2001)
    assert max(abs(batch.sine_cosine(a)[0] - sin(a)) for a in angles) < 3e-15
    assert max(abs(batch.sine_cosine(a)[1] - cos(a)) for a in angles) < 3e-15
    small = np.linspace(-batch.EXPONENT_MAX, batch.EXPONENT_MAX, 501)
    assert max(abs(batch.exponential(x) / exp(x) - 1.0) for x in small) < 1e-15


def test_nothing_is_compiled_without_scipy_whose_algebra_numba_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """numba ends the process when a compiled function solves a system of equations, and scipy is missing."""
    monkeypatch.setitem(sys.modules, "scipy", None)
    assert compiled(cos) is cos


def test_machine_code_is_kept_until_something_changes_that_it_was_made_from(tmp_path: Path) -> None:
    """numba itself looks for changes in the caller's file only."""
    program = """
import os
import sys
from txt1.sim.machine_code import compiled
sys.path.insert(0, sys.argv[1])
for factor, text, plus in eval(sys.argv[2]):
    known = f"import numpy\\nFACTOR, PLUS = {factor}, numpy.array([{plus}])\\n"
    with open(os.path.join(sys.argv[1], "called.py"), "w") as file:
        file.write(f"{known}def twice(x):\\n    return {text}\\n")
    sys.modules.pop("called", None), sys.modules.pop("caller", None)
    import called, caller
    caller.twice = compiled(called.twice)
    made = compiled(caller.run, cache=True)
    print(made(1.0), sum(made.stats.cache_hits.values()))
"""
    caller = "from called import FACTOR, PLUS, twice\ndef run(x):\n    return FACTOR * twice(x) + PLUS[0]\n"
    (tmp_path / "caller.py").write_text(caller)

    def told(*versions: tuple[float, str, float]) -> list[str]:
        words = [sys.executable, "-B", "-c", program, str(tmp_path), repr(versions)]
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
        return subprocess.run(words, env=environment, capture_output=True, text=True, check=True).stdout.splitlines()

    made = (1.0, "x + x", 0.0)
    assert told(made) == ["2.0 0"]
    again, function, constant, array = told(
        made, (1.0, "x + x + 1.0", 0.0), (3.0, "x + x + 1.0", 0.0), (3.0, "x + x + 1.0", 2.0)
    )
    assert again == "2.0 1", "made once"
    assert function == "3.0 0", "a function that it calls"
    assert constant == "9.0 0", "a constant that it reads"
    assert array == "11.0 0", "an array that it reads"


def test_kept_machine_code_of_a_compiled_module_names_a_module_that_is_there() -> None:
    """numba imports it in the next process, and mypyc's functions are read from the source beside them."""
    builtin = SimpleNamespace(__module__="txt1.control.pid", __name__="at_rest")
    for cache in (False, True):
        function = compiled(cast(Any, builtin), cache=cache)
        assert getattr(function, "py_func", function).__module__ == "txt1.control.pid"


def test_every_extra_that_brings_numba_for_learners_brings_scipy() -> None:
    root = Path(__file__).parents[3]
    for folder, names in ((root, ("fast",)), (root / "plugins/learners", ("sb3",))):
        extras = tomllib.loads((folder / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        for name in names:
            assert any(each.startswith("numba") for each in extras[name])
            assert any(each.startswith("scipy") for each in extras[name])
