"""A policy from elsewhere is driven by as its card says, and refused in words where it does not fit."""

from __future__ import annotations

from math import inf, nan, pi, tan
from pathlib import Path

import numpy as np
import pytest

from txt1.config import load as configured
from txt1.errors import ConfigError
from txt1.file_limits import POLICY_MAX
from txt1.sensors.readings import Mount, Scan
from txt1.teaching.features import Unfit
from txt1.teaching.foreign_policy import ForeignPolicy, load
from txt1.teaching.onnx_file import PolicyError

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

# the shapes of TinyLidarNet: every second beam of 1081 over 270 degrees, steering in rad, speed for 1 to 8 m/s
TINY = """
sees: [{kind: laser, sensor: laser, beams: 541, first: -2.3562, last: 2.3562, clip: 10.0}]
says: {steering: rad, slow: 1.0, fast: 8.0}
rate: 40
"""
NUMBERED = """
sees: [{kind: light, sensor: light}, {kind: odometry}]
says: {commands: [[0.3, -0.5], [0.3, 0.0], [0.3, 0.5]]}
rate: 2
"""
CONFIG = configured(None, ()).config


def network(path: Path, shape: list[object], outputs: np.ndarray, kind: int = 1) -> Path:
    """Write a network whose outputs are weighted sums of its inputs, (numbers, outputs)."""
    helper, numpy_helper = onnx.helper, onnx.numpy_helper
    count = outputs.shape[0]
    nodes = [
        helper.make_node("Reshape", ["seen", "flat"], ["row"]),
        helper.make_node("MatMul", ["row", "weights"], ["said"]),
    ]
    weights = outputs.astype(np.float32 if kind == 1 else np.float64)
    given = [
        numpy_helper.from_array(np.array([1, count]), "flat"),
        numpy_helper.from_array(weights, "weights"),
    ]
    seen = helper.make_tensor_value_info("seen", kind, shape)
    said = helper.make_tensor_value_info("said", kind, [1, outputs.shape[1]])
    graph = helper.make_graph(nodes, "elsewhere", [seen], [said], given)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    return path


def of(tmp_path: Path, card: str, shape: list[object], outputs: np.ndarray, kind: int = 1) -> ForeignPolicy:
    (tmp_path / "card.yaml").write_text(card)
    return load(network(tmp_path / "foreign.onnx", shape, outputs, kind), tmp_path / "card.yaml", CONFIG)


def scan(ranges: np.ndarray, half: float = 0.75 * pi) -> Scan:
    step = 2.0 * half / (len(ranges) - 1)
    return Scan(-half, step, 0.0, ranges.astype(np.float32), 0.02, 30.0, mount=Mount())


def test_a_network_with_tinylidarnets_shapes_steers_in_rad_and_meters_a_second(tmp_path: Path) -> None:
    # steers by the leftmost ray, and drives by the one straight ahead
    outputs = np.zeros((541, 2))
    outputs[540, 0], outputs[270, 1] = 0.02, 0.1
    policy = of(tmp_path, TINY, ["batch", 541, 1], outputs)
    ranges = np.full(1081, inf)
    ranges[1080], ranges[540] = 5.0, 2.5
    judgement = policy.judged([scan(ranges)])
    assert judgement.steering == pytest.approx(tan(0.1) / tan(CONFIG.geometry.steering_max), rel=1e-5)
    assert judgement.speed * policy.card.v_max == pytest.approx(1.0 + 0.25 * 7.0, rel=1e-5)
    assert judgement.doubt == 0.0
    ranges[1080] = nan
    assert policy.judged([scan(ranges)]).steering == pytest.approx(
        min(tan(0.2) / tan(CONFIG.geometry.steering_max), 1.0), rel=1e-5
    )


def apart(tmp_path: Path, location: str = "foreign.onnx.data") -> tuple[Path, Path]:
    """Write a network of a card whose weights are in a file; return it and the card."""
    outputs = np.zeros((6, 3))
    outputs[0, 2] = 1.0
    path, there = network(tmp_path / "foreign.onnx", [1, 6], outputs), tmp_path / "card.yaml"
    onnx.save(onnx.load(path), path, save_as_external_data=True, location="foreign.onnx.data", size_threshold=50)
    there.write_text(NUMBERED)
    model = onnx.load(path, load_external_data=False)
    for entry in model.graph.initializer[1].external_data:
        entry.value = location if entry.key == "location" else entry.value
    path.write_bytes(model.SerializeToString())
    return path, there


def test_weights_in_the_file_beside_the_network_are_found_from_anywhere(tmp_path: Path) -> None:
    path, there = apart(tmp_path)
    assert load(path, there, CONFIG).judged([(900.0, 10.0, 10.0, 10.0), (0.3, 0.0)]).steering > 0.0
    (tmp_path / "foreign.onnx.data").unlink()
    with pytest.raises(PolicyError, match=r"cannot load it.*weights in foreign\.onnx\.data beside it"):
        load(path, there, CONFIG)


