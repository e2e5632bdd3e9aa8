"""Policies as files: what is written is read, and what txt1 has not written is refused."""

import json
from dataclasses import asdict, replace

import numpy as np
import onnx
import pytest

from txt1.file_limits import POLICY_MAX
from txt1.teaching import onnx_file
from txt1.teaching.features import Layer, Sight, shape_of
from txt1.teaching.network import PolicyNetwork
from txt1.teaching.onnx_file import PolicyError
from txt1.teaching.policy import Card, Policy, digest, judgement, load, loaded

SIGHTS = (
    Sight("camera", "camera", (12, 16, 3), (Layer(4, (5, 5), (2, 2)),), (0.5, 0.4, 0.3), (0.1, 0.2, 0.3)),
    Sight("light", "light", (1, 1, 5), (), (0.2,) * 5, (0.1,) * 5),
)


def policy(members=2, **changed):
    shape = shape_of(SIGHTS, (6,))
    networks = [PolicyNetwork(shape, np.random.default_rng(number)) for number in range(members)]
    card = Card(1, "0", "2026-01-01", SIGHTS, members, (6,), 1.0, 0.5, 0.1, 0.3, weights=digest(networks))
    return Policy(replace(card, **changed), networks)


def looks(rng):
    return [rng.random(sight.size, np.float32) for sight in SIGHTS]


def test_a_file_is_onnx_by_the_library_of_its_makers():
    onnx.checker.check_model(onnx.load_from_string(policy().data), full_check=True)


def test_a_policy_is_read_as_it_was_written(tmp_path):
    written = policy()
    written.save(tmp_path / "a.onnx")
    read = load(tmp_path / "a.onnx")
    assert read.card == written.card
    assert read.data == written.data


def test_onnxruntime_gives_the_outputs_of_training():
    one, seen = policy(), looks(np.random.default_rng(3))
    by_numpy = judgement(one.outputs([each[None] for each in seen])[:, 0])
    assert one.judge(seen) == pytest.approx(by_numpy, abs=1e-5)


def reworked(change):
    """The policy's bytes after somebody has changed the model with another library."""
    model = onnx.load_from_string(policy().data)
    change(model)
    return model.SerializeToString()


def hidden_loop(model):
    model.graph.node.append(onnx.helper.make_node("Loop", ["", ""], ["x"], body=onnx.GraphProto()))


def doubling(model):
    for number in range(40):
        name = f"x{number}"
        model.graph.node.append(onnx.helper.make_node("Concat", ["commands"] * 2, [name], axis=0))


def outside_file(model):
    onnx.external_data_helper.set_external_data(model.graph.initializer[0], "../../etc/passwd")


def huge_padding(model):
    for node in model.graph.node:
        if node.op_type == "Conv":
            node.attribute.append(onnx.helper.make_attribute("pads", [1 << 20] * 4))


def other_operator(model):
    next(node for node in model.graph.node if node.op_type == "Relu").op_type = "Exp"


@pytest.mark.parametrize("change", [hidden_loop, doubling, outside_file, huge_padding, other_operator])
def test_a_hostile_graph_is_refused_before_anything_runs_it(change):
    with pytest.raises(PolicyError):
        loaded(reworked(change))


def card_changed(**values):
    """The policy's bytes with another card."""
    one = policy()
    told = json.loads(json.dumps(asdict(one.card))) | values
    return onnx_file.written(one.networks, one.card.norms, one.card.names, json.dumps(told))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", r"no card.* --card"),
        (b"\xff" * 100, "no ONNX"),
        (bytes(POLICY_MAX + 1), "at most"),
        (policy().data[:-700], "breaks off|card"),
        (policy().data.replace(b"Relu", b"Selu"), "not as"),
        (card_changed(format=2), "card"),
        (card_changed(members=16), "weights"),
        (card_changed(dense=[1024] * 8), "weights|large"),
        (card_changed(doubt_slow="much"), "card"),
        (card_changed(weights="0"), "weights"),
        (card_changed(sees=[]), "card"),
    ],
)
def test_a_file_that_is_no_sound_policy_is_refused_in_a_line(data, words):
    with pytest.raises(PolicyError, match=words) as refused:
        loaded(data)
    assert "\n" not in str(refused.value)


def test_weights_that_are_no_numbers_are_refused():
    one = policy()
    one.networks[0].weights[1][0, 0] = np.nan
    bad = Policy(replace(one.card, weights=digest(one.networks)), one.networks)
    with pytest.raises(PolicyError, match="finite"):
        loaded(bad.data)


def test_a_file_that_is_not_there_is_told_by_its_name(tmp_path):
    with pytest.raises(PolicyError, match=r"none\.onnx"):
        load(tmp_path / "none.onnx")


def test_any_byte_that_is_changed_is_noticed():
    whole = policy().data
    for at in range(0, len(whole), 397):
        data = bytearray(whole)
        data[at] ^= 0x10
        with pytest.raises(PolicyError):
            loaded(bytes(data))
