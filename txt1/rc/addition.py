"""A radio control receiver as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="rc",
    order=100,
    settings="txt1.rc.settings:RcParameters",
    on_request=True,
    beside="txt1.rc.robot_end:beside",
    options="txt1.rc.options:OPTIONS",
    sources={"rc": 60},
)
