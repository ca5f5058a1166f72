"""The course over ground: which way a vehicle points, told by where it goes.

A receiver of positions has no heading. Around each position a polynomial of second degree in time is fitted to those up
to `CourseSettings.reach_s` before and after it, x(t) and y(t) by least squares; its velocity there is the course. It
does not lag, and a steady curve does not bend it, however long the window. The window is the shortest one that keeps
the error by noise below `aim_rad`: centimetres of noise leave a third of a second, half a metre takes the whole of it.
For noise of σ that is new in each position, positions d metres apart, and a window of ±a metres, that error is about
σ √(1.5 d / a³) radians: 2° for 0.5 m, 2.5 m and 10 m.

* **Standing still**, which is below `slowest_mps` or within the noise, the last heading is held.
* **Reversing**: where the course jumps by about half a turn, as it does at a stop only, the vehicle reverses: its
  heading stays, until the course jumps back. A U-turn is a turn, not a jump.
* **At the start** a vehicle may reverse, too. Its heading is unknown until it has gone faster than vehicles reverse
  (`forward_mps`), or far enough (`forward_m`).
* A gap between positions breaks all of this, and the heading is unknown as at the start.
"""

from __future__ import annotations

import bisect
import dataclasses
import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_WINDOWS = 6
_BLOCK = 64
_MOST = 1024
_FEWEST_FOR_NOISE = 5
_FEWEST_NOISES = 8
_LAST_NOISES = 64
_REPEATED_M = 1e-3
_TOGETHER_NS = 10**8
_LEAST_DETERMINANT = 1e-6
_JUMP_RAD = math.radians(120.0)


@dataclasses.dataclass(frozen=True)
class CourseSettings:
    """What decides the course.

    Attributes:
        reach_s: positions up to this long before and after one are used.
        aim_rad: longer windows are used until the error by noise is at most this.
        noise_m: standard deviation of a coordinate before it can be measured.
        least_noise_m: it is taken to be at least this.
        drift_mps: speed with which a receiver's error wanders too slowly to be seen as noise.
        lever_m: the receiver may be this far before or behind the point of the vehicle that moves as it points; in a
            curve of curvature κ the course is then off by this times κ.
        slowest_mps: a vehicle that is slower stands still.
        surest: speed, in standard deviations of it, above which the vehicle moves.
        least_sure_rad: a course that is less certain is none.
        turn_per_m: how much a heading that is held may change, in rad for each metre away from where it was measured;
            in a curve by its curvature, too.
        forward_mps: a vehicle that is faster drives forwards.
        forward_m: one that has driven so far from the start without a jump of the course drives forwards.
        reverse_m: no vehicle reverses so far.
    """

    reach_s: float = 2.0
    aim_rad: float = math.radians(0.5)
    noise_m: float = 0.3
    least_noise_m: float = 0.02
    drift_mps: float = 0.1
    lever_m: float = 1.0
    slowest_mps: float = 0.5
    surest: float = 4.0
    least_sure_rad: float = math.radians(10.0)
    turn_per_m: float = 0.04
    forward_mps: float = 4.0
    forward_m: float = 20.0
    reverse_m: float = 50.0


LOOK_AHEAD_S = CourseSettings().reach_s + _TOGETHER_NS / 1e9
"""The heading of a position is known from the first position on that is later by this."""


class Heading(NamedTuple):
    """Which way a vehicle points at one of its positions.

    Attributes:
        yaw_rad: counter-clockwise from the x axis of the positions; NaN where unknown.
        sd_rad: standard deviation of it; NaN where there is no axis.
        axis_rad: the same up to half a turn, known from the first motion on.
    """

    yaw_rad: float
    sd_rad: float
    axis_rad: float


class _Motion(NamedTuple):
    """The motion at a position.

    Attributes:
        course_rad: its direction.
        noise_rad: standard deviation of that by the errors of the positions.
        curvature: rad for each metre.
        speed_mps: its speed.
    """

    course_rad: float
    noise_rad: float
    curvature: float
    speed_mps: float


class _Fit(NamedTuple):
    """A fit of second degree to the positions in one window.

    Attributes:
        velocity: along x and y, m/s.
        acceleration: along x and y, m/s².
        spread: standard deviation of the velocity in 1/s, for noise of 1 m.
        noise_m: root mean square of what the fit leaves; 0 with less than five positions.
    """

    velocity: tuple[float, float]
    acceleration: tuple[float, float]
    spread: float
    noise_m: float

    @property
    def speed_mps(self) -> float:
        return max(math.hypot(*self.velocity), 1e-9)


