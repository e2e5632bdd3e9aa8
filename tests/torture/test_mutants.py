"""The mistakes that are made in the code, to see whether a test notices them."""

from pathlib import Path

import pytest

from torture.mutants import mutants
from torture.mutation import put_in


def test_each_mistake_is_made_by_itself_and_named(tmp_path: Path) -> None:
    file = tmp_path / "m.py"
    file.write_text("def slow(v):\n    return v < 1.5 and True\n")
    made = mutants(file, tmp_path)
    assert [mutant.name.partition(" in ")[0] for mutant in made] == [
        "m.py slow: `v < 1.5 and True` -> `v < 1.5 or True`",
        "m.py slow: `v < 1.5` -> `v <= 1.5`",
        "m.py slow: `1.5` -> `2.5`",
        "m.py slow: `True` -> `False`",
    ]
    said = []
    for mutant in made:
        names: dict[str, object] = {}
        exec(mutant.compiled(), names)
        slow = names["slow"]
        assert callable(slow)
        said.append((slow(1.0), slow(1.5), slow(2.0)))
    assert said == [(True, True, True), (True, True, False), (True, True, True), (False, False, False)]


def test_a_wrong_constant_leaves_the_module_its_own_functions(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")
    from txt1.web import requests

    monkeypatch.setattr(requests, "LIMIT_MIN", requests.LIMIT_MIN)
    table = requests.REQUESTS
    file = Path(requests.__file__)
    put_in(next(each for each in mutants(file, file.parents[2]) if "in `LIMIT_MIN" in each.name))
    assert requests.LIMIT_MIN == 1.1
    assert requests.REQUESTS is table
