"""Where pairs of eigenvalues cross the imaginary axis along a branch of equilibria."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.curve import NODES, RestBranch
from hbbogie.equilibria.hopf_equations import confirm
from hbbogie.equilibria.rest import Rest
from hbbogie.equilibria.search import Box, newton
from hbbogie.equilibria.spectrum import MANY, ON_AXIS, Pairing, eigenpairs_near, spectra, state_matrices

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
DEEPEST = 18  # bisections of a step
DEEPEST_OF_REAL = 3  # the same where both eigenvalues are real, as beside folds
MOST_STEPS = (3000, 150)  # largest number of points at which eigenvalues are computed: of few states, and of many
REAL = 1e-9  # imaginary part, relative to the eigenvalue, up to which it is real
SURE = 0.25  # how much of its distance from the axis an eigenvalue may be uncertain by
SHARES = np.linspace(0.0, 1.0, 17)
ROUND_OFF = 1e-7  # real part, relative to the frequency, up to which a located pair lies on the axis
TOGETHER = 1e-7  # relative distance up to which pairs cross together


@dataclass(frozen=True, eq=False)
class Crossing:
    """A Hopf point of a branch: the solution of F = 0, P(i omega) z = 0, c.z = 1.

    Attributes
    ----------
    u : ndarray, shape (m + 1,)
    z : ndarray of complex, shape (n,)
        The critical mode.
    omega : float, rad/s
    pairs : int
        Number of pairs of eigenvalues that cross here together, with this frequency.
    gains : bool
        Whether they gain a positive real part as the parameter grows.
    real : float, 1/s
        Real part of the eigenvalue where located.
    """

    u: Array
    z: Complex
    omega: float
    pairs: int
    gains: bool
    real: float


@dataclass(frozen=True, eq=False)
class Crossings:
    """What eigenvalues do along a branch.

    Attributes
    ----------
    u, t : ndarray, shape (N, m + 1)
        Points and tangents where they were computed.
    values : ndarray of complex, shape (N, k), 1/s
    found : tuple of Crossing
    notes : tuple of str
        What stays on the axis, what is not located, where there are no derivatives.
    undecided : tuple of str
        Those of them that may be Hopf points: what is not located.
    """

    u: Array
    t: Array
    values: Complex
    found: tuple[Crossing, ...]
    notes: tuple[str, ...]
    undecided: tuple[str, ...]

    @property
    def unstable(self) -> NDArray[np.intp]:
        """Number of eigenvalues right of the axis at each point."""
        return np.asarray((self.values.real > REAL * np.abs(self.values)).sum(axis=1))


class Steps:
    """The points of a branch at which eigenvalues are known, and the steps between them, each looked at once."""

    def __init__(self, rest: Rest, box: Box, branch: RestBranch):
        self.rest, self.box, self.scale = rest, Box(box.low, box.high, branch.scale), branch.scale
        self.metric = branch.scale.copy()
        self.metric[rest.system.n : -1] = np.inf
        u, t = branch.u, branch.t
        least = NODES[rest.system.n_states > MANY]
        while 1 < len(u) < least:
            h = self.lengths(u)
            wide = np.flatnonzero(h > max(0.5 * h.max(), h.sum() / least))
            u, t = self.inserted(u, t, wide)
            if not len(wide):
                break
        self.u, self.t = u, t
        self.known = spectra(rest, u, t)

    def lengths(self, u: Array) -> Array:
        """Return the lengths of the steps between successive points."""
        return np.asarray(np.linalg.norm(np.diff(u, axis=0) / self.metric, axis=1))

    def middles(self, a: Array, b: Array, ta: Array, tb: Array) -> tuple[Array, Array]:
        """Return points of the branch in the middle of steps, and their tangents; not a number where lost."""
        h = np.linalg.norm((b - a) / self.metric, axis=1)[:, None]
        chord = (b - a) / self.metric / np.where(h > 0, h, 1.0)
        guess = (a + b) / 2 + h * (ta - tb) / 8
        guess = np.clip(guess, self.box.low, self.box.high)
        u, found = newton(self.rest, guess, chord, self.box)
        _, J = self.rest.evaluate(u)
        rows = self.rest.rows(J, np.maximum(self.scale, np.abs(u)))
        matrix = np.concatenate([J / rows[:, :, None] * self.scale, chord[:, None]], axis=1)
        matrix[~np.isfinite(matrix).all(axis=(1, 2))] = np.eye(matrix.shape[1])
        right = np.eye(matrix.shape[1])[-1][None, :, None]
        try:
            t = np.linalg.solve(matrix, np.broadcast_to(right, (len(u), *right.shape[1:])))[:, :, 0]
        except np.linalg.LinAlgError:
            t = chord
        t = t * self.scale
        t = t / np.linalg.norm(t / self.metric, axis=1, keepdims=True)
        u[~found] = np.nan
        return u, t

    def inserted(self, u: Array, t: Array, places: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return points and tangents with the middles of some steps put in."""
        if not len(places):
            return u, t
        new, along = self.middles(u[places], u[places + 1], t[places], t[places + 1])
        good = np.isfinite(new).all(axis=1)
        return np.insert(u, places[good] + 1, new[good], axis=0), np.insert(t, places[good] + 1, along[good], axis=0)


