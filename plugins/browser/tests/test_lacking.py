"""What stands in for modules that a browser's Python lacks."""

import pytest

from txt1_browser.lacking import Absent, AtOnce


def test_names_of_an_absent_module_serve_as_types_and_nothing_is_one_of_them() -> None:
    module = Absent("numpy")
    assert not isinstance(1.0, module.ndarray)
    assert module.float64[int] is not None
    assert (module.ndarray | None) is not None


def test_whoever_calls_an_absent_name_is_told_which() -> None:
    with pytest.raises(ImportError, match=r"numpy\.linalg\.norm: it is not to be had in a browser"):
        Absent("numpy").linalg.norm([1.0])


def test_jobs_are_done_when_they_are_submitted() -> None:
    executor = AtOnce(1, "recorder")
    assert executor.submit(max, 1, 2).result(timeout=0) == 2
    assert isinstance(executor.submit(int, "x").exception(timeout=0), ValueError)