class Course:
    """Headings of a stream of positions; each is known when the positions up to `reach_s` after it are, or just later.

    They depend on the positions alone, not on when each arrives: of a recording and of a live stream they are the same.
    """

    def __init__(self, max_gap_ns: int, settings: CourseSettings | None = None) -> None:
        self._settings = settings or CourseSettings()
        self._max_gap_ns = max_gap_ns
        self._reach_ns = round(self._settings.reach_s * 1e9)
        self.reset()

    def reset(self) -> None:
        """Forget the positions, and all that they have told."""
        self._noises_m: list[float] = []
        self._positions: list[tuple[int, float, float]] = []
        self._next = 0
        self._axis_rad = self._course_rad = math.nan
        self._noise_rad = self._slip_rad = self._turn_per_m = math.nan
        self._measured_at = (math.nan, math.nan)
        self._before_ns: int | None = None
        self._direction = 0
        self._stretch_m = self._since_m = 0.0

    def add(self, stamp_ns: int, x_m: float, y_m: float) -> list[Heading]:
        """Add a position, later than those before; returns the headings that it decides, in their order."""
        return self.add_all([(stamp_ns, x_m, y_m)])

    def add_all(self, positions: Sequence[tuple[int, float, float]]) -> list[Heading]:
        """As `add` of each of them, faster."""
        headings: list[Heading] = []
        for position in positions:
            if self._positions and position[0] - self._positions[-1][0] > self._max_gap_ns:
                headings += self.settle()
                self.reset()
            self._positions.append(position)
            if len(self._positions) - self._next > _MOST:
                # More than any receiver sends: neither memory nor time may grow.
                headings += self.settle()
        decided_ns = self._positions[-1][0] - self._reach_ns if self._positions else 0
        if self._next < len(self._positions) and self._positions[self._next][0] <= decided_ns - _TOGETHER_NS:
            headings += self._decided(bisect.bisect_right(self._positions, decided_ns, key=lambda each: each[0]))
        return headings

    def settle(self) -> list[Heading]:
        """The headings of all that still wait, from the positions so far, as when none will follow."""
        return self._decided(len(self._positions))

    def _decided(self, end: int) -> list[Heading]:
        """The headings of the next positions, up to index `end`."""
        headings: list[Heading] = []
        for start in range(self._next, end, _BLOCK):
            rows = slice(start, min(start + _BLOCK, end))
            fits = _fits(self._positions, rows, self._settings.reach_s)
            for windows, position in zip(fits, self._positions[rows], strict=True):
                headings.append(self._headed(self._motion(windows), *position))
        if headings:
            # One before is kept, however long ago: it may be all there is.
            oldest_ns = self._positions[end - 1][0] - self._reach_ns
            oldest = bisect.bisect_left(self._positions, oldest_ns, key=lambda each: each[0])
            oldest = min(max(oldest, end - _MOST), end - 1)
            del self._positions[:oldest]
            self._next = end - oldest
        return headings

    def _motion(self, windows: list[_Fit]) -> _Motion | None:
        """How the vehicle moves, from fits in ever longer windows; None where it does not, or too little."""
        if not windows:
            return None
        settings, longest = self._settings, windows[-1]
        noise_m = self._noise_m(windows)
        # The longest window is the one that noise moves least.
        if longest.speed_mps < max(settings.slowest_mps, settings.surest * noise_m * longest.spread):
            return None
        by_noise = [fit.spread * max(noise_m, fit.noise_m) / fit.speed_mps for fit in windows]
        best = next((k for k, rad in enumerate(by_noise) if rad <= settings.aim_rad), by_noise.index(min(by_noise)))
        speed_mps, (vx, vy) = windows[best].speed_mps, windows[best].velocity
        if speed_mps < settings.slowest_mps:
            return None
        (ahead_x, ahead_y), (aside_x, aside_y) = longest.velocity, longest.acceleration
        curvature = abs(ahead_x * aside_y - ahead_y * aside_x) / longest.speed_mps**3
        noise_rad = math.hypot(by_noise[best], settings.drift_mps / speed_mps)
        if noise_rad > settings.least_sure_rad:
            return None
        return _Motion(math.atan2(vy, vx), noise_rad, curvature, speed_mps)

    def _noise_m(self, windows: list[_Fit]) -> float:
        """Standard deviation of a coordinate: the median over the last positions."""
        noise_m = next((fit.noise_m for fit in windows if fit.noise_m), 0.0)
        # A receiver that stands still may repeat one position: that has no noise, and says nothing.
        if noise_m and (windows[-1].speed_mps >= self._settings.slowest_mps or noise_m > _REPEATED_M):
            self._noises_m.append(noise_m)
            del self._noises_m[:-_LAST_NOISES]
        is_known = len(self._noises_m) >= _FEWEST_NOISES
        noise_m = statistics.median(self._noises_m) if is_known else self._settings.noise_m
        return max(noise_m, self._settings.least_noise_m)

    def _headed(self, motion: _Motion | None, stamp_ns: int, x_m: float, y_m: float) -> Heading:
        """The heading at the next position, which may be the one that is held."""
        here, since_s = (x_m, y_m), 0.0 if self._before_ns is None else (stamp_ns - self._before_ns) * 1e-9
        self._before_ns = stamp_ns
        # Of a vehicle that reverses to where it was, only the former grows.
        self._since_m += motion.speed_mps * since_s if motion else 0.0
        turned_rad = self._turn_per_m * max(self._since_m, math.dist(self._measured_at, here))
        if motion is not None and not math.hypot(self._noise_rad, turned_rad) < motion.noise_rad:
            self._turn(motion)
            self._noise_rad, turned_rad = motion.noise_rad, 0.0
            self._slip_rad = self._settings.lever_m * motion.curvature
            self._turn_per_m = math.hypot(self._settings.turn_per_m, motion.curvature)
            self._measured_at, self._since_m = here, 0.0
        yaw_rad = self._axis_rad if self._direction else math.nan
        return Heading(yaw_rad, math.hypot(self._noise_rad, self._slip_rad, turned_rad), self._axis_rad)

    def _turn(self, motion: _Motion) -> None:
        """Take over a course, and decide which end of the vehicle goes first."""
        settings = self._settings
        if abs(_wrapped(motion.course_rad - self._course_rad)) > _JUMP_RAD:
            self._direction, self._stretch_m = -self._direction, 0.0
        elif not math.isnan(self._course_rad):
            self._stretch_m += self._since_m
        self._course_rad = motion.course_rad
        farthest_m = settings.reverse_m if self._direction < 0 else settings.forward_m
        if motion.speed_mps >= settings.forward_mps or self._stretch_m >= farthest_m:
            self._direction = 1
        self._axis_rad = motion.course_rad if self._direction >= 0 else _wrapped(motion.course_rad + math.pi)


