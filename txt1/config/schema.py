"""All settings, with their constraints and defaults."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict
from functools import cache
from hashlib import blake2b
from itertools import pairwise
from math import inf
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple, Self, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from txt1 import additions
from txt1.control.hand import DEFAULT_HAND, Hand
from txt1.control.parameters import KnownCar, Limits, Safety, SpeedMap
from txt1.control.pid import Gains
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, SETS_MAX, GainSet, Schedule
from txt1.model.channels import Channels
from txt1.model.light_sensors import EVEN, MOUNT, SOUND, Mount, SensorFault
from txt1.model.vehicle import Geometry
from txt1.protocol.messages import PidSet
from txt1.sim.parameters import Batteries, Box, Faults, LineFaults, Mover, Noise, Post, Roughness, VehicleParameters
from txt1.sim.room import Room
from txt1.units import NotNegative, Positive, PositiveInt

GainOnWire = Annotated[float, Field(ge=-2147483.648, le=2147483.647)]
"""A PID set carries thousandths in 32 bits (thesis 3.5)."""


class Section(BaseModel):
    """A part of the configuration: immutable, and strict about its keys.

    Some sections are dataclasses, defined beside the code that uses them; the same rules apply to them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Brought(NamedTuple):
    """The keys that others bring to a section: additions to the configuration, learners to `learning`."""

    # entry points by which packages bring them
    group: str
    # () -> the names of all that are installed
    names: Callable[[], Collection[str]]
    # name -> the type of a key's value, None if it is not installed
    kind: Callable[[str], Any]


class OpenSection(Section):
    """A section that has keys of others, each read by who brings it (`brought`).

    A recording keeps a key that nothing installed reads.
    """

    model_config = ConfigDict(extra="allow")
    brought: ClassVar[Brought]
    """Where its other keys come from."""

    @property
    def given(self) -> Collection[str]:
        """The names of others' keys that are given."""
        return (self.__pydantic_extra__ or {}).keys()

    @model_validator(mode="before")
    @classmethod
    def _read_brought(cls, given: Any, info: ValidationInfo) -> Any:
        """Let others' own classes read their keys."""
        if not isinstance(given, Mapping):
            return given
        return {
            key: value if key in cls.model_fields else _read(cls.brought, key, value, info.context)
            for key, value in given.items()
        }


def _read(brought: Brought, name: str, value: Any, context: Any) -> Any:
    """Return the value of a key that others bring."""
    if (kind := brought.kind(name)) is not None:
        return _reader(kind).validate_python({name: value}, context=context)[name]
    if (context or {}).get("recorded"):
        return value
    raise ValidationError.from_exception_data(
        "Config", [{"type": PydanticCustomError("extra_forbidden", "unknown key"), "loc": (name,), "input": value}]
    )


@cache
def _reader(kind: Any) -> TypeAdapter[Any]:
    """Return the reader of values of this type; they are nested below their names, which errors then contain."""
    return TypeAdapter(dict[str, kind], config=ConfigDict(extra="forbid", allow_inf_nan=False))


class GainsConfig(Section):
    """PID gains, PWM counts per mm/s (linear) or mrad/s (angular) of error."""

    kp: GainOnWire
    """Proportional gain."""
    ki: GainOnWire
    """Integral gain, 1/s."""
    kd: GainOnWire
    """Derivative gain, s."""

    def gains(self) -> Gains:
        """Return the gains as a plain value."""
        return Gains(self.kp, self.ki, self.kd)


class GainSetConfig(GainsConfig):
    """Angular gains up to a speed."""

    v_max: GainOnWire
    """The set is in force up to this measured speed, m/s."""


class LoopsConfig(Section):
    """The velocity loops."""

    linear: GainsConfig = GainsConfig(**LINEAR_GAINS._asdict())
    """Gains of the speed loop (thesis 4.2)."""
    angular: Annotated[tuple[GainSetConfig, ...], Field(max_length=SETS_MAX)] = tuple(
        GainSetConfig(v_max=s.v_max, **s.gains._asdict()) for s in ANGULAR_GAINS
    )
    """Gains of the yaw-rate loop by speed, v_max rising (thesis table 4.1)."""

    @field_validator("angular")
    @classmethod
    def _v_max_rises(cls, angular: tuple[GainSetConfig, ...]) -> tuple[GainSetConfig, ...]:
        # raises an error if not
        Schedule(tuple(GainSet(s.v_max, s.gains()) for s in angular))
        return angular

    def pid_set(self) -> PidSet:
        """Return the message that loads the gains."""
        return PidSet(self.linear.gains(), tuple((s.v_max, s.kp, s.ki, s.kd) for s in self.angular))

    def schedule(self) -> Schedule:
        """Return the angular gains as a schedule."""
        return Schedule(tuple(GainSet(s.v_max, s.gains()) for s in self.angular))


