"""Says at the end of a test run how the golden recordings were compared."""

from collections import Counter
from typing import Any


def pytest_terminal_summary(terminalreporter: Any) -> None:
    how = Counter(
        dict(report.user_properties)["compared"]
        for report in terminalreporter.stats.get("passed", ())
        if "compared" in dict(report.user_properties)
    )
    for words, count in how.items():
        terminalreporter.write_line(f"{count} golden recordings: {words}")
