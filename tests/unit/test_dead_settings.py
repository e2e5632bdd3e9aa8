"""No setting that nothing reads: the name of each stands somewhere in the program as an attribute, or as a text."""

import ast
from pathlib import Path

from txt1.config import Config, completed, flatten

ROOT = Path(__file__).parents[2]


def test_each_setting_is_read_somewhere() -> None:
    read: set[str] = set()
    for top in ("txt1", "plugins", "studies"):
        for file in (ROOT / top).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_bytes())):
                if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                    read.add(node.attr)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    read.add(node.value)
    keys = [key for key, _ in flatten(completed(Config()))]
    assert len(keys) > 100
    assert [key for key in keys if key.rpartition(".")[2] not in read] == []
