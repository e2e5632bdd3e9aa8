"""Campaigns: seeded runs of a robot that is struck by faults, on the virtual clock, and invariants that have to hold.

A run that breaks one is cut down to the fewest faults that still do; a command that repeats it is printed.
"""

import argparse
import asyncio
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from torture import page
from torture.strikes import KINDS, STRIKES, Strike, plan
from torture.struck_robot import Desk, on_the_desk
from txt1.commands import OK, add
from txt1.kernel import loop
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.trials.provenance import code_hash
from txt1.trials.run import Rows, run
from txt1.trials.workers import OPTIONS, workers_of

OWN: Final = [Path(__file__).with_name(f"{name}.py") for name in ("struck_robot", "strikes", "hands")]
DURATION: Final = 20.0  # s of a run
# whose turn it is: the simulation is the cheapest, the Pico's firmware by far the dearest
PATTERN: Final = (
    *("sim", "ours", "pi", "original", "vesc", "sim", "ours", "pi", "original", "waveshare"),
    *("sim", "ours", "sim", "original", "vesc", "sim", "pi", "sim", "waveshare", "pico"),
)


class Result(NamedTuple):
    """What came out of a run."""

    broken: str  # "" when all invariants held
    cycles: int
    moving: int


def once(kind: str, seed: int, strikes: Sequence[Strike], duration: float = DURATION, physics: str = "plain") -> Result:
    """One run with these faults."""
    told: list[Desk] = []

    async def act(desk: Desk) -> None:
        told.append(desk)
        began = desk.now
        for name, time, value in strikes:
            await asyncio.sleep(max(0.0, began + time - desk.now))
            STRIKES[name](desk, value)

    broken = ""
    try:
        loop.run(on_the_desk(kind, seed, duration, act, physics), speed="max")
    except Exception as error:
        cause = error.__cause__ or error
        broken = f"{type(cause).__name__}: {cause}"
    cycles, moving = (told[0].cycles, told[0].moving) if told else (0, 0)
    return Result(broken, cycles, moving)


def struck(told: tuple[str, int, float, str]) -> dict[str, Any]:
    """One run of a campaign by kind, seed, duration, physics, and what came of it with the fewest faults; JSON both."""
    kind, seed, duration, physics = told
    strikes = plan(kind, seed, duration)
    result = once(kind, seed, strikes, duration, physics)
    row = {"kind": kind, "seed": seed, "strikes": [each.name for each in strikes], **result._asdict()}
    if result.broken:
        row["only"] = shortest(kind, seed, strikes, duration, physics)
    return row


