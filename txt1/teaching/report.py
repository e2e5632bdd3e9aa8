"""The report of a training: its lessons, results on held-out blocks, worst moments, and the important inputs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.errors import MissingExtra
from txt1.teaching.features import Sight
from txt1.teaching.teach import Lesson
from txt1.teaching.training import saliency

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WORST: Final = 6
"""Number of moments shown."""
MOMENTS_APART: Final = 2.0
"""Smallest time between two of them, s."""
COLOURS: Final = ("#0072B2", "#E69F00", "#009E73", "#D55E00")


def write(lesson: Lesson, folder: Path) -> Path:
    """Write the report into a folder; return its page.

    Raises MissingExtra: there is no matplotlib; OSError.
    """
    try:
        import matplotlib
    except ImportError:
        raise MissingExtra("pictures in the report", "plots") from None
    folder.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        _over_time(lesson, folder / "error.png")
        _curves(lesson, folder / "curve.png")
        _moments(lesson, folder / "worst.png")
    page = folder / "README.md"
    page.write_text(_page(lesson), encoding="utf-8")
    return page


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _over_time(lesson: Lesson, file: Path) -> None:
    held, minutes = lesson.judged, lesson.judged.lessons.times / 60.0
    figure = _figure(9.0, 5.0)
    axes = figure.subplots(3, 1, sharex=True)
    said = held.outputs.mean(0)
    for row, name in ((0, "steering"), (1, "speed")):
        axes[row].plot(minutes, held.lessons.commands[:, row], color="0.6", linewidth=1.0, label="human")
        axes[row].plot(minutes, said[:, row], color=COLOURS[0], linewidth=0.7, label="policy, never taught this block")
        axes[row].set_ylabel(f"{name}, share")
    axes[0].legend(loc="upper right", fontsize=8)
    axes[2].plot(minutes, held.errors[:, 0], color=COLOURS[3], linewidth=0.7, label="error of the steering")
    axes[2].plot(minutes, held.doubts, color=COLOURS[2], linewidth=0.7, label="doubt")
    axes[2].legend(loc="upper right", fontsize=8)
    axes[2].set_xlabel("min of the lessons, all recordings one after the other")
    figure.savefig(file, dpi=100)


def _curves(lesson: Lesson, file: Path) -> None:
    figure = _figure(5.0, 3.0)
    axes = figure.subplots()
    for curve in lesson.ensemble.curves:
        axes.semilogy(np.arange(1, len(curve) + 1), curve, color=COLOURS[0], linewidth=0.9)
    axes.set_xlabel("epoch")
    axes.set_ylabel("loss")
    axes.set_title("a line for each network", fontsize=9)
    figure.savefig(file, dpi=100)


def worst(lesson: Lesson) -> list[int]:
    """Return the times at which the policy differed most from the human, the worst first, `MOMENTS_APART` apart."""
    held = lesson.judged
    times, found = held.lessons.times, list[int]()
    for index in np.argsort(-np.abs(held.errors[:, 0])):
        if all(abs(times[index] - times[other]) >= MOMENTS_APART for other in found):
            found.append(int(index))
        if len(found) == WORST:
            break
    return found


def _moments(lesson: Lesson, file: Path) -> None:
    moments, policy = worst(lesson), lesson.policy
    sights = [sight for sight in policy.card.sees if sight.kind in ("camera", "laser")] or list(policy.card.sees)
    sight = sights[0]
    number = policy.card.sees.index(sight)
    polar = {"projection": "polar"} if sight.kind == "laser" else {}
    figure = _figure(9.0, 1.6 + 1.9 * len(moments) if sight.kind != "laser" else 1.6 + 2.6 * len(moments))
    axes = figure.subplots(len(moments), 2, squeeze=False, subplot_kw=polar)
    held = lesson.judged
    for (left, right), index in zip(axes, moments, strict=True):
        looks = [each[index] for each in held.lessons.seen.parts]
        looked_at = saliency(policy.networks, policy.card.norms, looks)[number]
        human, said = held.lessons.commands[index, 0], held.outputs.mean(0)[index, 0]
        left.set_title(f"human {human:+.2f}, policy {said:+.2f}", fontsize=8)
        right.set_title("what the steering depends on", fontsize=8)
        _show(left, sight, looks[number], None)
        _show(right, sight, looks[number], looked_at)
    figure.suptitle("the worst moments; steering as a share of full lock, left positive", fontsize=9)
    figure.savefig(file, dpi=90)


def _show(axes: Axes, sight: Sight, look: NDArray[Any], looked_at: NDArray[Any] | None) -> None:
    match sight.kind:
        case "camera":
            axes.imshow(look if look.shape[-1] == 3 else look[..., 0], interpolation="nearest")
            if looked_at is not None:
                axes.imshow(looked_at, cmap="inferno", alpha=0.65, interpolation="bilinear")
            axes.set_axis_off()
        case "laser":
            beams, first, step = sight.device
            angles = first + step * (np.arange(look.shape[1]) + 0.5) * beams / look.shape[1] + sight.mount[3]
            near = look[0, :, 0]
            ranges = np.minimum(near / np.maximum(1.0 - near, 1e-3), 10.0)
            polar: Any = axes
            polar.set_theta_zero_location("N")
            if looked_at is None:
                polar.scatter(angles, ranges, s=5, c="0.3")
            else:
                polar.scatter(angles, ranges, s=3.0 + 30.0 * looked_at[0], c=looked_at[0], cmap="inferno_r")
            # the corners of a sweep of 270 degrees are behind; up is ahead
            polar.set_rlim(0.0, 10.0)
            polar.set_rticks([5.0, 10.0])
            polar.tick_params(labelsize=6)
        case _:
            values = look.ravel()
            axes.bar(range(len(values)), values, color=COLOURS[0] if looked_at is None else COLOURS[3])


def _page(lesson: Lesson) -> str:
    card, results = lesson.policy.card, lesson.policy.card.results
    lines = [
        "# A policy's report",
        "",
        f"Taught on {card.made} by txt1 {card.version}, for the vehicle `{card.vehicle}`, which turns with a radius of "
        f"at least {card.radius_min:g} m and was allowed {card.v_max:g} m/s.",
        f"It sees: {', '.join(f'{sight.name} ({sight.kind}) as {sight.size}' for sight in card.sees)}.",
        f"It is {card.members} networks, {results['parameters']:.0f} numbers together.",
        "",
        "On blocks of time that were held out, a network that had not been taught the block was off the human by:",
        "",
        "| | rms error | correlation | deviation of the human |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {name}, share | {results[f'{name}_rms']:.4f} | {results[f'{name}_correlation']:.3f} | "
        f"{results[f'{name}_deviation']:.4f} |"
        for name in ("steering", "speed")
    ]
    lines += [
        "",
        f"It drives slower from a doubt of {card.doubt_slow:.4f} on, and stands beyond {card.doubt_stop:.4f}.",
        "",
        "| recording | driven, s | by | take-overs, s | left out, s |",
        "|---|---|---|---|---|",
    ]
    for taught in card.taught_by:
        by = ", ".join(f"{name} {seconds:.0f}" for name, seconds in sorted(taught.by.items()))
        left = ", ".join(f"{reason} {seconds:.0f}" for reason, seconds in sorted(taught.left_out.items())) or "nothing"
        lines.append(f"| {taught.file} | {taught.seconds:.0f} | {by} | {taught.takeover:.0f} | {left} |")
    lines += ["", "![](error.png)", "", "![](worst.png)", "", "![](curve.png)", ""]
    return "\n".join(lines)
