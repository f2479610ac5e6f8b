"""What a run shows while it goes on and when it is done: pictures, progress, result table, curves."""

import math
from contextlib import contextmanager

from ..problem.labels import is_measure, title, written
from ..units import plain


def pictures(frames, options):
    """Callback of a simulation and a number that draws frame_<number>.png as the options ask."""
    import imageio.v3 as iio

    from ..io.run_folder import PICTURE
    from ..viz.render import Renderer

    renderer = None

    def write(sim, number):
        nonlocal renderer
        if renderer is None:
            frames.mkdir(parents=True, exist_ok=True)
            renderer = Renderer(sim.scene, view=options.view, backend=options.renderer)
        picture = renderer.draw(sim.snapshot(), sim.measures())
        iio.imwrite(frames / PICTURE.format(number), picture, compress_level=1)

    return write


def redraw(replays, folder, suffix, options, film=False, surface=False) -> dict:
    """Draw the outputs of runs again, side by side, their particles or smooth surface: pictures, GIF and, on request,
    MP4; the names of what was made."""
    import imageio.v3 as iio

    from ..io.run_folder import PICTURE, empty_of_pictures
    from ..units import SceneError
    from ..viz.film import SideBySide, check, mp4, together
    from ..viz.render import gif

    if film:
        check()
    frames, animation = folder / f"frames{suffix}", folder / f"animation{suffix}.gif"
    painter, made = None, []
    for number, outputs in enumerate(together(*replays)):
        if painter is None:
            shown = {"view": options.view, "backend": options.renderer, "surface": surface}
            painter = SideBySide([o.scene for o in outputs], **shown)
            try:
                empty_of_pictures(frames)
            except OSError as error:
                raise SceneError(f"run = {folder}: {frames} cannot be written ({error.strerror})") from None
        made.append(frames / PICTURE.format(number))
        iio.imwrite(made[-1], painter.draw(outputs), compress_level=1)
    gif(made, animation, width=640 * len(replays))
    names = {"frames": str(frames), "animation": str(animation), "pictures": len(made)}
    return names | ({"film": str(mp4(made, animation.with_suffix(".mp4")))} if film else {})


@contextmanager
def progress(sim, recorder, until, quiet):
    """A line on a terminal: time, dt and what bounds it, slump, iterations, time left. Nothing elsewhere."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield
        return
    columns = TextColumn("{task.description}"), BarColumn(None), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("compiling", total=until, completed=sim.time)

        def show(sim):
            r, m = sim.report, recorder.measures
            moved = next((f"{key[:-2]} {100 * m[key]:.1f} cm  " for key in ("slump_m", "front_m") if key in m), "")
            text = f"{sim.time:.3f}/{until:g} s  dt {1e3 * r.dt:.2f} ms ({r.dt_limit})  {moved}"
            text += f"iterations {r.viscous_iterations}/{r.pressure_iterations}"
            bar.update(task, completed=sim.time, description=text)

        sim.each_step(show)
        yield


def table(summary: dict, folder, stages=(), traffic=None) -> None:
    """The result for a reader, on stdout."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from ..simulation.summary import MOST_VOLUME_ERROR

    rows = Table(title=f"{escape(plain(summary['scene']))}: stopped by {summary['stopped_by']}", show_header=False)
    for key, value in summary.items():
        if is_measure(key) and value is not None:
            rows.add_row(title(key), written(key, value))
    rows.add_row("simulated", f"{summary['simulated_seconds']:.3f} s in {summary['steps']} steps")
    rows.add_row("particles", f"{summary['fluid_particles']} fluid, {summary['wall_particles']} wall")
    spent = ", ".join(f"{summary[f'{key}_seconds']:.1f} s {key}" for key in ("wall", "cpu", "compile"))
    rows.add_row("time spent", spent)
    if summary["volume_error"] is not None:
        worst = summary["volume_error_max"]
        doubt = f", over {MOST_VOLUME_ERROR:.0%}: take a smaller spacing" if worst > MOST_VOLUME_ERROR else ""
        rows.add_row("volume error", f"{100 * summary['volume_error']:.3f} %, on the way up to {worst:.2%}{doubt}")
    whole = sum(seconds for _, seconds, _ in stages)
    for stage, seconds, calls in sorted(stages, key=lambda entry: -entry[1]):
        each = seconds / max(calls, 1)
        once = "an iteration" if stage == "solve" else "a call"
        text = f"{seconds:.2f} s, {seconds / whole:.0%}, {1e3 * each:.3f} ms {once}"
        if stage in (traffic or {}):
            moved = traffic[stage]
            text += f", {1e-9 * moved.bytes / each:.1f} GB/s, {1e-9 * moved.operations / each:.1f} Gflop/s"
        rows.add_row(f"stage {stage}", text)
    rows.add_row("files", escape(plain(folder.path)))
    Console().print(rows)


def curves(folder) -> list[str]:
    """slump.png and history.png, where matplotlib is installed and there is something to show."""
    from ..io.history import read_history
    from ..io.run_folder import PLOTS

    rows = read_history(folder.history)
    try:
        from ..viz import plots

        plots.history(rows, folder.path / PLOTS[1])
        if not all(map(math.isnan, rows["slump_m"])):
            plots.slump_curve({folder.path.name: rows}, folder.path / PLOTS[0])
    except ImportError:
        return []
    return [str(folder.path / name) for name in PLOTS if (folder.path / name).is_file()]


def voids(folder, scene, snapshot) -> None:
    """filling.png, of a scene with a cavity and where matplotlib is installed."""
    from ..io.run_folder import PLOTS

    if scene.cavity is None:
        return
    try:
        from ..viz import plots

        plots.filling(scene.cavity, snapshot, folder.path / PLOTS[2])
    except ImportError:
        pass
