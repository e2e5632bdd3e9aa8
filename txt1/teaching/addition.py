"""Teaching as an addition: a policy as a source of commands, and the command that makes a policy from recordings."""

from txt1.additions import Addition

ADDITION = Addition(
    name="teaching",
    order=210,
    beside="txt1.teaching.policy_driver:beside",
    options="txt1.teaching.options:OPTIONS",
    sources={"policy": 5},
    parts={"txt1.exporters": {"tub": "txt1.teaching.tubs:export"}},
    commands={"teach": ("txt1.teaching.command", "teach a policy from recordings of your driving")},
)