@dataclass(frozen=True, eq=False)
class Step:
    """A step between two points: unknowns, tangents, eigenvalues and slopes at both ends."""

    u: Array
    t: Array
    values: Complex
    slopes: Complex
    depth: int = 0

    def half(self, side: int, middle: Step) -> Step:
        """Return the first or second half, given what is known in the middle."""

        def joined(end: NDArray[Any], between: NDArray[Any]) -> NDArray[Any]:
            return np.concatenate([end[:1], between] if side == 0 else [between, end[1:]])

        return Step(
            joined(self.u, middle.u),
            joined(self.t, middle.t),
            joined(self.values, middle.values),
            joined(self.slopes, middle.slopes),
            middle.depth,
        )


def crossings(rest: Rest, box: Box, branch: RestBranch) -> Crossings:
    """Return the Hopf points of a branch, by eigenvalues matched from point to point, each confirmed by Newton."""
    steps = Steps(rest, box, branch)
    names: dict[str, list[float]] = {}
    found: list[Crossing] = []
    values, slopes = steps.known.values, steps.known.slopes
    known = np.asarray(np.isfinite(values).all(axis=1))
    todo = [
        Step(steps.u[i : i + 2], steps.t[i : i + 2], values[i : i + 2], slopes[i : i + 2])
        for i in range(len(steps.u) - 1)
        if known[i] and known[i + 1]
    ]
    if not known.all():
        names.setdefault(NO_DERIVATIVE, []).extend(steps.u[~known, -1])
    spent, most = len(steps.u), MOST_STEPS[rest.system.n_states > MANY]
    while todo:
        pairings = _paired(steps, todo)
        doubtful = np.flatnonzero(~_quiet(pairings).all(axis=1))
        divided = [todo[i] for i in doubtful if _looked_at(steps, todo[i], pairings[int(i)], found, names)]
        spent += len(divided)
        if spent > most:
            names.setdefault(NOT_LOCATED, []).extend(float(v) for step in divided for v in step.u[:, -1])
            break
        todo = _halves(steps, divided, names)
    found.sort(key=lambda c: float(c.u[-1]))
    missed = {name: places for name, places in names.items() if name == NOT_LOCATED}
    return Crossings(steps.u, steps.t, values, tuple(found), _notes(rest, names), _notes(rest, missed))


def _halves(steps: Steps, divided: list[Step], names: dict[str, list[float]]) -> list[Step]:
    """Return the halves of steps, each with the eigenvalues in the middle."""
    if not divided:
        return []
    ends = [np.array([getattr(s, name)[i] for s in divided]) for name in "ut" for i in (0, 1)]
    u, t = steps.middles(*ends)
    lost = np.asarray(~np.isfinite(u).all(axis=1))
    u[lost] = ends[0][lost]
    new = spectra(steps.rest, u, t)
    lost |= ~np.isfinite(new.values).all(axis=1)
    todo = []
    for i, s in enumerate(divided):
        if lost[i]:
            names.setdefault(NOT_LOCATED, []).append(float(s.u[0, -1]))
            continue
        middle = Step(u[i : i + 1], t[i : i + 1], new.values[i : i + 1], new.slopes[i : i + 1], s.depth + 1)
        todo += [s.half(0, middle), s.half(1, middle)]
    return todo


NOT_LOCATED = "not located"
ON_IT = "eigenvalues stay on the imaginary axis"
TOUCHES = "touches"
NO_DERIVATIVE = "no derivative"


def _paired(steps: Steps, todo: list[Step]) -> Pairing:
    """Return the eigenvalues over steps, matched."""
    u, values, slopes = (np.array([getattr(step, name) for step in todo]) for name in ("u", "values", "slopes"))
    h = np.linalg.norm((u[:, 1] - u[:, 0]) / steps.metric, axis=1)
    return Pairing.of(values[:, 0], values[:, 1], slopes[:, 0], slopes[:, 1], h)


def _quiet(pairing: Pairing) -> NDArray[np.bool_]:
    """Tell which eigenvalues surely stay on one side of the axis over their step."""
    whole = np.concatenate([pairing.real(SHARES), pairing.extremes()], axis=-1)
    clear = np.abs(whole).min(axis=-1) > SURE * pairing.error + ON_AXIS * pairing.size
    return np.asarray(clear & (np.ptp(np.sign(whole), axis=-1) == 0))


