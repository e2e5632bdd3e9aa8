"""Random and hostile bytes for whatever reads bytes of strangers: line, settings, files of all kinds, live view.

A reader may refuse, in the words it has for that; it may not raise anything else, hang, or grow. With the package
atheris (group `fuzz`; `make torture` has it in an environment of its own) libFuzzer looks for inputs that reach new
branches.
"""

import argparse
import contextlib
import hashlib
import io
import json
import os
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from time import process_time_ns
from typing import Final

from torture import files, page
from txt1.board.original import Framer
from txt1.config import load
from txt1.errors import ConfigError
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import EncoderOdometry, PidSet, PwmTest, Velocity

PENDING_MAX: Final = 241  # bytes that a decoder may hold back
PIECE_MAX: Final = 600  # bytes of a read from the line
ROUNDS: Final = 5  # of which the quickest counts
LONGEST_NS: Final = 5_000_000_000  # of the processor, for one input
SIZES: Final = (100_000, 400_000)  # bytes of an adversarial stream, for the comparison


# -- the decoder -------------------------------------------------------------------------------------------------------

FULL: Final = encode(PidSet((1.0, 2.0, 3.0), tuple((0.1 * k, 1.0, 2.0, 3.0) for k in range(14))))
VELOCITY: Final = encode(Velocity(0.5, 0.75))
ODOMETRY: Final = encode(EncoderOdometry(1.0, 2.0, 3.0, 0.5, 0.1))


def _damaged(frame: bytes) -> bytes:
    return frame[:-1] + bytes([frame[-1] ^ 1])


NESTED: Final = b"".join(b"\xfa\xfb\xec\x70" + bytes(k % 7) for k in range(60))
HOSTILE: Final[dict[str, bytes]] = {  # each is repeated to the length wanted
    "0xFA alone": b"\xfa",
    "0xFB alone": b"\xfb",
    "headers without end": b"\xfa\xfb",
    "headers, one byte apart": b"\xfa\xfa\xfb",
    "the longest length, and headers in the data": b"\xfa\xfb\xec\x70" + b"\xfa\xfb" * 117,
    "headers of long frames, nested": NESTED,
    "length 255": b"\xfa\xfb\xff",
    "length 249 of an unknown command": b"\xfa\xfb\xf9\x01" + bytes(245),
    "length 0": b"\xfa\xfb\x00\x67\x00\x67",
    "long frames with a wrong checksum": _damaged(FULL),
    "short frames with a wrong checksum": _damaged(VELOCITY),
    "a long frame cut off by the next": FULL[:-1],
    "a long frame cut off after its head": FULL[:4],
    "frames back to back": VELOCITY,
    "long frames back to back": FULL,
    "frames of the other direction": ODOMETRY,
    "whole frames inside a damaged long one": FULL[:4] + VELOCITY * 23 + b"\x00\x00",
    "PWM tests of the largest counts": encode(PwmTest(2**31 - 1, -(2**31), 0, 1, -1)),
    "old commands": b"\xfa\xfb\x18\x6b" + bytes(26),
    "zeros": bytes(64),
}


