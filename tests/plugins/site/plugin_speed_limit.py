"""The parts of the speed limit, imported when they are needed."""

from argparse import Namespace

from txt1.additions import Options
from txt1.config import Config, Section
from txt1.errors import ConfigError
from txt1.runtime import Runtime
from txt1.telemetry.topics import Rule, Topic, declare
from txt1.units import Positive

LIMIT = declare(
    Topic(
        "/speed_limit",
        float,
        "m/s",
        "std_msgs/Float64",
        Rule.SECOND,
        "the speed limit that is in force",
        paths=("data",),
        make=lambda v: (v,),
    )
)


class SpeedLimit(Section):
    """The section ``speed_limit``."""

    v: Positive = 0.3
    """The largest speed, m/s."""


async def prepare(runtime: Runtime, settings: SpeedLimit) -> None:
    """Lower every set-point to the limit."""

    def guard(v: float, omega: float, now: float) -> tuple[float, float]:
        share = min(1.0, settings.v / abs(v)) if v else 1.0
        return v * share, omega * share

    runtime.guard("speed_limit", guard)
    runtime.bus.offer(LIMIT, lambda: settings.v)


def asked(arguments: Namespace, config: Config) -> SpeedLimit | None:
    """The limit that the option asks for."""
    if arguments.speed_limit is None:
        return None
    if arguments.speed_limit > config.safety.v_max:
        raise ConfigError(f"--speed-limit {arguments.speed_limit:g}: the gate's is lower; give less")
    return SpeedLimit(v=arguments.speed_limit)


OPTIONS = Options("speed limit", {"--speed-limit": {"type": float, "metavar": "V", "help": "m/s"}}, asked)
