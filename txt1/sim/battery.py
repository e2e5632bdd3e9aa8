"""Two LiPo packs behind diodes, and the cut-off circuit (thesis 3.6)."""

from typing import NamedTuple

from txt1.model.battery import pack_voltage


class Packs(NamedTuple):
    """Minutes under full load that each pack has given; None where no pack is fitted.

    The voltages follow from it, so this is the whole state.
    """

    used_1: float | None = 0.0
    used_2: float | None = None

    def voltages(self) -> tuple[float, float]:
        """Voltages of the two packs, V; 0 where none is fitted."""
        return (
            0.0 if self.used_1 is None else pack_voltage(self.used_1),
            0.0 if self.used_2 is None else pack_voltage(self.used_2),
        )


def discharge(packs: Packs, full_load_s: float) -> Packs:
    """The packs after so many seconds of full load, or of a share of it for longer.

    The diodes draw from the pack with the higher voltage, from both alike when they are equal.
    """
    minutes = full_load_s / 60.0
    one, two = packs
    if one is None and two is None:
        return packs
    if two is None or (one is not None and one < two):
        assert one is not None
        return Packs(one + minutes, two)
    if one is None or two < one:
        return Packs(one, two + minutes)
    return Packs(one + minutes / 2.0, two + minutes / 2.0)
