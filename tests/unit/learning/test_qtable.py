"""The Q-table, its update and its file."""

from __future__ import annotations

import json
from hashlib import sha256
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from txt1.config import Config
from txt1.config import load as configured
from txt1.errors import QTableError
from txt1.learning.experiment import OURS, Plan, load_result, result_file, save_result, write
from txt1.learning.light_direction import SECTORS
from txt1.learning.qtable import ACTIONS, STATES, StoredTable, initial, load, save, update
from txt1.learning.registry import LEARNERS, from_table, make
from txt1.learning.thesis import TABLE_5_3, ThesisAgent, greedy_action
from txt1.learning.trial import Episode, Start, TrialResult
from txt1.sim.pcg64 import Pcg64

# -- table and update --------------------------------------------------------------------------------------------


def test_a_new_table_is_uniform_between_minus_and_plus_a_tenth() -> None:
    q = initial(np.random.default_rng(1))
    assert np.shape(q) == (8, 3)
    assert q == initial(np.random.default_rng(1)) == initial(Pcg64([1])), "with numpy and without"
    many = np.array(initial(np.random.default_rng(1), 10_000))
    assert -0.1 <= many.min() < -0.0999
    assert 0.0999 < many.max() <= 0.1
    assert many.std() == pytest.approx(0.1 / 3**0.5, rel=0.01)


def test_the_update_is_5_1() -> None:
    q = np.zeros((8, 3))
    q[2, 1], q[3] = 0.4, (0.1, 0.8, -0.2)
    # by hand: 1 + 0.5 * 0.8 - 0.4 = 1.0, three tenths of it
    assert update(q, 2, 1, 1.0, 3) == pytest.approx(1.0)
    assert q[2, 1] == pytest.approx(0.7)
    assert np.count_nonzero(q) == 4, "nothing else changes"
    assert update(q, 2, 1, -1.0, 2, alpha=1.0, gamma=0.0) == pytest.approx(-1.7)
    assert q[2, 1] == -1.0


@given(st.integers(0, 7), st.integers(0, 2), st.integers(-1, 1), st.integers(0, 7), st.floats(0, 1), st.floats(0, 0.99))
def test_an_update_moves_towards_the_discounted_reward(s: int, a: int, r: int, s2: int, alpha: float, g: float) -> None:
    q = initial(np.random.default_rng(5))
    before, target = q[s][a], r + g * max(q[s2])
    update(q, s, a, r, s2, alpha, g)
    assert q[s][a] == pytest.approx((1 - alpha) * before + alpha * target, abs=1e-12)


def test_table_5_3_turns_to_where_the_light_is() -> None:
    rng = np.random.default_rng(1)
    turns = [ACTIONS[greedy_action(np.array(row), rng)] for row in TABLE_5_3]
    assert turns == ["right", "right", "right", "right", "straight", "left", "left", "left"]
    assert np.shape(TABLE_5_3) == (STATES, len(ACTIONS)) == (len(SECTORS), 3)


# -- the file ----------------------------------------------------------------------------------------------------


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "qtable.json"
    save(path, StoredTable(np.array(TABLE_5_3), {"agent": "thesis", "seed": 1, "episodes": 31, "grüße": [1.5, None]}))
    return path


def test_what_was_saved_is_loaded_to_the_last_bit(tmp_path: Path, file: Path) -> None:
    stored = load(file)
    assert np.array_equal(stored.values, np.array(TABLE_5_3))
    assert stored.about == {"agent": "thesis", "seed": 1, "episodes": 31, "grüße": [1.5, None]}
    values = np.random.default_rng(1).normal(size=(24, 5)) * 10.0 ** np.arange(-2, 3)
    save(tmp_path / "other.json", StoredTable(values))
    assert np.array_equal(load(tmp_path / "other.json").values, values)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other.json", "qtable.json"], "no leftovers"


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text() | st.integers(), inner, max_size=3),
    max_leaves=10,
)


@given(
    st.integers(1, 4).flatmap(
        lambda actions: st.lists(
            st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=actions, max_size=actions), min_size=1
        )
    ),
    st.dictionaries(st.text(), JSON, max_size=4),
)
@example([[1.7e308]], {"paths": {2: 0, 10: 0}})
def test_whatever_finite_table_was_saved_can_be_loaded(rows: list[list[float]], about: dict[str, Any]) -> None:
    with TemporaryDirectory() as directory:
        path = Path(directory, "qtable.json")
        save(path, StoredTable(np.array(rows), about))
        stored = load(path)
    assert np.array_equal(stored.values, np.array(rows))
    assert stored.about == json.loads(json.dumps(about))


