from __future__ import annotations

from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def targets_found_by_children(monkeypatch: pytest.MonkeyPatch) -> None:
    """The processes beside the loop import `beside_targets`."""
    monkeypatch.setenv("PYTHONPATH", f"{HERE.parents[2]}:{HERE}")
