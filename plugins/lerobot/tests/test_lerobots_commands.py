"""LeRobot's own commands record, replay and train with a simulated robot: `make test-lerobot`, where LeRobot is."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from tests.patience import LIMIT

pytestmark = pytest.mark.long
HERE = Path(__file__).parent
ROOT = HERE.parents[2]


def test_a_drive_is_recorded_replayed_and_learned_from_by_lerobots_commands(tmp_path: Path) -> None:
    python = os.environ.get("TXT1_LEROBOT")
    if not python:
        pytest.skip("did not run: TXT1_LEROBOT names no Python that has LeRobot and plugins/lerobot")
    environment = {**os.environ, "HF_HOME": str(tmp_path / "hf"), "HF_HUB_OFFLINE": "1"}
    words = [python, str(HERE / "trial.py"), str(tmp_path)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=24.0 * LIMIT)
    assert done.returncode == 0, done.stderr[-3000:]
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["state"] == ["x.pos", "y.pos", "theta.pos", "x.vel", "theta.vel"]
    assert told["action"] == ["x.vel", "theta.vel"]
    states, actions = told["states"], told["actions"]
    # 5 s at 10 a second; LeRobot leaves out those for which a busy computer is too late
    assert 20 <= len(states) == len(actions) <= 51
    assert actions[0] == [0.4, 0.3] and actions[-1] == [0.0, 0.0]
    x, _, _, v, _ = states[-1]
    assert 1.0 < x < 1.8 and abs(v) < 0.02, "4 s at 0.4 m/s, round a bend and back, and then it stands"
    assert max(state[2] for state in states) > 0.3
    count, height, width, _, spread = told["pictures"]
    assert count == len(states) and (height, width) == (120, 160) and spread > 1.0
    losses = told["losses"]
    assert len(losses) >= 5 and losses[-1] < 0.7 * losses[0], "it learns from the drive"
    states, actions = told["by the policy"]["states"], told["by the policy"]["actions"]
    # the first judgements of a network take longer than the frame that they are for
    assert 10 <= len(states) == len(actions) <= 51
    assert max(v for v, _ in actions) > 0.2 and max(state[0] for state in states) > 0.3, "the policy drives the car"