def test_saving_again_replaces_the_file(file: Path) -> None:
    save(file, StoredTable(np.zeros((2, 2))))
    assert load(file).shape == (2, 2)


def test_white_space_is_no_alteration(file: Path) -> None:
    file.write_text(json.dumps(json.loads(file.read_text())))
    load(file)


def refused(path: Path, problem: str) -> None:
    """Loading fails and says which file, what is wrong and what to do."""
    with pytest.raises(QTableError, match=problem) as caught:
        load(path)
    assert str(caught.value).startswith(str(path))
    assert "; " in str(caught.value)


def alter(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(("old", "new"), [("0.9494", "0.9495"), ("0.9494", "-0.9494"), ('"seed": 1', '"seed": 2')])
def test_an_altered_table_is_refused(file: Path, old: str, new: str) -> None:
    alter(file, old, new)
    refused(file, "was altered")


def test_a_table_without_its_checksum_is_refused(file: Path) -> None:
    content = json.loads(file.read_text())
    del content["sha256"]
    file.write_text(json.dumps(content))
    refused(file, "was altered")


def test_a_table_truncated_anywhere_is_refused(file: Path) -> None:
    text = file.read_text()
    for length in range(0, len(text.rstrip()), 5):
        file.write_text(text[:length])
        refused(file, "is cut off")


@pytest.mark.parametrize(
    "value", ["NaN", "Infinity", "-Infinity", "1e999", '"0.9"', "null", "true", "[]", "1" + "0" * 400]
)
def test_a_value_that_is_no_finite_number_is_refused(file: Path, value: str) -> None:
    alter(file, "0.9494", value)
    refused(file, "is no finite number|was altered")


@pytest.mark.parametrize(
    ("shape", "problem"),
    [((8, 2), "has 2 actions where 3"), ((7, 3), "has 7 states where 8"), ((16, 3), "has 16 states")],
)
def test_a_table_of_the_wrong_shape_is_refused(tmp_path: Path, shape: tuple[int, int], problem: str) -> None:
    path = tmp_path / "qtable.json"
    save(path, StoredTable(np.zeros(shape)))
    with pytest.raises(ValueError, match=problem):
        load(path).shaped(8, 3)
    assert load(path).shape == shape


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[1, 2]", "no Q-table"),
        ("{}", "no Q-table"),
        ('"qtable"', "no Q-table"),
        ("state;action\n1;2\n", "no Q-table"),
        ("[" * 100_000, "no Q-table"),
        ("", "is cut off"),
        ("\n \n", "is cut off"),
    ],
)
def test_files_of_something_else_are_refused(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "qtable.json"
    path.write_text(text)
    refused(path, problem)


def signed(path: Path, values: str, about: str = "{}") -> None:
    """Write a table whose checksum is right, of two texts in JSON."""
    content = {"format": "txt1 Q-table", "version": 1, "values": json.loads(values), "about": json.loads(about)}
    content["sha256"] = sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("values", "about"),
    [
        ("[[1, 2], [3]]", "{}"),
        ('[["a", "b"]]', "{}"),
        ('{"a": 1}', "{}"),
        ("null", "{}"),
        ("[]", "{}"),
        ("[[[1]]]", "{}"),
        ("[[1, Infinity]]", "{}"),
        ("[[1, NaN]]", "{}"),
        ("[[1, 1e999]]", "{}"),
        (f"[[1, {'9' * 401}]]", "{}"),
        ("[[1, 2]]", "[]"),
        ("[[1, 2]]", '{"used": [Infinity]}'),
    ],
)
def test_a_right_checksum_does_not_make_a_table(tmp_path: Path, values: str, about: str) -> None:
    path = tmp_path / "qtable.json"
    signed(path, values, about)
    refused(path, "Q-table|holds no table")


def test_an_infinite_number_written_as_a_long_one_is_refused(file: Path) -> None:
    file.write_text(file.read_text().replace('"version": 1', '"version": 1e999'))
    refused(file, "1e999 is no finite number")


@pytest.mark.parametrize("about", [{}, {"knows": {"survey": [1.0]}, "scale": "x"}])
def test_the_thesiss_learner_keeps_nothing_with_its_table(tmp_path: Path, about: dict[str, Any]) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "qtable.json"
    save(path, StoredTable(np.zeros((8, 3)), {"agent": "thesis", **about}))
    assert from_table(path, Config(), rng).name == "thesis"


