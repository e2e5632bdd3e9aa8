"""The findings of `txt1 doctor`."""

from typing import NamedTuple


class Finding(NamedTuple):
    """A line of the doctor's: subject, finding, and whether all is well; if not, the finding contains the cause."""

    subject: str
    text: str
    well: bool = True

    def show(self) -> bool:
        """Print it and return whether it is well."""
        print(f"{' ' if self.well else '!'} {self.subject:<9} {self.text}")
        return self.well


def judged(subject: str, text: str, well: bool, cause: str) -> Finding:
    """Return a finding, with the cause unless all is well."""
    return Finding(subject, text if well else f"{text}: {cause}", well)
