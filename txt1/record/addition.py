"""Recordings and the live view as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="record",
    order=-100,
    settings="txt1.record.settings:RecordConfig",
    on_request=True,
    watch="txt1.record.attached_recorder:watch",
    beside="txt1.record.attached_recorder:beside",
    options="txt1.record.options:OPTIONS",
    sources={"view": 30},
    commands={
        "log": ("txt1.record.command.log", "show, export or recover a recording"),
        "replay": ("txt1.record.command.replay", "show a recording, or run it again and compare"),
        "report": ("txt1.record.command.report", "draw a recording: a picture and an HTML page"),
    },
)
