"""A learner of another package that fails, or returns nonsense, is told in one line by its name."""

import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from txt1.cli import execute

SITE = Path(__file__).parent / "site"
Learn = Callable[[str], str]


@pytest.fixture
def learn(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Learn:
    """Learns for two episodes with the learner that these lines of its class make; what is told, by exit code 1."""

    def learn(code: str) -> str:
        (tmp_path / "plugin_wrong.py").write_text(f"from plugin_learner import Guesser\n\n{code}\n")
        point = EntryPoint("wrong", "plugin_wrong:create", "txt1.learners")
        monkeypatch.setattr("txt1.plugins.entry_points", lambda group, name=None: [point])
        for folder in (SITE, tmp_path):
            monkeypatch.syspath_prepend(folder)
        monkeypatch.delitem(sys.modules, "plugin_wrong", raising=False)
        words = ["--agent", "wrong", "--trials", "1", "--episodes", "2", "--seed", "1", "--out", str(tmp_path / "out")]
        assert execute(["learn", *words]) == 1
        (told,) = capsys.readouterr().err.splitlines()
        return told

    return learn


@pytest.mark.parametrize("method", ["begin", "see", "waits", "act", "end", "table", "memory"])
def test_one_that_raises(learn: Learn, method: str) -> None:
    told = learn(f"class create(Guesser):\n    def {method}(self, *given):\n        raise ValueError('no luck')")
    assert told.endswith(f"the learner 'wrong' (plugin_wrong:create) failed in {method}: ValueError: no luck")


@pytest.mark.parametrize(
    ("method", "returned", "why"),
    [
        ("act", "3", ": act returned 3; return 0 to 2"),
        ("act", "-1", ": act returned -1; return 0 to 2"),
        ("act", "0.5", " failed in act: TypeError: 'float' object cannot be interpreted as an integer"),
        ("table", "None", ": table returned None; return a StoredTable"),
        ("memory", "[1]", ": memory returned [1]; return a dict"),
    ],
)
def test_one_that_returns_nonsense(learn: Learn, method: str, returned: str, why: str) -> None:
    told = learn(f"class create(Guesser):\n    def {method}(self, *given):\n        return {returned}")
    assert told.endswith(f"the learner 'wrong' (plugin_wrong:create){why}")


def test_one_that_is_no_learner(learn: Learn) -> None:
    told = learn("def create(config, rng, stored):\n    return None")
    assert told.startswith(
        "txt1: the learner 'wrong' (plugin_wrong:create) is no txt1.learning.agent.Agent: NoneType has"
    )