def _looked_at(
    steps: Steps, step: Step, pairing: Pairing, found: list[Crossing], names: dict[str, list[float]]
) -> bool:
    """Look at a step; add what is found there, and tell whether it has to be divided."""
    size, quiet = pairing.size, _quiet(pairing)
    margin = ON_AXIS * size
    complex_at = [np.abs(z.imag) > REAL * size for z in (pairing.start, pairing.end)]
    moving, merging = complex_at[0] | complex_at[1], complex_at[0] != complex_at[1]
    course, error = pairing.real(SHARES), pairing.error
    whole = np.hstack([course, pairing.extremes()])
    resting = (np.abs(whole) <= margin[:, None]).all(axis=1)
    if (resting & moving).any():
        names.setdefault(ON_IT, []).extend(float(v) for v in step.u[:, -1])
    change = np.abs(course[:, -1] - course[:, 0])
    crosses = course[:, 0] * course[:, -1] < 0
    touching = (np.abs(course[:, [0, -1]]) <= margin[:, None]).any(axis=1)
    monotone = (np.diff(course, axis=1) * np.sign(course[:, -1:] - course[:, :1]) > 0).all(axis=1)
    plain = (crosses | touching) & (error <= 0.1 * change) & monotone & ~merging
    busy = ~quiet & ~resting & (moving | (~plain & (step.depth < DEEPEST_OF_REAL)))
    if not busy.any():
        return False
    upper = busy & moving & (np.maximum(pairing.start.imag, pairing.end.imag) > 0)
    here: list[Crossing] = []  # those of this step
    settled = plain[busy].all() and all(
        _confirmed(steps, step, pairing, int(i), course[i], here) for i in np.flatnonzero(upper)
    )
    for new in here:
        found += [] if any(_same(steps, new, old) for old in found) else [new]
    if settled:
        return False
    if step.depth < DEEPEST:
        return True
    more = int((course[:, -1] > 0).sum()) - int((course[:, 0] > 0).sum())
    if abs(more) == 1:  # a real eigenvalue has passed zero, such as at a fold
        return False
    if (crosses & moving & busy).any():
        names.setdefault(NOT_LOCATED, []).append(float(step.u[:, -1].mean()))
    elif upper.any():
        names.setdefault(TOUCHES, []).append(float(step.u[:, -1].mean()))
    return False


def _confirmed(steps: Steps, step: Step, pairing: Pairing, i: int, course: Array, here: list[Crossing]) -> bool:
    """Confirm the crossing of an eigenvalue by Newton's method; tell whether that is settled.

    Each pair has its own crossing: where Newton's method leads to one of those found in this step already, it does not.
    """
    up = course[-1] > course[0]
    x = float(np.interp(0.0, course if up else course[::-1], SHARES if up else SHARES[::-1]))
    u = (1 - x) * step.u[0] + x * step.u[1]
    near = (1 - x) * pairing.start[i] + x * pairing.end[i]
    if near.imag <= 0:
        return True  # the other of the pair is looked at
    solved = confirm(steps.rest, steps.metric, u, 1j * near.imag)
    if solved is None:
        return False
    v, z, omega = solved
    along = (step.u[1] - step.u[0]) / steps.metric
    share = float(((v - step.u[0]) / steps.metric) @ along / (along @ along))
    off = np.linalg.norm((v - step.u[0]) / steps.metric - share * along)
    if not (-1e-6 <= share <= 1 + 1e-6 and off <= 0.3 * np.linalg.norm(along) + 1e-9):
        return False
    if not 0.5 * near.imag < omega < 2 * near.imag or steps.rest.singular(v[None])[0]:
        return False  # a double zero is no Hopf point
    values, _ = eigenpairs_near(state_matrices(steps.rest, steps.rest.pencil(v[None]))[0], 1j * omega)
    distance = np.abs(values - 1j * omega) / omega
    if distance.min() > ROUND_OFF:
        return False
    rises = bool(course[-1] > course[0]) == bool(step.u[1, -1] > step.u[0, -1])
    nearest = int(np.argmin(distance))
    new = Crossing(v, z, omega, int((distance <= TOGETHER).sum()), rises, float(values[nearest].real))
    if sum(_same(steps, new, old) for old in here) >= new.pairs:
        return False
    here.append(new)
    return True


def _same(steps: Steps, a: Crossing, b: Crossing) -> bool:
    near = np.linalg.norm((a.u - b.u) / steps.metric) <= TOGETHER
    return bool(near and abs(a.omega - b.omega) <= TOGETHER * a.omega)


def _notes(rest: Rest, names: dict[str, list[float]]) -> tuple[str, ...]:
    """Return a sentence for each thing that happens, with where."""
    sentences = {
        ON_IT: "eigenvalues stay on the imaginary axis {}: neutral there, no Hopf point",
        NOT_LOCATED: "a pair of eigenvalues crosses the imaginary axis {}, but the point is not located",
        TOUCHES: "a pair of eigenvalues comes to the imaginary axis {}, and no crossing is located",
        NO_DERIVATIVE: "the equations have no derivative at the equilibrium {}: no eigenvalues there",
    }
    found = []
    for name, values in names.items():
        low, high = min(values), max(values)
        where = (
            f"at {rest.parameter} = {low:.6g}" if low == high else f"from {rest.parameter} = {low:.6g} to {high:.6g}"
        )
        found.append(sentences[name].format(where))
    return tuple(found)