def test_a_learner_of_others_gets_an_array_and_numpys_generator(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []

    def create(config: Config, rng: Any, stored: StoredTable | None) -> Any:
        given.append((rng.normal(), stored))
        return object()

    monkeypatch.setitem(LEARNERS.table, "mine", create)
    save(file, StoredTable(TABLE_5_3, {"agent": "mine"}))
    from_table(file, Config(), Pcg64([1]))
    [(drawn, stored)] = given
    assert [drawn] == Pcg64([1]).standard_normal(1)
    assert stored.values[4, 1] == stored.shaped(8, 3)[4, 1] == TABLE_5_3[4][1]


@pytest.mark.parametrize("version", [0, 2, "1", None])
def test_another_version_is_refused(file: Path, version: object) -> None:
    content = json.loads(file.read_text())
    content["version"] = version
    file.write_text(json.dumps(content))
    refused(file, "this program reads 1")


def test_binary_missing_files_and_directories_are_refused(tmp_path: Path) -> None:
    (tmp_path / "q.pickle").write_bytes(b"\x80\x04\x95\xff\x00")
    refused(tmp_path / "q.pickle", "no Q-table")
    refused(tmp_path / "nowhere.json", "cannot be read: No such file")
    refused(tmp_path, "cannot be read")


def test_a_file_that_cannot_be_written_says_so_and_an_old_one_survives(tmp_path: Path, file: Path) -> None:
    with pytest.raises(QTableError, match=r"nowhere/qtable.json: cannot be written: No such file"):
        save(tmp_path / "nowhere" / "qtable.json", StoredTable(np.zeros((8, 3))))
    old = file.read_bytes()
    for values, about in (
        (np.full((8, 3), nan), {}),
        (np.zeros(8), {}),
        (np.zeros((8, 3)), {"x": nan}),
        (np.zeros((8, 3)), {"x": {1}}),
    ):
        with pytest.raises(ValueError, match=r"Q-table|JSON|float"):
            save(file, StoredTable(values, about))
    assert file.read_bytes() == old


def test_a_stored_table_is_driven_with_the_settings_it_was_learned_with(tmp_path: Path) -> None:
    path = tmp_path / "qtable.json"
    learned = configured(None, ["learning.thesis.direction=summed", "learning.thesis.filtered=false"]).config
    save(path, make("thesis", learned, np.random.default_rng(1)).table())
    driver = from_table(path, Config(), np.random.default_rng(1))
    assert isinstance(driver, ThesisAgent)
    assert (driver.settings.direction, driver.settings.filtered) == ("summed", False)
    assert driver.settings.policy == "greedy" and not driver.training


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("learning.thesis.direction=diagonal", r"learned with learning\.thesis\.direction=summed, not diagonal"),
        ("learning.actions=[[0.3, 0.5], [0.3, 0.0], [0.3, -0.5]]", r"learned with learning\.actions="),
    ],
)
def test_a_stored_table_refuses_settings_of_another_meaning(given: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "qtable.json"
    learned = configured(None, ["learning.thesis.direction=summed"]).config
    save(path, make("thesis", learned, np.random.default_rng(1)).table())
    with pytest.raises(QTableError, match=told):
        from_table(path, configured(None, [given]).config, np.random.default_rng(1))


# -- in the files of an experiment -----------------------------------------------------------------------------------

LIKE_OURS = {"memory": [1], "trial": "mine", "complete": 0.5, "voided": "no", "learned": {}, "paths": 3, "seed": None}


def trial_with(notes: dict[str, Any], out: Path) -> tuple[TrialResult, Path]:
    """Return a trial by a learner with these notes, and its file."""
    table = StoredTable([[0.1, 0.2, 0.3]] * STATES, {"agent": "thesis", **notes})
    episode = Episode(1, Start(0.5, -0.5), 4.0, True, 3.5, 2.0, False)
    done = TrialResult(2, [episode], True, table, {"q": [1.0]}, {1: [(0.0, 1.5)]}, 1)
    (out / "trials").mkdir()
    save_result(out, done)
    return done, result_file(out, 2)


def test_a_learners_notes_keep_their_keys_whatever_the_trial_tells(tmp_path: Path) -> None:
    done, file = trial_with(LIKE_OURS, tmp_path)
    assert load_result(file) == done
    write(Plan("thesis", 1, 1, 3, Config()), tmp_path, [done])
    stored = load(tmp_path / "qtable.json").about
    assert stored == {**stored, **LIKE_OURS}


def test_a_trial_is_read_that_was_kept_among_the_learners_notes(tmp_path: Path) -> None:
    done, file = trial_with({"states": "eight"}, tmp_path)
    stored = load(file)
    about = dict(stored.about)
    save(file, StoredTable(stored.values, about | about.pop(OURS)))
    assert load_result(file) == done