def feed_random(total: int, seed: int = 0) -> str:
    """Feed so many random bytes, a tenth of them headers, in pieces of any size; raises AssertionError."""
    rng = random.Random(seed)
    decoders = [Decoder(role) for role in Role]
    framer = Framer(lambda event: None)
    fed = events = 0
    while fed < total:
        piece = bytearray(rng.randbytes(min(rng.randint(1, PIECE_MAX), total - fed)))
        for _ in range(len(piece) // 20):
            at = rng.randrange(len(piece))
            piece[at : at + 4] = rng.choice((b"\xfa\xfb\xec\x70", b"\xfa\xfb\x04\x67", b"\xfa\xfb\x14\x68", VELOCITY))
        fed += len(piece)
        for decoder in decoders:
            events += len(decoder.feed(piece))
            assert decoder.pending <= PENDING_MAX
            assert len(decoder.offsets) <= len(piece) + PENDING_MAX
        if fed % 8 == 0:
            framer.feed(piece[:50])
    for decoder in decoders:
        decoder.expire()
        assert decoder.pending == 0
        assert decoder.position == fed
    return f"{fed} bytes to both decoders in pieces of up to {PIECE_MAX}: {events} messages and faults"


def _time_of(data: bytes, piece: int) -> float:
    """The quickest of some rounds, ns of processor a byte; raises AssertionError when the decoder holds back much."""
    best = float("inf")
    for _ in range(ROUNDS):
        decoder = Decoder(Role.BOARD)
        began = process_time_ns()
        for at in range(0, len(data), piece):
            decoder.feed(data[at : at + piece])
            assert decoder.pending <= PENDING_MAX
        best = min(best, (process_time_ns() - began) / len(data))
    return best


def hostile_stream(name: str, sizes: tuple[int, int] = SIZES) -> tuple[float, float]:
    """Of an adversarial stream ns a byte of the longer size, and how many times that is a byte of the shorter."""
    unit = HOSTILE[name]
    short, long = (_time_of((unit * (size // len(unit) + 1))[:size], 64) for size in sizes)
    return long, long / short


# -- settings ----------------------------------------------------------------------------------------------------------

WORDS: Final = (
    "safety.v_max", "control.angular", "control.linear.kp", "sim.room", "sim.obstacles", "serial.port", "sensors",
    "=", ".", "!!int ", "!!float ", "!!timestamp ", "!!binary ", "!!python/object:x ", "[", "]", "{", "}", ":", "- ",
    "&a ", "*a", "<<: ", "1", "-1", "1e400", ".nan", ".inf", "0x10", "1:30", "null", "true", "yes", "'", '"', "\n",
    "\t", "\x00", "\u2028", "é", "2001-01-01", "?", "|", ">", "%", "@", "9" * 400, "[" * 300,
)  # fmt: skip


def _settings(data: bytes) -> None:
    """Read bytes as a setting."""
    text = data.decode("utf-8", "surrogateescape")
    with contextlib.suppress(ConfigError):
        load(None, [text], {}, {})
    with contextlib.suppress(ConfigError):
        load(None, [f"safety.v_max={text}"], {}, {})
    with contextlib.suppress(ConfigError):
        load(None, (), {"TXT1_SAFETY__V_MAX": text.replace("\x00", "")}, {})


def _file(data: bytes) -> None:
    """Read bytes as a configuration file."""
    with tempfile.NamedTemporaryFile(suffix=".yaml") as file:
        file.write(data)
        file.flush()
        with contextlib.suppress(ConfigError):
            load(file.name)


# -- recordings --------------------------------------------------------------------------------------------------------


def make_recording(folder: Path, compression: str) -> bytes:
    """A short recording, as bytes."""
    from txt1.cli import execute

    file = folder / f"{compression}.mcap"
    words = ["run", "--headless", "--duration", "0.5", "--speed", "max", "--seed", "1", "--log", str(file), "--json"]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        code = execute([*words, "--set", f"record.compression={compression}"])
    assert code == 0
    return file.read_bytes()


def _recording(data: bytes) -> None:
    """List and print bytes as a recording: what it finds wrong is an exit code, never an exception."""
    from txt1.cli import execute

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "x.mcap")
        file.write_bytes(data)
        for words in (["log", "info"], ["log", "cat"], ["log", "recover"]):
            more = [str(Path(folder, "y.mcap"))] if words[1] == "recover" else []
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                code = execute([*words, str(file), *more])
            assert code in (0, 1, 2), f"{words}: exit code {code}"


# -- the live view -----------------------------------------------------------------------------------------------------


def _view(data: bytes) -> None:
    """Take bytes as what a client publishes."""
    from txt1.record.live_view import velocity

    twist = velocity(data)
    assert twist is None or (len(twist) == 2 and all(isinstance(each, float) for each in twist))


def _decode(data: bytes) -> None:
    """Decode bytes whole and cut up: it is the same."""
    whole, pieces = Decoder(Role.BOARD), Decoder(Role.BOARD)
    events = whole.feed(data) + whole.expire()
    cut = [event for k in range(len(data)) for event in pieces.feed(data[k : k + 1])] + pieces.expire()
    assert repr(events) == repr(cut)
    for event in events:
        assert all(isfinite(value) for value in getattr(event, "__dict__", {}).values() if isinstance(value, float))


TARGETS: Final[dict[str, Callable[[bytes], None]]] = {
    "decoder": _decode,
    "setting": _settings,
    "file": _file,
    "recording": _recording,
    "view": _view,
    **files.TARGETS,
}
SHARES: Final = {"recording": 100, "file": 10, "replay": 200, "table": 50, "map": 20, "policy": 20}
"""One input of so many for a target that takes long."""
VIEW_SEEDS: Final = (
    b'{"linear": {"x": 0.5, "y": 0, "z": 0}, "angular": {"x": 0, "y": 0, "z": 0.1}}',
    b'{"twist": {"linear": {"x": NaN}, "angular": {"z": 1e999}}}',
    b"[" * 5000,
    b'{"linear": {"x": ' + b"1" * 5000 + b"}}",
)


def seeds(target: str) -> list[bytes]:
    """Inputs to begin with."""
    if target == "decoder":
        return [VELOCITY, FULL, NESTED, ODOMETRY, FULL[:9] + VELOCITY]
    if target in ("table", "policy", "map"):
        return files.seeds(target)
    if target in ("recording", "replay"):
        with tempfile.TemporaryDirectory() as folder:
            return [make_recording(Path(folder), compression) for compression in ("zstd", "none")]
    if target == "view":
        return list(VIEW_SEEDS)
    return [word.encode() for word in WORDS] + [b"safety:\n  v_max: 1.0\ncontrol:\n  angular: []\n"]


def mutated(rng: random.Random, known: Sequence[bytes], words: Sequence[bytes]) -> bytes:
    """One of the inputs, changed here and there: bytes flipped, cut out, put in, repeated, crossed with another."""
    data = bytearray(rng.choice(known))
    for _ in range(rng.choice((1, 1, 2, 4, 8))):
        at = rng.randrange(len(data) + 1)
        match rng.randrange(6):
            case 0 if data:
                data[at % len(data)] ^= 1 << rng.randrange(8)
            case 1:
                data[at:at] = rng.choice(words)
            case 2:
                del data[at : at + rng.choice((1, 4, 64))]
            case 3:
                data[at:at] = data[at : at + rng.choice((1, 8, 64))] * rng.choice((1, 2, 50))
            case 4:
                other = rng.choice(known)
                data[at:] = other[rng.randrange(len(other) + 1) :]
            case _ if data:
                data[at % len(data)] = rng.choice((0, 1, 0x7F, 0x80, 0xFA, 0xFB, 0xFF))
    return bytes(data[:200_000])


def inputs(target: str, count: int, seed: int) -> Iterator[bytes]:
    """So many inputs for a target."""
    rng = random.Random(f"{target} {seed}")
    known = seeds(target)
    words = (
        [word.encode() for word in WORDS] if target in ("setting", "file") else [VELOCITY, b"\xfa\xfb", b"{", b"1e999"]
    )
    yield from known
    for _ in range(count - len(known)):
        yield mutated(rng, known, words)


def attack(target: str, count: int, seed: int = 0) -> str | None:
    """Hand a target so many inputs; the one that it could not take, as a command that repeats it, or None."""
    for data in inputs(target, count, seed):
        began = process_time_ns()
        try:
            TARGETS[target](data)
            assert process_time_ns() - began < LONGEST_NS, "it took longer than 5 s of the processor"
        except Exception as error:
            place = Path("out/torture", f"{target}-{seed}.bin")
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(data)
            again = f"python -m torture fuzz --target {target} --input {place}"
            return f"{type(error).__name__}: {str(error)[:200]}\n  {again}"
    return None


# -- guided by coverage ------------------------------------------------------------------------------------------------


def guided(target: str, seconds: float) -> str:
    """Let libFuzzer look for inputs that reach new lines, in a process of its own; what it says at its end."""
    with tempfile.TemporaryDirectory() as folder:
        corpus = Path(folder, "corpus")
        corpus.mkdir()
        known = seeds(target)
        for k, data in enumerate(known):
            (corpus / str(k)).write_bytes(data)
        longest = max(4096, *map(len, known))
        libfuzzer = [f"-max_total_time={seconds:g}", f"-max_len={longest}", f"-artifact_prefix={folder}/", str(corpus)]
        command = [sys.executable, "-m", "torture.fuzz", "--guide", target, *libfuzzer]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        said = [line for line in ended.stderr.splitlines() if "DONE" in line or "Exception" in line or "ERROR" in line]
        if ended.returncode != 0:
            return "broken: " + " ".join(said or ended.stderr.splitlines()[-3:])
        words = said[-1].split()
        return (
            f"{words[0].lstrip('#')} inputs, {words[words.index('cov:') + 1]} branches, {len(os.listdir(corpus))} kept"
        )


def _guide(target: str, words: Sequence[str]) -> None:
    import atheris

    with atheris.instrument_imports(include=["txt1"]):
        for name in [each for each in sys.modules if each.startswith("txt1")]:
            del sys.modules[name]
        from torture import fuzz as instrumented

        function = instrumented.TARGETS[target]
        function(instrumented.seeds(target)[0])  # what it imports when it is first called is instrumented as well
    atheris.Setup([sys.argv[0], *words], lambda data: function(bytes(data)))
    atheris.Fuzz()


# -- the whole ---------------------------------------------------------------------------------------------------------


def sources() -> str:
    """A short text that is another when any source of the robot is: what is fuzzed is in all of its parts."""
    files = sorted((Path(__file__).parents[1] / "txt1").rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def _longest(streams: Sequence[str]) -> Iterator[str]:
    """Yield the worst of the adversarial streams in a sentence, if there are any."""
    if streams:
        cells = [re.findall(r"\| ([\d.]+)", line)[-2:] for line in streams]
        slowest, growth = (max(float(cell[k]) for cell in cells) for k in (0, 1))
        yield (
            f"Of {len(streams)} adversarial streams to the decoder the slowest takes {slowest:g} ns a byte; of four "
            f"times as many bytes, a byte takes at most {growth:g} times as long."
        )


def main(words: Sequence[str] | None = None) -> int:
    """Hand random and hostile bytes to all readers; 1 if something broke."""
    parser = argparse.ArgumentParser(prog="python -m torture fuzz", description=__doc__)
    parser.add_argument("--bytes", type=int, default=10_000_000, help="random bytes for the decoders")
    parser.add_argument(
        "--inputs", type=int, default=100_000, help="for each of the others (fewer for files that take long)"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="for each with libFuzzer, where atheris is there")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kept", type=Path, default=Path("out/torture/fuzz.json"), help="what came out so far")
    parser.add_argument("--page", action="store_true", help="write the table into docs/results/reliability.md")
    parser.add_argument("--target", choices=TARGETS, help="with --input: hand it this file")
    parser.add_argument("--input", type=Path)
    options, rest = parser.parse_known_args(words)
    if options.input is not None:
        TARGETS[options.target](options.input.read_bytes())
        return 0
    del rest
    code = sources()
    kept: dict[str, str] = {}
    if options.kept.exists():
        former = json.loads(options.kept.read_text())
        kept = former["lines"] if former["code"] == code else {}
    broken: dict[str, str] = {}  # tried again the next time
    steps = dict(_steps(options))
    for key, step in steps.items():
        if key in kept:
            continue
        what, wrong = step()
        line = f"| {what} |" if wrong is None else f"| {what} {wrong} |"
        print(line, flush=True)
        (kept if wrong is None else broken)[key] = line
        options.kept.parent.mkdir(parents=True, exist_ok=True)
        options.kept.write_text(json.dumps({"code": code, "lines": kept}, indent=1))
    kept |= broken
    known = [(key, kept[key]) for key in steps if key in kept]
    lines = ["| reader | inputs, changed and random or as told | broken |", "|---|---|---|"]
    lines += [line for key, line in known if not key.startswith("stream")]
    lines += ["", *_longest([line for key, line in known if key.startswith("stream")])]
    if options.page:
        page.write("fuzz", "\n".join(lines))
    return 1 if broken else 0


Step = Callable[[], tuple[str, str | None]]


def _steps(options: argparse.Namespace) -> Iterator[tuple[str, Step]]:
    """All that is to be done, by a name that says how much of it: cells of the table, and what broke."""

    def told(reader: str, what: str, wrong: str | None) -> tuple[str, str | None]:
        return (f"{reader} | {what} | none", None) if wrong is None else (f"{reader} | {what} |", wrong)

    yield (
        f"random {options.bytes} {options.seed}",
        lambda: told("decoder", feed_random(options.bytes, options.seed), None),
    )
    for target in TARGETS:
        count = options.inputs // SHARES.get(target, 1)

        def changed(target: str = target, count: int = count) -> tuple[str, str | None]:
            return told(target, f"{count}", attack(target, count, options.seed))

        yield f"{target} {count} {options.seed}", changed
    if find_spec("atheris") is None:
        print("atheris is not installed: no guidance by coverage", file=sys.stderr)
    # the files that drive whole robots meet compiled code, which cannot be instrumented
    for target in [each for each in TARGETS if each not in files.TARGETS] if find_spec("atheris") else ():

        def with_coverage(target: str = target) -> tuple[str, str | None]:
            said = guided(target, options.seconds)
            return told(target, f"libFuzzer: {said}", said if said.startswith("broken") else None)

        yield f"guided {target} {options.seconds:g}", with_coverage
    for name in HOSTILE:

        def stream(name: str = name) -> tuple[str, str | None]:
            cost, growth = hostile_stream(name)
            return f"{name} | {cost:.0f} | {growth:.2f} times", None

        yield f"stream {name}", stream


if __name__ == "__main__":
    if sys.argv[1:2] == ["--guide"]:
        _guide(sys.argv[2], sys.argv[3:])
    sys.exit(main())
