"""What an owner gives away of a recording: numbers, and neither names nor places unless they are asked for."""

import json
from pathlib import Path

import pytest

from txt1.cli import execute
from txt1.record.share import may_share

SECRETS = ("bob", "roof", "kitchen", "/dev/ttySecret", "35.08")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a drive of a robot whose configuration holds names and places of its owner."""
    pytest.importorskip("matplotlib")
    file = tmp_path_factory.mktemp("share") / "kitchen.mcap"
    words = [
        "run",
        "--headless",
        "--speed",
        "max",
        "--duration",
        "4",
        "--drive",
        "0.5,0.3",
        "--name",
        "bob",
        "--log",
        str(file),
    ]
    settings = (
        "sensors.roof.driver=sim_gps",
        "sensors.roof.options.datum=[35.08,-106.6]",
        "sim.start=[0.25,0.0,0.0]",
        "serial.port=/dev/ttySecret",
        "control.linear.kp=9.5",
    )
    assert execute([*words, *(word for each in settings for word in ("--set", each))]) == 0
    return file


def shared(file: Path, *words: str) -> str:
    """Return the text of the file that is shared."""
    assert execute(["report", "--share", *words, str(file)]) == 0
    return file.with_name(f"{file.stem}-share.json").read_text()


def test_what_is_shared_has_numbers_and_parts_but_neither_names_nor_places(recorded: Path) -> None:
    text = shared(recorded)
    told = json.loads(text)
    assert not [secret for secret in SECRETS if secret in text]
    assert told["left out"] == ["names", "places", "pictures"]
    assert told["drive"]["metres"] == pytest.approx(1.4, abs=0.2)
    assert told["settings"]["control.linear.kp"] == 9.5
    assert told["settings"]["sensors.sensor1.driver"] == "sim_gps"
    assert told["settings"]["sim.start"] == "left out"
    assert "way" not in told and "picture" not in told and "events" not in told


def test_a_sensors_name_is_left_out_also_where_the_configuration_cannot_be_read(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("txt1.record.report.Content.config", None)
    text = shared(recorded)
    assert json.loads(text)["settings"] == "of another version"
    assert not [secret for secret in SECRETS if secret in text]


def test_the_kind_of_car_is_shared_with_what_its_file_sets(tmp_path: Path) -> None:
    file = tmp_path / "race.mcap"
    assert (
        execute(["run", "--headless", "--speed", "max", "--duration", "1", "--vehicle", "f1tenth", "--log", str(file)])
        == 0
    )
    settings = json.loads(shared(file))["settings"]
    assert settings["vehicle"] == "f1tenth" and settings["geometry.steering"] == "front"


def test_a_text_that_may_be_a_path_is_left_out_whatever_its_setting() -> None:
    assert may_share("physics.model", "rover", ()) and not may_share("physics.model", "/home/bob/car.xml", ())
    assert not may_share("vehicle", "bob/car.yaml", ()) and may_share("vehicle", "bob/car.yaml", ("names",))
    assert not may_share("hal_options.home.lat", 35.08, ("names",))


def test_names_places_and_pictures_are_shared_where_they_are_asked_for(recorded: Path) -> None:
    told = json.loads(shared(recorded, "--with", "names,places,pictures"))
    assert told["left out"] == []
    assert told["settings"]["name"] == "bob"
    assert told["settings"]["sensors.roof.options.datum"] == [35.08, -106.6]
    assert any("disarmed" in each for each in told["events"])
    assert told["way"][-1][1:] != told["way"][0][1:]
    assert told["picture"].startswith("data:image/png;base64,")


def test_a_kind_that_there_is_not_is_refused_with_those_that_there_are(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["report", "--share", "--with", "faces", str(recorded)]) == 2
    assert "faces" in (told := capsys.readouterr().err) and "names, places, pictures" in told
    assert execute(["report", "--with", "names", str(recorded)]) == 2
    assert "add --share" in capsys.readouterr().err