@pytest.mark.parametrize("inside", ["graph", "constant", "branch"])
@pytest.mark.parametrize("location", ["../secret", "/secret", "link", "other", "sub/../../secret"])
def test_weights_in_any_other_file_are_not_read(
    inside: str, location: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "given"
    (folder / "sub").mkdir(parents=True)
    monkeypatch.chdir(folder)
    path, there = apart(folder, str(tmp_path / "secret") if location == "/secret" else location)
    for name in (tmp_path / "secret", folder / "other"):
        name.write_bytes((folder / "foreign.onnx.data").read_bytes())
    (folder / "link").symlink_to(tmp_path / "secret")
    model, helper = onnx.load(path, load_external_data=False), onnx.helper
    graph = model.graph
    weights = graph.initializer[1]
    if inside == "constant":
        graph.node.insert(0, helper.make_node("Constant", [], ["weights"], value=weights))
        del graph.initializer[1]
    elif inside == "branch":
        said = helper.make_tensor_value_info("branch", 1, [1, 3])
        branch = helper.make_graph(
            [helper.make_node("MatMul", ["row", "weights"], ["branch"])], "b", [], [said], [weights]
        )
        graph.node[1].CopyFrom(helper.make_node("If", ["true"], ["said"], then_branch=branch, else_branch=branch))
        graph.initializer[1].CopyFrom(onnx.numpy_helper.from_array(np.array(True), "true"))
    path.write_bytes(model.SerializeToString())
    with pytest.raises(PolicyError, match="onnxruntime cannot load it"):
        load(path, there, CONFIG)


def test_a_file_of_weights_counts_with_its_network_and_is_no_link_elsewhere(tmp_path: Path) -> None:
    folder = tmp_path / "given"
    folder.mkdir()
    path, there = apart(folder)
    data = (folder / "foreign.onnx.data").rename(tmp_path / "elsewhere")
    (folder / "foreign.onnx.data").symlink_to(data)
    with pytest.raises(PolicyError, match=r"foreign\.onnx\.data: it is a link into another folder"):
        load(path, there, CONFIG)
    (folder / "foreign.onnx.data").unlink()
    with (folder / "foreign.onnx.data").open("wb") as file:
        file.truncate(POLICY_MAX - path.stat().st_size + 1)
    with pytest.raises(PolicyError, match=r"foreign\.onnx\.data: cannot read it: it has \d+ bytes, and at most"):
        load(path, there, CONFIG)


def test_the_largest_number_chooses_a_command(tmp_path: Path) -> None:
    outputs = np.zeros((6, 3))
    outputs[0, 2], outputs[1, 0] = 1.0, 1.0  # front left bright: left
    policy = of(tmp_path, NUMBERED, [1, 6], outputs)
    left = policy.judged([(900.0, 10.0, 10.0, 10.0), (0.3, 0.0)])
    right = policy.judged([(10.0, 900.0, 10.0, nan), (0.3, 0.0)])
    assert left.steering == pytest.approx(0.5 * CONFIG.geometry.radius_min / 0.3) and left.speed == 1.0
    assert right.steering == pytest.approx(-left.steering)


def test_outputs_that_are_no_numbers_are_not_finite(tmp_path: Path) -> None:
    policy = of(tmp_path, NUMBERED, [1, 6], np.full((6, 3), nan))
    assert not policy.judged([(1.0, 1.0, 1.0, 1.0), (0.0, 0.0)]).finite


@pytest.mark.parametrize(
    ("shape", "outputs", "kind", "told"),
    [
        ([1, 1080], np.zeros((1080, 2)), 1, "takes 1080 numbers, and the card sees 541: 541 of 'laser'"),
        ([1, 541], np.zeros((541, 3)), 1, "has 3 numbers, and by the card it says 2"),
        ([1, 541], np.zeros((541, 2)), 11, r"export it with 32-bit floats"),
    ],
)
def test_shapes_that_do_not_fit_are_refused_in_words(
    shape: list[object], outputs: np.ndarray, kind: int, told: str, tmp_path: Path
) -> None:
    with pytest.raises(PolicyError, match=told):
        of(tmp_path, TINY, shape, outputs, kind)


def test_a_file_that_is_no_network_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "card.yaml").write_text(TINY)
    (tmp_path / "foreign.onnx").write_bytes(b"no network")
    with pytest.raises(PolicyError, match="onnxruntime cannot load it"):
        load(tmp_path / "foreign.onnx", tmp_path / "card.yaml", CONFIG)


@pytest.mark.parametrize(
    ("card", "told"),
    [
        ("- 1", "is no card; give it the keys sees, says and rate"),
        (TINY.replace("rate: 40", "rate: 0"), "rate"),
        (TINY.replace("steering: rad, ", ""), "give either steering"),
        (TINY.replace("sensor: laser, ", ""), "name a sensor for each sight"),
        (TINY.replace("beams", "beems"), "beems"),
        (NUMBERED.replace("0.3, 0.0", "-0.3, 0.0"), "drives forward"),
    ],
)
def test_a_card_that_is_wrong_is_refused_by_its_field(card: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=told):
        of(tmp_path, card, [1, 541], np.zeros((541, 2)))


def test_a_laser_that_does_not_look_far_enough_round_is_unfit(tmp_path: Path) -> None:
    policy = of(tmp_path, TINY, [1, 541, 1], np.zeros((541, 2)))
    with pytest.raises(Unfit, match=r"looks from -1\.57 to 1\.57 rad, and the policy sees from -2\.36 to 2\.36"):
        policy.judged([scan(np.ones(541), half=0.5 * pi)])
    with pytest.raises(Unfit, match="tells no laser's readings"):
        policy.judged([(1.0, 2.0, 3.0, 4.0)])
