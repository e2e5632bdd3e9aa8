"""The thesis's two worlds, and the readings of its text."""

from __future__ import annotations

from pathlib import Path

import pytest

from txt1.config import load
from txt1.errors import ConfigError
from txt1.learning.settings import LearningConfig
from txt1.learning.world_presets import world_named
from txt1.sim.lamp import PointLight, lux_at, noise_for_jitter
from txt1.trials.run import run
from txt1_learners.studies import thesis


def test_the_simulation_has_no_noise_and_no_filter_and_the_hardware_has_both() -> None:
    simulation, hardware = (load(world_named(f"thesis-{name}")).config for name in ("simulation", "hardware"))
    assert simulation.sim.light.noise == 0.0 and hardware.sim.light.noise is None
    assert not simulation.section(LearningConfig).thesis.filtered
    assert hardware.section(LearningConfig).thesis.filtered and hardware.sim.light.height > 0.0
    assert hardware.section(LearningConfig).pose in hardware.sensors


def test_a_world_that_there_is_not_is_refused() -> None:
    with pytest.raises(ConfigError, match="there is no such world"):
        world_named("nowhere")


def test_a_lamp_is_as_far_as_it_hangs_and_needs_less_noise_for_the_same_jitter() -> None:
    (below, *_) = lux_at(0.0, 0.0, 0.0, PointLight(height=2.0), ((0.0, 0.0),) * 4)
    assert below == pytest.approx(135.0 / 4.0)
    assert noise_for_jitter(height=2.0) < 0.5 * noise_for_jitter()


def test_every_reading_is_a_sound_configuration() -> None:
    assert len({thesis.config_of(name).model_dump_json() for name in thesis.READINGS}) == len(thesis.READINGS)


@pytest.mark.long
def test_the_study_keeps_its_trials_and_tells_whether_the_thesis_is_within(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thesis, "EPISODES", 9)
    file, told = tmp_path / "readings.jsonl", list[str]()
    names = ["the reading held"]

    def each(work: object, missing: dict[object, object], keep: object) -> int:
        return run(work, missing, None, keep)  # type: ignore[arg-type]

    assert thesis.study(file, 2, 3, each, told.append, names) == 0
    assert thesis.study(file, 2, 3, each, told.append, names) == 0
    assert told == ["the reading held, trials 1 to 2"]
    assert "| the reading held | " in file.with_suffix(".md").read_text()
    with pytest.raises(ConfigError, match="another seed"):
        thesis.study(file, 2, 4, each, told.append, names)


def test_a_reading_reproduces_the_figure_that_lies_within_its_means_of_five() -> None:
    def lines(late: list[float]) -> list[dict[str, object]]:
        return [{"times": [99.0] * 7 + [time], "success": [1] * 8} for time in late]

    assert thesis.figures(lines([6.0, 7.0, 8.0]))["reproduced"]
    assert not thesis.figures(lines([9.0, 9.1, 9.2]))["reproduced"]
