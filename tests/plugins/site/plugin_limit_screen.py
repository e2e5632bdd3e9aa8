"""The screen LIMIT: the speed limit that is in force."""

from plugin_speed_limit import LIMIT
from rich.text import Text

from txt1.telemetry.snapshot import Snapshot
from txt1.ui.viewer import Viewer


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> Text:
    """Draw it."""
    limit = snapshot.get(LIMIT)
    return Text("there is no speed limit" if limit is None else f"at most {limit:g} m/s")
