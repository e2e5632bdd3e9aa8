"""The suites' minutes of silence: of one layer and one sensor in each run, of all others in `make test-long`."""

import pytest

MINUTE = (
    "test_a_device_that_is_silent_for_a_minute_is_found_again",
    "test_a_device_that_is_silent_for_a_minute_reads_on",
    "test_a_chip_that_is_silent_for_a_minute_is_told_and_reads_on",
)
USUAL = ("TestSerial", "TestImu")
# an RPLIDAR answers in three forms, by one driver
LONG = ("TestRplidarUltra",)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if not isinstance(item, pytest.Function) or item.cls is None:
            continue
        suite = item.cls.__name__
        if suite in LONG or (item.originalname in MINUTE and suite not in USUAL):
            item.add_marker(pytest.mark.long)
