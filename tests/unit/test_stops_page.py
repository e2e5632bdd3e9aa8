"""The stops that are measured have their rows in docs/safety.md, and can be measured."""

from pathlib import Path

from benchmarks.stops import CASES, results

SAFETY = (Path(__file__).parents[2] / "docs" / "safety.md").read_text().splitlines()


def test_every_measured_row_of_the_safety_page_is_there_once() -> None:
    for row in {case.row for case in CASES if case.row}:
        assert sum(line.startswith(f"| {row}") for line in SAFETY) == 1, row


def test_a_board_whose_signs_of_a_restart_nobody_looks_at_drives_on() -> None:
    blind = next(case for case in CASES if case.about == "A2 with no sign looked at")
    assert any(one.armed for one in results(blind, 4))
