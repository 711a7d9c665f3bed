"""Film of a trajectory: the moving machine above its time series."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..._hybrid.limits import IMPACT
from ..._jax.arrays import Numbers
from ..._orbits.orbit import PeriodicOrbit
from ..._trajectory.solution import Solution
from ..._writing import naming_argument
from ...plot._colors import ink
from ...plot._labels import Units
from ...plot._orbits import solution_of
from ...plot._trajectories import HELD, Span, is_event, is_held_at, span_of, time_series
from .arrangement import Pose
from .canvas import Canvas, Positive
from .drawing import Drawing
from .machine import check_positive, draw_any, poses_of
from .reading import scheme_of_solution
from .scheme import Scheme

_ENDINGS = ".gif", ".html", ".mp4"
_FLASH = "#e4572e"
# Duration of the fading of an impact, in seconds of the film.
_FADING = 0.2
# Default duration of a film in seconds.
_DURATION = 5.0
# Height of the time series below a machine, its width, and its least height beside a machine, in inches.
_HEIGHT, _WIDTH, _LOWEST = 2.0, 5.0, 3.0


class Film(FuncAnimation):
    """An animation that notebooks display as HTML with buttons."""

    def _repr_html_(self) -> str:
        html = self.to_jshtml()
        # Otherwise notebooks also show the last frame as a figure.
        plt.close(self._fig)  # pyright: ignore[reportAttributeAccessIssue]
        return html


def animate(
    sol: Solution | PeriodicOrbit,
    t: Numbers | None = None,
    *,
    span: tuple[float, float] | None = None,
    fps: int = 25,
    speed: float | None = None,
    duration: float | None = None,
    file: str | os.PathLike | None = None,
    positive: Positive | None = None,
    units: Units | None = None,
    **style: Any,
) -> FuncAnimation:
    """Animate the machine of a trajectory, drawn as by `machine`, with its positions against time.

    Masses are orange while a stop or contact holds them; impacts flash. Arrows are the current loads, a double
    arrow is a base that moves. A machine that no spring or stop ties to the ground is drawn relative to the mean of its positions. In a notebook,
    `vx.plot.animate(sol)` as last line of a cell shows the film with buttons; in a script, keep the result and call
    `plt.show()`.

    Args:
        sol: one trajectory, or one periodic orbit, shown over one cycle.
        t: the times of the frames, (frames,), in increasing order; evenly spaced if omitted.
        span: first and last time of a close-up; the whole trajectory if omitted.
        fps: frames per second of the film.
        speed: units of time per second of the film.
        duration: seconds of the film, in place of `speed`; 5 if both are omitted.
        file: file to write, in the format of its suffix: `.gif`, `.html` with buttons, or `.mp4`, which needs ffmpeg.
        positive: the direction of positive positions in the drawing, as for `machine`.
        units: units of `length` and `time`, as in `{"length": "mm", "time": "s"}`; labels show none if omitted.
        **style: properties of the curves of the positions, as for `time_series`.

    Returns:
        The film, an animation of matplotlib.

    Raises:
        ValueError: for a batch, an orbit that was not found, a span or times outside the trajectory, a rate that is not
            positive, a file of another format, an unknown direction, or a motion that is unknown at some of the times.
        RuntimeError: for a film in `.mp4` without ffmpeg.

    Example:
        ```python
        import vijax as vx
        sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 80.0)
        film = vx.plot.animate(sol, span=(60.0, 70.0), duration=5.0, file="motion.gif")
        ```

    References:
        Wagg & Bishop (2004), Figs. 1 and 5.
    """
    path = _checked_path(file)
    check_positive(positive)
    sol = solution_of(sol)
    _check_single(sol)
    times = _times(sol, t, span, fps, speed, duration)
    scheme, poses, x = poses_of_solution(sol, times)
    figure, canvas, series, drawing = _figure(scheme, poses, positive)
    show_time = _clock(series, sol, times, x, units, style)
    show_contacts = _contacts(canvas, sol, scheme, drawing, times, max(1, round(_FADING * fps)))
    # Arrangement is fixed after the first frame, so that axes do not move.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")

    def show(frame: int) -> list:
        drawing.move(poses[frame])
        show_contacts(frame, poses[frame])
        show_time(frame)
        return []

    film = Film(figure, show, frames=len(times), interval=1000 / fps, cache_frame_data=False)
    if path is not None:
        _write(film, path, fps)
    return film


def _figure(
    scheme: Scheme, poses: list[Pose], positive: Positive | None
) -> tuple[Figure, Canvas, Axes, Drawing]:
    """A figure with the machine above the axes of its time series, or at their left if it is vertical."""
    is_tall = (positive or scheme.positive) != "right" or scheme.is_pendulum
    figure, (ax, series) = plt.subplots(*((1, 2) if is_tall else (2, 1)), layout="constrained")
    canvas, drawing = draw_any(ax, scheme, poses, None, {}, positive=positive, fits_axes=False)
    (width, height), grid = drawing.size, ax.get_subplotspec().get_gridspec()
    if is_tall:
        figure.set_size_inches(width + _WIDTH, max(height, _LOWEST))
        grid.set_width_ratios([width, _WIDTH])
    else:
        figure.set_size_inches(max(width, _WIDTH), height + _HEIGHT)
        grid.set_height_ratios([height, _HEIGHT])
    return figure, canvas, series, drawing


def _checked_path(file: str | os.PathLike | None) -> Path | None:
    if file is None:
        return None
    path = Path(file)
    ending = path.suffix.lower()
    if ending not in _ENDINGS:
        raise ValueError(f"Argument `file` must end in one of {', '.join(_ENDINGS)}, but is {str(path)!r}.")
    if ending == ".mp4" and not FFMpegWriter.isAvailable():
        raise RuntimeError(
            "Films in .mp4 need the program ffmpeg, which is not found: install it, or write a .gif or .html."
        )
    return path


def _write(film: FuncAnimation, path: Path, fps: int) -> None:
    with naming_argument("file", path):
        if path.suffix.lower() == ".html":
            path.write_text(film.to_jshtml(), encoding="utf-8")
        else:
            is_gif = path.suffix.lower() == ".gif"
            film.save(path, writer=PillowWriter(fps=fps) if is_gif else FFMpegWriter(fps=fps))


def _times(
    sol: Solution,
    t: Numbers | None,
    span: Span | None,
    fps: int,
    speed: float | None,
    duration: float | None,
) -> np.ndarray:
    """The time of each frame, (frames,)."""
    for name, value in (("fps", fps), ("speed", speed), ("duration", duration)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"Argument `{name}` must be positive, but is {value}.")
    options = {"span": span, "speed": speed, "duration": duration}
    given = [name for name, value in options.items() if value is not None]
    if t is not None:
        times = np.asarray(t, float)
        if given:
            raise ValueError(
                f"Argument `t` gives the time of every frame: leave out {' and '.join(f'`{name}`' for name in given)}."
            )
        if times.ndim != 1 or times.size < 2 or not (np.diff(times) > 0).all():
            raise ValueError("Argument `t` must be two or more times in order, of shape (frames,).")
        span_of(sol, (times[0], times[-1]))
        return times
    if speed is not None and duration is not None:
        raise ValueError("Give one of `speed` and `duration`: either follows from the other.")
    begin, end = span_of(sol, span)
    seconds = (end - begin) / speed if speed is not None else duration or _DURATION
    return np.linspace(begin, end, max(2, round(seconds * fps)))


def _check_single(sol: Solution) -> None:
    if sol.t1.ndim:
        raise ValueError(
            f"Trajectories are shown one by one, but this is a batch of shape {sol.t1.shape}: take one of its parts."
        )


def poses_of_solution(sol: Solution, times: np.ndarray) -> tuple[Scheme, list[Pose], np.ndarray]:
    """The scheme of a machine, its pose at each time, and the positions of the masses, (times, n)."""
    x, places = (np.asarray(at(times)[0]) for at in (sol.evaluate, sol.evaluate_stops))
    if not np.isfinite(x).all():
        raise ValueError(
            f"The motion is not known after t = {float(sol.known_until):.6g}: show an earlier `span`, or simulate with "
            "more `max_events`."
        )
    scheme = scheme_of_solution(sol, places)
    load = np.array([scheme.load_at(time) for time in times])
    poses, _ = poses_of(scheme, x, scheme.signs * places, load)
    return scheme, poses, x


def held_masses(sol: Solution, scheme: Scheme, times: np.ndarray) -> np.ndarray:
    """Flags of the masses held by stops or contacts, (times, n)."""
    is_held = np.zeros((len(times), scheme.num_masses), bool)
    for j, row in enumerate(scheme.rows):
        is_held |= np.outer(is_held_at(sol, j, times), row != 0)
    return is_held


def _clock(
    ax: Axes, sol: Solution, times: np.ndarray, x: np.ndarray, units: Units | None, style: dict[str, Any]
) -> Callable[[int], None]:
    """Draw the time series; return the function that moves its cursor and discs to a frame."""
    time_series(sol, span=(float(times[0]), float(times[-1])), units=units, legend=False, ax=ax, **style)
    cursor = ax.axvline(times[0], color=ink("0.5", "0.6"), linewidth=1)
    (discs,) = ax.plot([], [], "o", color=ink(), markersize=4, zorder=4)

    def show(frame: int) -> None:
        cursor.set_xdata([times[frame]] * 2)
        discs.set_data(np.full(x.shape[1], times[frame]), x[frame])

    return show


def _contacts(
    canvas: Canvas, sol: Solution, scheme: Scheme, drawing: Drawing, times: np.ndarray, fading: int
) -> Callable[[int, Pose], None]:
    """Return the function that flashes impacts of a frame, and fills held boxes."""
    numbers = range(len(scheme.rows))
    flashes = [
        canvas.line(marker=(9, 1, 0), markersize=20, color=_FLASH, linestyle="none", zorder=5)
        for _ in numbers
    ]
    when, span = np.asarray(sol.events.t), (times[0], times[-1])
    struck = [np.searchsorted(times, when[is_event(sol, [j], IMPACT, span)]) for j in numbers]
    is_held = held_masses(sol, scheme, times)
    free = canvas.ax.get_facecolor()

    def show(frame: int, pose: Pose) -> None:
        for j, (flash, frames) in enumerate(zip(flashes, struck, strict=True)):
            age = frame - frames[(frames <= frame) & (frames > frame - fading)]
            flash.set_data(*drawing.spot(j, pose))
            flash.set_alpha(1 - np.min(age, initial=fading) / fading)
        for box, held in zip(drawing.boxes, is_held[frame], strict=True):
            box.set_facecolor(HELD if held else free)

    return show
