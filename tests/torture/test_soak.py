"""A robot holds on to no more after a minute of driving, recording and a lossy line than before it."""

from pathlib import Path

import pytest

from torture import soak
from txt1.kernel.loop import run


@pytest.mark.long
def test_nothing_that_a_process_holds_on_to_grows_while_it_drives(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(soak, "EVERY", 6.0)
    samples = run(soak.soak(0.0075, tmp_path), speed="max")
    warm = samples[2:]
    assert len(warm) >= 3
    assert len({(each.descriptors, each.threads) for each in warm}) == 1
    assert warm[-1].objects - warm[0].objects < 200
