"""What `txt1 doctor` says."""

from typing import NamedTuple


class Remark(NamedTuple):
    """A line of the doctor's: the subject, the finding, and whether that is well; if not, the finding says why."""

    subject: str
    text: str
    well: bool = True

    def show(self) -> bool:
        """Print it and return whether it is well."""
        print(f"{' ' if self.well else '!'} {self.subject:<9} {self.text}")
        return self.well


def judged(subject: str, text: str, well: bool, cause: str) -> Remark:
    """A remark, with the cause where it is not well."""
    return Remark(subject, text if well else f"{text}: {cause}", well)
