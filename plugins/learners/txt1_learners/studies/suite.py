"""Learners over a suite of worlds: trials side by side, results as files, and a table learner x world.

    DIR/LEARNER/WORLD.json    raw: each episode's start, time, success, optimum and floor, and where it came from
    DIR/table.md              learner x world: success and ratios after the 7th episode
    DIR/LEARNER/WORLD.k.part  trials that are done already, while others are on

How it goes: `run_all` lists what no file holds yet, by pair and block of trials; the runner of trials does it, and a
block becomes a part as it comes. A pair whose blocks are all there becomes its file. The floor of each episode's world
is computed beside the trials, once for each world that a process meets; a world that drifts has one for each stage.

All learners are asked for the goal ten times a second.

Worlds are those of `txt1_learners.worlds`, or files of a directory; four more are drawn from `RANGES` by a seed.
One that is wrong, that cannot be solved, or whose class raises (`txt1.learning.world`) is told in the table, and the
others go on.

Floors know where the light goes, and how a world changes commands. They know no obstacles: the ratio is to the floor
without them, and the result says so (`floor_leaves_out`).
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.commands import FAULT, OK
from txt1.config import Config, completed, load
from txt1.config.sources import with_values
from txt1.errors import ConfigError, LightFault, Txt1Error
from txt1.learning.best_time import DECISION_MS, Floor, known_floor
from txt1.learning.experiment import LEARNED
from txt1.learning.qtable import replace_file
from txt1.learning.registry import make
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import Episode
from txt1.learning.world import settled, world_of
from txt1.learning.world_presets import content
from txt1.trials.provenance import provenance
from txt1_learners.settings import Drift
from txt1_learners.studies.floor import MovingFloor, floor_of
from txt1_learners.studies.lockstep import REST_MS, asked_alike, trials, world_at
from txt1_learners.studies.modelled_settings import lasers
from txt1_learners.worlds import groups

FORMAT: Final = "txt1 world result"
DRAWN: Final = 4  # worlds drawn by a seed
STAGES: Final = 4  # floors are computed for so many stages of a world that drifts
BLOCK: Final = 100  # trials that are done side by side, by one processor, and kept when all is ended and carried on
TOUCHED: Final = 7  # the column that tells whether it ended by touching something
UNFIT: Final = 6  # the column that tells when the learner said that its model does not fit, s
SLOW: Final = 1.5  # ratio to the floor from which an episode is slow, as one that fails is
SOON: Final = 5.0  # s within which the learner should say that its model does not fit
RESAMPLES: Final = 1000  # of the trials, for an interval of 95 %
BACK: Final = 1.1  # ratio to the floor at which a learner has come back after a change

RANGES: Final = {
    "speed": (0.1, 0.6),  # m/s
    "radius": (0.56, 0.9),  # of the turns to either side, m
    "start": (0.9, 2.5),  # m
    "goal": (0.35, 0.6),  # m
    "noise": (0.0, 0.5),  # of a reading, as a share
    "gain": (0.6, 1.4),  # of each sensor
    "slip": (0.0, 0.15),
    "drag": (0.0, 0.1),  # noise of the floor's drag, as a share of the speed
    "delay": (0.0, 0.3),  # s, in steps of 0.1
    "plate": (0.6, 1.3),  # of the sensors' plate, which is turned by any angle, beside the usual
}


Each = Callable[[Callable[[Any], Any], Mapping[Any, Any], Callable[[Any, Any], None]], int]


class SuiteWorld(NamedTuple):
    """A world by name."""

    name: str
    config: Config
    wrong: str = ""  # why its file cannot be used


def worlds(place: str, overrides: Sequence[str], names: Iterable[str] = ()) -> list[SuiteWorld]:
    """The worlds of a group (`txt1_learners.worlds`) or of a directory, or some of them.

    Raises ConfigError: there is no such group, directory or world.
    """
    there: Mapping[str, Path | Mapping[str, Any]]
    if place in groups():
        there = {name: content(one) for name, one in groups()[place].items()}
    else:
        there = {path.stem: path for path in sorted(Path(place).glob("*.yaml"))}
    wanted = list(names) or list(there)
    if not wanted:
        raise ConfigError(f"{place}: no *.yaml there; give {' or '.join(groups())}, or a directory with worlds")
    for name in wanted:
        if name not in there:
            raise ConfigError(f"--world: no {name} in {place}; there are {', '.join(there)}")
    load(None, overrides)  # what is wrong there is wrong in every world
    return [_world(name, there[name], overrides) for name in wanted]


def _world(name: str, file: Path | Mapping[str, Any], overrides: Sequence[str]) -> SuiteWorld:
    try:
        return SuiteWorld(name, load(file, overrides).config)
    except ConfigError as error:
        return SuiteWorld(name, Config(), str(error))


def drawn(config: Config, seed: int) -> list[SuiteWorld]:
    """Worlds drawn at random from `RANGES`."""
    found = []
    for number in range(DRAWN):
        rng = np.random.default_rng([seed, number])
        one = {name: float(rng.uniform(*each)) for name, each in RANGES.items() if name != "gain"}
        v, order, turned = one["speed"], rng.permutation(4), float(rng.uniform(-np.pi, np.pi))
        left, right = (v / float(rng.uniform(*RANGES["radius"])) for _ in range(2))
        c, s = one["plate"] * np.cos(turned), one["plate"] * np.sin(turned)
        places = [config.sim.light.mount[k] for k in order]
        values = {
            "learning.actions": [[v, -right], [v, 0.0], [v, left]],
            "learning.start_radius": one["start"],
            "learning.goal_radius": one["goal"],
            "learning.delay": round(one["delay"], 1),
            "sim.light.noise": one["noise"],
            "sim.light.gains": rng.uniform(*RANGES["gain"], 4).tolist(),
            "sim.light.mount": [[c * x - s * y, s * x + c * y] for x, y in places],
            "sim.vehicle.slip": one["slip"],
            "sim.noise.drag": one["drag"],
        }
        found.append(SuiteWorld(f"drawn-{seed}-{number + 1}", with_values(config, values)))
    return found


def floors(config: Config, episodes: int) -> list[Floor | MovingFloor]:
    """The floor of each episode's world."""
    return [_floor_at(config, episode, episodes) for episode in range(1, episodes + 1)]


