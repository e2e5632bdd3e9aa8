"""Machine code of functions does what the functions do."""

import pytest

from txt1.sim.machine_code import compiled


def steep(x: float) -> float:
    return 3.0 * x


def over(x: float, least: float = 2.0) -> float:
    return steep(x) - least


@pytest.mark.parametrize("options", [{}, {"cache": True}, {"calls": {"steep": compiled(steep)}}])
def test_a_compiled_function_keeps_the_defaults_of_its_arguments(options: dict[str, object]) -> None:
    made = compiled(over, **({"calls": {"steep": compiled(steep)}} | options))  # type: ignore[arg-type]
    assert made(1.0) == over(1.0) == 1.0 and made(1.0, 0.5) == 2.5
