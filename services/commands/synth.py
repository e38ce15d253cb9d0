"""`xormocap synth`: makes takes with ground truth."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from services.commands.consoles import say, stderr
from services.mocap.synth.take import write_synthetic_take


def synth(
    out: Annotated[Path, typer.Argument(help="The take folder to make.")],
    motion: Annotated[
        str,
        typer.Option(
            help="walk, basic (slow), dance (fast), or a BVH file to take the motion from.", metavar="MOTION"
        ),
    ] = "walk",
    frames: Annotated[
        int | None,
        typer.Option(
            help="Number of frames; by default 4 s of walk, 26.7 s of basic or dance, or the whole file."
        ),
    ] = None,
    start: Annotated[float, typer.Option(help="Seconds to skip at the start of a BVH file.")] = 0.0,
    fps: Annotated[float, typer.Option(help="Frames per second.")] = 15.0,
    height: Annotated[float, typer.Option(help="The actor's height in metres.")] = 1.75,
    cameras: Annotated[int, typer.Option(help="Number of cameras.")] = 8,
    seed: Annotated[
        int, typer.Option(help="Seed for the room, the noise, and the variant of basic and dance.")
    ] = 0,
) -> None:
    """Make a synthetic take with known poses: an actor who moves inside a ring of cameras."""
    with Progress(console=stderr) as bar:
        task = bar.add_task("drawing", total=frames)
        made = write_synthetic_take(
            out,
            motion=motion,
            n_frames=frames,
            start_s=start,
            fps=fps,
            seed=seed,
            height_m=height,
            n_cameras=cameras,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    words = f"{out}: {len(made.poses)} frames of {cameras} cameras"
    if made.joint_error_m is not None:
        words += f", joints {1e3 * made.joint_error_m:.1f} mm from the file's on average"
    say(words)
