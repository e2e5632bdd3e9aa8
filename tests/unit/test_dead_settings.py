"""No setting that nothing reads: the name of each stands somewhere in the program as an attribute, or as a text."""

import ast
from pathlib import Path

from txt1.config import Config, completed, flatten

ROOT = Path(__file__).parents[2]


def test_each_setting_is_read_somewhere() -> None:
    keys = [key for key, _ in flatten(completed(Config()))]
    assert len(keys) > 100
    unread = {key.rpartition(".")[2] for key in keys}
    for file in (each for top in ("txt1", "plugins") for each in (ROOT / top).rglob("*.py")):
        text = file.read_text("utf-8")
        # only a file that has one of the rest in it is parsed
        for node in ast.walk(ast.parse(text)) if any(name in text for name in unread) else ():
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                unread.discard(node.attr)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                unread.discard(node.value)
    assert unread == set()
