"""Fleets of tests have a key of their own, not that of whoever runs them."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def fleet_s_key(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for the user's own key."""
    folder = tmp_path_factory.mktemp("config")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder))
    return folder
