"""The virtual board as an addition: a port with a board behind it, and the command."""

from txt1.additions import Addition

ADDITION = Addition(
    name="board",
    settings="txt1.board.settings:BoardConfig",
    parts={"txt1.ports": {"virtual": "txt1.board.board:VirtualPort"}},
    commands={
        "board": (
            "txt1.board.command",
            "start a virtual board for a host, with a simulated vehicle behind it",
        )
    },
)