class ControlConfig(LoopsConfig):
    """The velocity loops, and the speed map that replaces them in a vehicle without encoders."""

    speed_map: SpeedMap = ()
    """Motor counts and their speeds, m/s, rising: they drive a vehicle without encoders (txt1 calibrate)."""

    @field_validator("speed_map")
    @classmethod
    def _speeds_rise(cls, speed_map: SpeedMap) -> SpeedMap:
        for (u0, v0), (u1, v1) in pairwise(speed_map):
            if not (u0 < u1 and v0 < v1):
                raise ValueError(f"counts and speeds must rise: ({u1:g}, {v1:g}) follows ({u0:g}, {v0:g})")
        if any(u * v <= 0.0 for u, v in speed_map):
            raise ValueError("counts and speed of an entry have the same sign, and neither is 0")
        return speed_map


class RoomConfig(Section):
    """The simulated room: a rectangle around the origin, or a map."""

    map: str | None = None
    """The map of its walls: a name in config/maps, or your own .yaml for map_server; null: the rectangle."""

    length: Annotated[float, Field(gt=0.0, allow_inf_nan=True)] = 5.0
    """Length along x, m; .inf: no walls."""
    width: Annotated[float, Field(gt=0.0, allow_inf_nan=True)] = 5.0
    """Width along y, m; .inf: no walls."""
    light: tuple[float, float] = (0.0, 0.0)
    """Place of the light, x and y in m."""

    @model_validator(mode="before")
    @classmethod
    def _map_has_all_walls(cls, given: Any) -> Any:
        if not isinstance(given, Mapping) or given.get("map") is None:
            return given
        if {given.get("length", 5.0), given.get("width", 5.0)} - {5.0, inf}:
            raise ValueError("length, width: the walls are those of the map; take out length and width, or map")
        return {**given, "length": inf, "width": inf}

    def built(self) -> Room:
        """Return the room. Raises ConfigError: its map cannot be read; MissingExtra: its map is a PNG."""
        if self.map is None:
            return Room(self.length, self.width)
        from txt1.sim.walls import walls_of

        return Room(walls=walls_of(self.map))


class LightConfig(Section):
    """The simulated light and the four sensors that see it; sim.room.light is its place."""

    intensity: Positive = 135.0
    """Lux at 1 m: a 100 W lamp; assumed."""
    exponent: Literal[2, 4] = 2
    """The light falls as 1 / d^exponent: 2 by the thesis's text, 4 by its equation (5.9)."""
    height: NotNegative = 0.0
    """Height of the light above the sensors' plane, m."""
    noise: NotNegative | None = None
    """Noise of a reading, as a share of it; null: enough for the thesis's jitter of the direction, 45 degrees."""
    mount: Mount = MOUNT
    """Places of the four sensors, in the order of their readings: (forward, left) of the robot's centre, m."""
    gains: tuple[Positive, Positive, Positive, Positive] = EVEN
    """Factors on the readings: a dirty sensor reads less."""
    faults: tuple[SensorFault, SensorFault, SensorFault, SensorFault] = SOUND
    """Fault of each sensor: none, dead, nan, frozen."""
    true_bearing: bool = False
    """The learner gets the light's true bearing in place of the four sensors, as in the original simulation."""


