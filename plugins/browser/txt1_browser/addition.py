"""The browser's folder of files as an addition: a command."""

from txt1.additions import Addition

ADDITION = Addition(
    name="browser",
    order=140,
    commands={"browser": ("txt1_browser.command", "make a folder of files that drives robots in a web browser")},
)