def shortest(
    kind: str, seed: int, strikes: Sequence[Strike], duration: float = DURATION, physics: str = "plain"
) -> list[int]:
    """The numbers of the fewest faults of a plan that still break the same, found by leaving out more and more."""
    wanted = _kind_of(once(kind, seed, strikes, duration, physics).broken)
    left = list(range(len(strikes)))
    size = max(1, len(left) // 2)
    while left:
        for start in range(0, len(left), size):
            without = left[:start] + left[start + size :]
            if _kind_of(once(kind, seed, [strikes[k] for k in without], duration, physics).broken) == wanted:
                left = without
                break
        else:
            if size == 1:
                break
            size = max(1, size // 2)
    return left


def _kind_of(broken: str) -> str:
    return re.sub(r"[-+.0-9e]+", "0", broken)


def main(words: Sequence[str] | None = None) -> int:
    """Run a campaign, or one of its runs again; 1 if something broke."""
    parser = argparse.ArgumentParser(prog="python -m torture campaign", description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000, help="in all, with those that are there already")
    parser.add_argument("--duration", type=float, default=DURATION, help="of a run, s")
    parser.add_argument("--kept", type=Path, default=Path("out/torture/campaign.jsonl"), help="what came out so far")
    parser.add_argument("--minutes", type=float, help="end after so many; the same command goes on")
    parser.add_argument("--kind", choices=KINDS, help="with --seed: run this one again")
    parser.add_argument("--seed", type=int)
    parser.add_argument(
        "--physics", default="plain", help="sim.physics, with the simulation alone; keep it in a file of its own"
    )
    parser.add_argument("--page", action="store_true", help="write the table into docs/results/reliability.md")
    parser.add_argument("--only", help="the numbers of its faults, such as 0,3; default all")
    add(parser, OPTIONS)
    options = parser.parse_args(words)
    if options.seed is not None:
        return _again(options.kind or KINDS[0], options.seed, options.only, options.duration, options.physics)
    code = code_hash(*OWN)
    rows = Rows(options.kept)
    done = {(row["kind"], row["seed"]): row for row in rows.read() if row["code"] == code}
    began = stopwatch_ns()
    broken = sum(bool(row["broken"]) for row in done.values())
    pattern = PATTERN if options.physics == "plain" else KINDS[:1]
    everything = ((pattern[seed % len(pattern)], seed) for seed in range(options.runs))
    missing = {
        seed: [kind, seed, options.duration, options.physics] for kind, seed in everything if (kind, seed) not in done
    }

    def late() -> bool:
        return options.minutes is not None and (stopwatch_ns() - began) / NS_PER_S > 60.0 * options.minutes

    def keep(seed: int, row: dict[str, Any]) -> None:
        nonlocal broken
        if row["broken"]:
            broken += 1
            strikes = plan(row["kind"], seed, options.duration)
            print(
                f"{row['broken']}\n  {command(row['kind'], seed, row['only'], options.duration, options.physics)}",
                flush=True,
            )
            for k in row["only"]:
                print(f"  {k}: {strikes[k]}", flush=True)
        done[row["kind"], seed] = {"code": code, **row}
        rows.add(done[row["kind"], seed])
        if len(done) % 200 == 0:
            print(f"{len(done)} runs, {broken} broken, {(stopwatch_ns() - began) / NS_PER_S:.0f} s", flush=True)

    ended = run(struck, missing, workers_of(options), keep, bar="campaign", until=late)
    if ended != OK:
        return ended
    text = table(list(done.values()))
    print(text)
    if options.page:
        page.write("campaign", text)
    return 1 if broken else 0


def command(kind: str, seed: int, only: Sequence[int], duration: float, physics: str = "plain") -> str:
    """The command that repeats a run."""
    chosen = ",".join(map(str, only))
    length = "" if duration == DURATION else f" --duration {duration:g}"
    length += "" if physics == "plain" else f" --physics {physics}"
    return f"python -m torture campaign --kind {kind} --seed {seed} --only {chosen or 'none'}{length}"


def _again(kind: str, seed: int, only: str | None, duration: float, physics: str) -> int:
    strikes = plan(kind, seed, duration)
    if only is not None:
        strikes = [strikes[int(k)] for k in only.split(",") if k != "none"]
    for each in strikes:
        print(each)
    result = once(kind, seed, strikes, duration, physics)
    print(result.broken or f"held: {result.moving} of {result.cycles} cycles in motion")
    return 1 if result.broken else 0


def table(rows: Sequence[dict[str, Any]]) -> str:
    """What came out, in Markdown."""
    lines = ["| hardware | runs | broken | cycles in motion |", "|---|--:|--:|--:|"]
    struck: dict[str, Counter[str]] = defaultdict(Counter)
    for kind in (*KINDS, "all"):
        chosen = [row for row in rows if kind in (row["kind"], "all")]
        cycles = sum(row["cycles"] for row in chosen)
        share = 100.0 * sum(row["moving"] for row in chosen) / cycles if cycles else 0.0
        broken = sum(bool(row["broken"]) for row in chosen)
        lines.append(f"| {kind} | {len(chosen)} | {broken} | {share:.0f} % of {cycles} |")
        for row in chosen:
            struck[kind].update(row["strikes"])
    rarest = min(STRIKES, key=lambda name: struck["all"][name])
    lines += ["", f"{len(STRIKES)} kinds of fault struck {struck['all'].total()} times; the rarest is '{rarest}', "]
    lines[-1] += f"{struck['all'][rarest]} times."
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