class SimConfig(Section):
    """The simulated world."""

    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Start pose in the room: x and y in m, theta in rad."""
    room: RoomConfig = RoomConfig()
    obstacles: tuple[Annotated[Box | Post, Field(discriminator="kind")], ...] = ()
    """Boxes and posts in the room."""
    physics: Annotated[str, Field(min_length=1)] = "plain"
    """Physics of the vehicle: plain is txt1's own; a plug-in has others' (docs/physics.md)."""
    movers: tuple[Mover, ...] = ()
    """Boxes that move along paths."""
    vehicle: VehicleParameters = VehicleParameters()
    battery: Batteries = Batteries()
    noise: Noise = Noise()
    faults: Faults = Faults()
    channels: Channels = Channels()
    """Wiring of the simulated vehicle; calibration finds the `channels` that correct it."""
    light: LightConfig = LightConfig()
    ground: Roughness = Roughness()


class SerialConfig(Section):
    """The line to a real board (hal: serial)."""

    port: Annotated[str, Field(min_length=1)] | None = None
    """Device, socket://host:port, or virtual (a board in this process); null: the only serial port."""
    baud: PositiveInt = 57600
    """Bits a second, 8N1."""
    transport: Literal["pyserial-asyncio", "serialx"] = "pyserial-asyncio"
    """Library that serves the device: pyserial-asyncio, or serialx where it is installed."""
    secret_file: str | None = None
    """File with the secret of a board on a network (socket://), such as a Pico W; null: no secret."""
    control: Literal["board", "host"] = "board"
    """Place of the velocity loops: board or host. "host" is experimental, and the board has to be in manual mode."""
    allow_host: bool = False
    """Allows arming with control: host, and PWM by hand. An original board in manual mode keeps its last PWM when this
    host dies."""
    host: LoopsConfig = LoopsConfig(
        linear=GainsConfig(kp=2.0, ki=6.0, kd=0.0),
        angular=(
            GainSetConfig(v_max=-0.15, kp=0.5, ki=15.0, kd=0.0),
            GainSetConfig(v_max=0.15, kp=1.0, ki=30.0, kd=0.0),
            GainSetConfig(v_max=1.5, kp=0.5, ki=15.0, kd=0.0),
        ),
    )
    """Gains of the velocity loops in this program, behind a line, at 20 Hz (control: host); chosen in simulation."""
    rearm: bool = False
    """Arm again by itself when a lost board is back."""
    fault: LineFaults = LineFaults()


class OdometryConfig(Section):
    """The odometry that a board sends."""

    scale: Positive = 1.0
    """Factor on its lengths and angles: 1.067 corrects original boards, which read 6.3 % low."""


class CommanderConfig(Section):
    """The sources of commands."""

    timeouts: dict[str, Positive] = {}
    """Age at which the commands of a source are stale, s, by its name; at most safety.command_timeout, the default."""
    priorities: dict[str, int] = {}
    """Priority of a source by its name; left out: keys 50, gamepad 40, web 30, ros 20, any other 10."""


class TeleopConfig(Section):
    """Driving from the keyboard."""

    speed: Annotated[float, Field(ge=0.1, le=10.0)] = 0.5
    """Speed at the start, m/s; + and - change it, up to safety.v_max."""
    turn: Annotated[float, Field(gt=0.0, le=1.0)] = DEFAULT_HAND.turn
    """Share of the largest yaw rate for the keys a and d."""