def course_of(
    stamps_ns: NDArray[np.int64],
    points_m: NDArray[np.float64],
    max_gap_ns: int,
    settings: CourseSettings | None = None,
) -> NDArray[np.float64]:
    """(N, 2) float64 headings and their standard deviations, in rad, at (N,) strictly increasing stamps in ns.

    `points_m` is (N, 2 or 3) float64, x and y in metres of one frame. The headings are those of `Course`, but where
    that does not know yet which way is forwards, or there was no motion yet, what follows decides. NaN where the
    vehicle never moves between two gaps of more than `max_gap_ns`.
    """
    course = Course(max_gap_ns, settings)
    positions = list(zip(stamps_ns.tolist(), *points_m[:, :2].T.tolist(), strict=True))
    found: list[Heading] = []
    for start in range(0, len(positions), _BLOCK):
        found += course.add_all(positions[start : start + _BLOCK])
    found += course.settle()
    table = np.array(found, np.float64).reshape(-1, 3)
    breaks = np.flatnonzero(np.diff(stamps_ns) > max_gap_ns) + 1
    for part in np.split(np.arange(len(table)), breaks):
        table[part] = _known_from_the_end(table[part])
    return np.asarray(table[:, :2])


def _known_from_the_end(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same (N, 3) headings without a gap between them, with those that only later ones tell."""
    filled: NDArray[np.float64] = table.copy()
    yaw_rad = sd_rad = math.nan
    for row in range(len(filled) - 1, -1, -1):
        known_rad, known_sd_rad, axis_rad = filled[row].tolist()
        if math.isnan(known_rad) and not math.isnan(axis_rad):
            # Where no later one is known, the way at the end is taken for forwards.
            backwards = abs(_wrapped(axis_rad - yaw_rad)) > math.pi / 2
            known_rad = _wrapped(axis_rad + math.pi) if backwards else axis_rad
        if math.isnan(known_rad):
            known_rad, known_sd_rad = yaw_rad, sd_rad
        filled[row, 0], filled[row, 1] = yaw_rad, sd_rad = known_rad, known_sd_rad
    return filled


def _fits(positions: list[tuple[int, float, float]], chosen: slice, reach_s: float) -> list[list[_Fit]]:
    """For each of the chosen positions the fits in windows of up to `reach_s`, the shortest first.

    x ≈ x₀ + v t + ½ a t², and y alike, by the normal equations, with t = 0 at the position itself. A window holds at
    least three positions; where there are not as many within reach, it holds those before and after, however far.
    """
    stamps_ns = np.array([stamp_ns for stamp_ns, _, _ in positions], np.int64)
    points = np.array([(x_m, y_m) for _, x_m, y_m in positions], np.float64)
    rows = np.arange(chosen.start, chosen.stop)
    here_ns = stamps_ns[rows, None]
    halves_ns = np.rint(reach_s * 1e9 * 2.0 ** (-0.5 * np.arange(_WINDOWS - 1, -1, -1))).astype(np.int64)
    starts = np.searchsorted(stamps_ns, here_ns - halves_ns)
    ends = np.searchsorted(stamps_ns, here_ns + halves_ns, side='right')
    alone = ends[:, -1] - starts[:, -1] < 3
    starts[alone] = np.maximum(rows[alone, None] - 1, 0)
    ends[alone] = np.minimum(rows[alone, None] + 2, len(positions))
    counts = ends - starts
    # Windows without positions of their own add nothing to the one before.
    known = (counts >= 3) & (np.diff(counts, axis=1, prepend=0) > 0)
    near = starts[:, -1:] + np.arange(np.max(counts))
    near = np.minimum(near, len(positions) - 1)
    t = (stamps_ns[near] - here_ns) * 1e-9
    x, y = np.moveaxis(points[near] - points[rows, None], 2, 0)
    tt = t * t
    # Sums and sub-determinants are written out: products of matrices are not the same to the last bit everywhere.
    terms = np.stack([t, tt, tt * t, tt * tt, x, t * x, tt * x, y, t * y, tt * y, x * x + y * y])
    totals = np.pad(np.cumsum(terms, axis=2), ((0, 0), (0, 0), (1, 0)))
    first, last = starts - starts[:, -1:], ends - starts[:, -1:]
    each = np.arange(len(rows))[:, None]
    t1, t2, t3, t4, x0, x1, x2, y0, y1, y2, squares = totals[:, each, last] - totals[:, each, first]
    a = t2 * t4 - t3**2
    b = t2 * t3 - t1 * t4
    c = t1 * t3 - t2**2
    d = counts * t4 - t2**2
    e = t1 * t2 - counts * t3
    f = counts * t2 - t1**2
    determinant = counts * a + t1 * b + t2 * c
    # Stamps that are all but equal decide nothing.
    known &= determinant > _LEAST_DETERMINANT * counts * t2 * t4
    determinant[~known] = 1.0
    left = squares
    values = []
    for m0, m1, m2 in ((x0, x1, x2), (y0, y1, y2)):
        start = (a * m0 + b * m1 + c * m2) / determinant
        velocity = (b * m0 + d * m1 + e * m2) / determinant
        half = (c * m0 + e * m1 + f * m2) / determinant
        left = left - start * m0 - velocity * m1 - half * m2
        values += [velocity, 2.0 * half]
    noises_m = np.sqrt(np.maximum(left, 0.0) / np.maximum(2 * counts - 6, 1))
    noises_m[counts < _FEWEST_FOR_NOISE] = 0.0
    spreads = np.sqrt(np.maximum(d / determinant, 0.0))
    columns = np.stack([known, *values, spreads, noises_m], axis=2).tolist()
    return [
        [_Fit((vx, vy), (ax, ay), spread, noise_m) for is_known, vx, ax, vy, ay, spread, noise_m in windows if is_known]
        for windows in columns
    ]


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, math.tau)