def _floor_at(config: Config, episode: int, episodes: int) -> Floor | MovingFloor:
    stage = _stage(config, episode, episodes)
    if (world := world_of(world_at(config, episode, episodes), np.random.default_rng(0))) is not None:
        world.begin(episode)
        rest, times = 0.001 * REST_MS, np.arange(0.0, 60.0, 0.1).tolist()
        moves = any(world.goal(now) != stage.sim.room.light for now in times)
        some = stage.section(LearningConfig).actions
        changes = any(world.command(rest + now, each) != each for now in times for each in some)
        if moves or changes:
            reaching = (
                (lambda decision, each: world.command(rest + 0.001 * DECISION_MS * decision, each)) if changes else None
            )
            return MovingFloor(stage, lambda since: world.goal(rest + since), reaching)
    return _floor(stage.model_dump_json())


@cache
def _floor(config: str) -> Floor:
    world = Config.model_validate_json(config)
    return known_floor(world) or floor_of(world)


def _stage(config: Config, episode: int, episodes: int) -> Config:
    """The world of an episode; one that drifts in a few stages, each as it is in its middle."""
    if config.section(LearningConfig).part("drift", Drift()):
        length = -(-episodes // STAGES)
        episode = min(episodes, (episode - 1) // length * length + (length + 1) // 2)
    plain = world_at(config, episode, episodes)
    known = plain.section(LearningConfig).model_dump(exclude={"drift", "changes", "world", "world_options"})
    own = LearningConfig.model_validate(known)
    room = plain.sim.room.model_copy(update={"map": None})
    sim = plain.sim.model_copy(update={"obstacles": (), "room": room})
    sensors = {name: one for name, one in plain.sensors.items() if name not in lasers(plain)}
    return plain.model_copy(update={"learning": own, "sim": sim, "sensors": sensors})


def leaves_out(config: Config) -> list[str]:
    """The settings that a world's floor knows nothing of."""
    sim = config.sim
    there = {
        "sim.obstacles": sim.obstacles,
        "sim.room.map": sim.room.map,
    }
    return [key for key, value in there.items() if value]


def run(world: SuiteWorld, agent: str, first: int, count: int, episodes: int, seed: int) -> dict[str, Any]:
    """The raw result of a learner in a world, of so many trials from number `first` on: JSON values.

    Raises Txt1Error: the world cannot be had, or fails.
    """
    config = asked_alike(settled(world.config))
    refused = None
    try:
        every = trials(config, lambda rng: make(agent, config, rng), range(first, first + count), episodes, seed)
    except LightFault as fault:
        every, refused = [], str(fault)
    floor = floors(config, episodes)
    results = [[_row(*pair) for pair in zip(trial.episodes, floor, strict=True)] for trial in every]
    return {
        "format": FORMAT,
        "world": world.name,
        "agent": agent,
        "seed": seed,
        "trials": count,
        "episodes": episodes,
        "provenance": provenance(),
        "config": completed(config).model_dump(mode="json", exclude={"seed"}),
        "floor_exists": all(each.exists for each in floor),
        "refused": refused,  # why the learner does not believe these sensors, and the trials were broken off
        "floor_leaves_out": leaves_out(config),
        "floor_gap": max(each.gap for each in floor),
        "columns": [
            "bearing_rad",
            "heading_rad",
            "time_s",
            "success",
            "optimal_time_s",
            "floor_s",
            "unfit_s",
            "touched",
        ],
        "results": results,
    }


def _row(one: Episode, floor: Floor | MovingFloor) -> list[float | None]:
    values = (*one.start, one.time, one.success, one.optimal_time, floor.time(one.start))
    return [*(round(float(value), 6) for value in values), one.unfit, int(one.touched)]


def run_told(told: Sequence[Any]) -> dict[str, Any]:
    """As `run`: its arguments, and its result, as JSON values; of a world that fails, what it was told by."""
    name, config, agent, *rest = told
    try:
        return run(SuiteWorld(name, Config.model_validate(config)), agent, *rest)
    except Txt1Error as error:
        return {"agent": agent, "world": name, "wrong": str(error)}


def run_all(
    some: Sequence[SuiteWorld],
    agents: Sequence[str],
    count: int,
    episodes: int,
    seed: int,
    out: Path,
    each: Each,
    resume: bool,
    tell: Callable[[dict[str, Any]], None],
) -> tuple[list[dict[str, Any]], int]:
    """Do all learners in all worlds, write a file for each pair and the table; `tell` hears of each that is done.

    `each` is `txt1.trials.run.run` with its workers; its exit code comes with the results.
    """
    sizes = [min(BLOCK, count - done) for done in range(0, count, BLOCK)]
    results: list[dict[str, Any]] = []
    wrong: dict[tuple[str, str], dict[str, Any]] = {}
    blocks: dict[Path, dict[int, dict[str, Any]]] = {}
    missing: dict[tuple[Path, int], list[Any]] = {}
    for agent in agents:
        for world in some:
            if world.wrong:
                wrong[agent, world.name] = {"agent": agent, "world": world.name, "wrong": world.wrong}
                tell(wrong[agent, world.name])
                continue
            path = out / agent / f"{world.name}.json"
            if path.exists():
                results.append(_before(path, count, episodes, seed, resume))
                continue
            blocks[path] = {}
            for k, size in enumerate(sizes):
                if _part(path, k).exists():
                    blocks[path][k] = _before(_part(path, k), size, episodes, seed, resume)
                    continue
                config = world.config.model_dump(mode="json")
                missing[path, k] = [world.name, config, agent, 1 + k * BLOCK, size, episodes, seed]
            if len(blocks[path]) == len(sizes):  # more trials were asked for before, and ended
                results.append(_joined(path, blocks[path]))
    out.mkdir(parents=True, exist_ok=True)

    def keep(place: tuple[Path, int], block: dict[str, Any]) -> None:
        path, k = place
        if "wrong" in block:
            if (agent_and_world := (block["agent"], block["world"])) not in wrong:
                wrong[agent_and_world] = block
                tell(block)
            return
        path.parent.mkdir(exist_ok=True)
        blocks[path][k] = block
        if len(blocks[path]) < len(sizes):
            replace_file(_part(path, k), json.dumps(block) + "\n")
            return
        results.append(_joined(path, blocks[path]))
        tell(results[-1])

    code = each(run_told, missing, keep) or (FAULT if wrong else OK)
    results += wrong.values()
    places = [(agent, world.name) for agent in agents for world in some]
    results.sort(key=lambda one: places.index((one["agent"], one["world"])))
    replace_file(out / "table.md", table(results))
    return results, code


def _part(path: Path, k: int) -> Path:
    """The file of a block of trials, from 0, until all of them are done."""
    return path.with_suffix(f".{k}.part")


def _before(path: Path, count: int, episodes: int, seed: int, resume: bool) -> dict[str, Any]:
    """A result that is there already; ConfigError: it is not to be carried on, or is of something else."""
    if not resume:
        raise ConfigError(f"--out: holds {path} already; --resume carries on, or give another")
    try:
        before: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        code, asked = before["provenance"]["code"], (before["trials"], before["episodes"], before["seed"])
    except (ValueError, KeyError, TypeError):
        raise ConfigError(f"--resume: {path} is no result of this program; delete it, and it is done again") from None
    if code != provenance()["code"]:
        raise ConfigError(f"--resume: {path} came from other code; give another directory")
    if asked != (count, episodes, seed):
        raise ConfigError(f"--resume: {path} has other trials, episodes or seed; give another directory")
    return before


def _joined(path: Path, by_number: Mapping[int, dict[str, Any]]) -> dict[str, Any]:
    """The result of all trials, of those of its blocks in their order; it is kept in their place."""
    blocks = [by_number[k] for k in sorted(by_number)]
    refused = next((one["refused"] for one in blocks if one["refused"]), None)
    rows = [] if refused else [row for one in blocks for row in one["results"]]
    result = {**blocks[0], "trials": sum(one["trials"] for one in blocks), "refused": refused, "results": rows}
    replace_file(path, json.dumps(result) + "\n")
    for k in by_number:
        _part(path, k).unlink(missing_ok=True)
    return result


# -- figures --------------------------------------------------------------------------------------------------------


def figures(result: dict[str, Any]) -> dict[str, Any]:
    """What a result amounts to. Failures are counted apart: no time of theirs is in a ratio."""
    if "wrong" in result:
        return {"wrong": result["wrong"]}
    if result.get("refused"):
        return {"refused": result["refused"]}
    data = np.array(result["results"], float)  # (trials, episodes, 6)
    late = data[:, min(LEARNED, data.shape[1] - 1) :]
    won = late[..., 3] == 1.0
    rng = np.random.default_rng(0)
    found: dict[str, Any] = {
        "episodes": int(won.size),
        "failures": int((~won).sum()),
        "success": float(won.mean()),
        "failures_before": int((data[:, :LEARNED, 3] == 0.0).sum()),
    }
    for name, column in (("to_floor", 5), ("to_optimum", 4)):
        found[name] = _ratio(late, won, column)
        again = [rng.integers(0, len(late), len(late)) for _ in range(RESAMPLES if len(late) > 1 else 0)]
        spread = [ratio for k in again if isfinite(ratio := _ratio(late[k], won[k], column))]
        found[f"{name}_95"] = [float(x) for x in np.percentile(spread, (2.5, 97.5))] if spread else None
    curve = [_ratio(data[:, k : k + 1], data[:, k : k + 1, 3] == 1.0, 5) for k in range(data.shape[1])]
    found["to_floor_at_episode"] = curve
    found["time_s"] = float(late[..., 2][won].mean()) if won.any() else None
    if data.shape[-1] > TOUCHED:
        found["contacts"] = int(data[..., TOUCHED].sum())
    found["leaves_out"] = result.get("floor_leaves_out", [])
    if data.shape[-1] > UNFIT:
        unfit = data[..., UNFIT][np.isfinite(data[..., UNFIT])]
        found["unfit"] = (len(unfit), int(data[..., 3].size), float(np.median(unfit)) if len(unfit) else None)
        slow = ~won | (late[..., 2] > SLOW * late[..., 5])
        found["slow"] = int(slow.sum()), int((slow & (late[..., UNFIT] <= SOON)).sum())
    second = data[:, 1:2]
    found["to_optimum_at_2"] = _ratio(second, second[..., 3] == 1.0, 4)
    for change in result["config"]["learning"].get("changes", ()):
        if change["episode"] > len(curve):
            continue
        after = curve[change["episode"] - 1 :]
        found["back_after"] = next((k for k in range(len(after)) if max(after[k:]) <= BACK), None)
        first = data[:, change["episode"] - 1]
        found["failures_at_change"] = int((first[:, 3] == 0.0).sum())
    return found


def _ratio(data: NDArray[np.float64], won: NDArray[np.bool_], column: int) -> float:
    """Times over least times, of successes with a least time; NaN without any."""
    won = won & np.isfinite(data[..., column])
    least = float(data[..., column][won].sum())
    return float(data[..., 2][won].sum()) / least if least else float("nan")


def table(results: Sequence[dict[str, Any]]) -> str:
    """A table learner x world in Markdown: success after the 7th episode, and the ratio of successes to the floor."""
    agents = list(dict.fromkeys(one["agent"] for one in results))
    names = list(dict.fromkeys(one["world"] for one in results))
    by = {(one["agent"], one["world"]): figures(one) for one in results}
    lines = ["| world | " + " | ".join(agents) + " |", "|---" * (len(agents) + 1) + "|"]
    for name in names:
        cells = [cell(by[agent, name]) if (agent, name) in by else "-" for agent in agents]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    head = f"Success after episode {LEARNED}; ratio of successes to the floor, with its interval of 95 % over trials"
    head += "; ratio to the geometric optimum."
    for told in dict.fromkeys(_told(one) for one in results if "wrong" not in one):
        head += f" {told}."
    return head + "\n\n" + "\n".join(lines) + "\n"


def _told(one: dict[str, Any]) -> str:
    """How many trials of which code a result is of."""
    return f"{one['trials']} trials of {one['episodes']} episodes, seed {one['seed']}, code {one['provenance']['code']}"


def cell(one: dict[str, Any]) -> str:
    """A learner in a world, in a few words."""
    if "wrong" in one:
        return f"wrong: {one['wrong']}".replace("|", "/")
    if "refused" in one:
        return "refuses the sensors"
    if not one["success"]:
        return f"0.00 % of {one['episodes']}"
    low, high = one["to_floor_95"] or (float("nan"),) * 2
    text = f"{100.0 * one['success']:.2f} %, {one['to_floor']:.3f} ({low:.3f} to {high:.3f}), {one['to_optimum']:.3f}"
    text += f"; {one['time_s']:.2f} s"
    said, asked, when = one.get("unfit", (0, 0, None))
    if said:
        text += f"; model does not fit in {said} of {asked} episodes, after {when:.1f} s"
    slow, soon = one.get("slow", (0, 0))
    if slow:
        text += f"; {slow} of {one['episodes']} slow, said in {soon} within {SOON:g} s"
    if one.get("contacts"):
        text += f"; {one['contacts']} contacts"
    if one.get("leaves_out"):
        text += f"; the floor is that without {', '.join(one['leaves_out'])}"
    if "back_after" in one:
        back = one["back_after"]
        text += f"; back after {back} episodes" if back is not None else "; not back"
    return text