class SensorConfig(Section):
    """A sensor that is not part of the hardware layer, under a name of your choice."""

    driver: Annotated[str, Field(min_length=1)]
    """Name of its driver: sim_light, phidgets_light, or a driver from another package."""
    period: Positive | None = None
    """Seconds between two readings; null: the driver's own."""
    delay: NotNegative = 0.0
    """Delay of each reading, s."""
    drop_out: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Share of the readings that are lost."""
    options: dict[str, Any] = {}
    """Settings of its driver, passed on unchanged."""


SensorName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


class HostConfig(Section):
    """The computer that runs the program."""

    allow_shutdown: bool = False
    """Whether Robot.shutdown_host may power it down."""


S = TypeVar("S")

RECORDED: Final = {"recorded": True}
"""pydantic's context for the configuration of a recording: the sections of additions that are not installed are kept
unread.
"""


class Config(OpenSection):
    """All settings: the spine's sections, and the sections of additions that are given."""

    brought = Brought(additions.GROUP, additions.sections, additions.settings_of)

    hal: Annotated[str, Field(min_length=1)] = "sim"
    """Name of the hardware layer."""
    hal_options: dict[str, Any] = {}
    """Settings of the hardware layer, passed on unchanged."""
    name: Annotated[str, Field(pattern="^([a-z][a-z0-9_]*)?$")] = ""
    """Name of the robot, before the names of its topics; empty for a single robot."""
    vehicle: Annotated[str, Field(min_length=1)] = "txt1"
    """Kind of vehicle: txt1, a file in config/vehicles/, or your own file (.yaml) with the differences."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Repeats every random value of a simulation."""
    calibrated: tuple[str, ...] = ()
    """Steps of `txt1 calibrate` whose results are among the values."""
    geometry: Geometry = Geometry()
    channels: Channels = Channels()
    control: ControlConfig = ControlConfig()
    car: KnownCar = KnownCar()
    safety: Safety = Safety()
    sim: SimConfig = SimConfig()
    serial: SerialConfig = SerialConfig()
    odometry: OdometryConfig = OdometryConfig()
    commander: CommanderConfig = CommanderConfig()
    teleop: TeleopConfig = TeleopConfig()
    sensors: dict[SensorName, SensorConfig] = {}
    """Sensors that are not part of the hardware layer, by name."""
    host: HostConfig = HostConfig()

    def section(self, kind: type[S]) -> S:
        """Return the section of an addition; its defaults if it is not given."""
        found = [each for each in (self.__pydantic_extra__ or {}).values() if type(each) is kind]
        return found[0] if found else kind()

    @property
    def own_seed(self) -> int:
        """The seed of this robot's random values: it differs between robots of different names with the same `seed`."""
        if not self.name:
            return self.seed
        return int.from_bytes(blake2b(f"{self.seed} {self.name}".encode(), digest_size=8).digest())

    @field_validator("car")
    @classmethod
    def _is_one_that_steers(cls, car: KnownCar, info: ValidationInfo) -> KnownCar:
        if car.known and "geometry" in info.data and info.data["geometry"].steering == "skid":
            raise ValueError("known: the loops can know a car that steers, not sides that run at two speeds; use false")
        return car

    @field_validator("commander")
    @classmethod
    def _no_longer_than_the_gates(cls, commander: CommanderConfig, info: ValidationInfo) -> CommanderConfig:
        limit = info.data["safety"].command_timeout if "safety" in info.data else inf
        for name, timeout in commander.timeouts.items():
            if timeout > limit:
                raise ValueError(f"timeouts.{name}: {timeout:g} s; use at most safety.command_timeout, {limit:g} s")
        return commander

    @model_validator(mode="after")
    def _gains_suit_the_vehicle(self, info: ValidationInfo) -> Self:
        """Refuse gains beyond the vehicle's limits. A recording keeps the gains that it was driven with."""
        if (info.context or {"gains": True}).get("gains"):
            # the defaults suit any vehicle, so a plain robot does not load the module
            for key, loops, usual in (
                ("control", self.control, ControlConfig()),
                ("serial.host", self.serial.host, SerialConfig().host),
            ):
                if loops != usual and (
                    wrong := self.gain_limits(loops).refused(loops.linear.gains(), loops.schedule().sets)
                ):
                    refusal: InitErrorDetails = {
                        "type": PydanticCustomError("gain", "{remedy}", {"remedy": wrong[2]}),
                        "loc": tuple(f"{key}.{wrong[0]}".split(".")),
                        "input": wrong[1],
                    }
                    raise ValidationError.from_exception_data("Config", [refusal])
        return self

    def gain_limits(self, loops: LoopsConfig | None = None) -> Any:
        """Return the `GainLimits` of these loops, by default of `loops()`: at 20 Hz behind a line, else at 50 Hz."""
        from txt1.control.gains import gain_limits

        car, period = self.sim.vehicle, 0.05 if (loops or self.loops()) is self.serial.host else 0.02
        return gain_limits(self.geometry, car.speed_gain, car.speed_time_constant, car.skid, period)

    def loops(self) -> LoopsConfig:
        """The gains to load: the gains at 50 Hz wherever the loops run at 50 Hz, else the gains for loops behind a
        line.
        """
        return self.serial.host if self.hal == "serial" and self.serial.control == "host" else self.control

    def limits(self) -> Limits:
        """The safety gate's limits."""
        return Limits(
            **asdict(self.safety), radius_min=0.0 if self.geometry.steering == "skid" else self.geometry.radius_min
        )

    def hand(self) -> Hand:
        """The limits of keys, gamepads and pages on this car."""
        body, pivots = self.geometry, self.geometry.steering == "skid"
        radius = max(body.radius_min, 0.5 * body.track_width * pivots)
        return Hand(self.safety.v_max, self.safety.omega_max, radius, pivots, self.teleop.turn)
