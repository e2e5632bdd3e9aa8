"""One fault of every kind that strikes processes, in real time."""

import pytest

from torture.processes import FAULTS, strike


@pytest.mark.long
@pytest.mark.parametrize("number", range(len(FAULTS)), ids=[" ".join(fault) for fault in FAULTS])
def test_a_process_that_is_struck_breaks_no_promise(number: int) -> None:
    assert strike(number)["broken"] == ""
