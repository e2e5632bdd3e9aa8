"""The packages that `txt1 ros1 package` writes, read without ROS."""

import ast
import xml.etree.ElementTree as Xml
from argparse import Namespace
from pathlib import Path

import pytest

from txt1_ros1.command import package
from txt1_ros1.txt_launch import LAUNCHES

ARGUMENTS = {"txt_node": [], "txt_node_net": ["host", "client"], "txt_tf": [], "txt_teleop": []}
NODES = {
    "txt_node": ["txt1_node"],
    "txt_node_net": ["txt1_node"],
    "txt_tf": ["tf"],
    "txt_teleop": ["joystick", "teleop"],
}


@pytest.fixture
def source(tmp_path: Path) -> Path:
    assert package(Namespace(folder=tmp_path)) == 0
    return tmp_path


@pytest.mark.parametrize("name", ARGUMENTS)
def test_launch_files_have_the_original_s_arguments_and_nodes(source: Path, name: str) -> None:
    root = Xml.parse(source / "txt_launch" / "launch" / f"{name}.launch").getroot()
    assert [each.get("name") for each in root.iter("arg") if each.get("default") is None] == ARGUMENTS[name]
    assert [each.get("name") for each in root.iter("node")] == NODES[name]
    if name.startswith("txt_node"):
        assert [each.get("file") for each in root.iter("include")] == ["$(find txt_launch)/launch/txt_tf.launch"]


def test_there_are_the_original_s_four(source: Path) -> None:
    assert {each.stem for each in (source / "txt_launch" / "launch").iterdir()} == set(ARGUMENTS) == set(LAUNCHES)


def test_each_program_of_a_launch_file_is_there_and_can_be_run(source: Path) -> None:
    for file in (source / "txt_launch" / "launch").iterdir():
        for node in Xml.parse(file).getroot().iter("node"):
            if (owner := node.get("pkg")) != "joy":
                program = source / str(owner) / "bin" / str(node.get("type"))
                assert program.stat().st_mode & 0o111
                ast.parse(program.read_text())
