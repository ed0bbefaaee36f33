"""Outputs measured along an orbit: integrals refined at kinks, and extremes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.errors import ModelError
from hbbogie.results.signal import Signal

if TYPE_CHECKING:
    from hbbogie.results.orbit import Orbit

Array = NDArray[np.float64]
Values = Callable[[Array], Array]  # phases, shape (N,) -> outputs, shape (N, m)

SAMPLES = 256  # kept of each output, equidistant
PANELS = 64, 256  # of the integration to begin with, at least and at most
NODES = np.array([-1.0, -np.sqrt(3 / 7), 0.0, np.sqrt(3 / 7), 1.0])  # of Lobatto: at both ends no jump is passed over
WEIGHTS = np.array([1 / 10, 49 / 90, 32 / 45, 49 / 90, 1 / 10])
MOST = 1024  # panels that are halved at once: an output that is rough all over is left at that
LEVELS = 30  # times that a panel with a kink is halved at most
ACCURACY = 1e-9  # of the integral over a panel, relative to the largest value times its length
ROUNDS, CLOSER = 7, 9  # of the search for an extreme; instants of each round


def measured(orbit: Orbit) -> dict[str, Signal]:
    """Return the outputs of an orbit's system along it, by name; none where the system names none.

    Parameters
    ----------
    orbit : Orbit
        Of a system with outputs, and not read from a file.
    """
    naming = orbit.naming
    if naming.measure is None:
        return {}

    def of(tau: Array) -> Array:
        return _along(orbit, tau / orbit.omega if orbit.H else 0 * tau)

    panels = int(np.clip(2 * (orbit.H + 1), *PANELS))
    tau, w, y = quadrature(of, panels) if orbit.H else (np.zeros(1), np.full(1, 2 * np.pi), of(np.zeros(1)))
    basis = fourier.synthesis(panels // 2 if orbit.H else 0, tau) / np.pi
    basis[:, 0] /= 2
    c = basis.T @ (w[:, None] * y)
    squares = w @ y**2 / (2 * np.pi)
    samples = of(fourier.phases(SAMPLES)) if orbit.H else np.repeat(y, SAMPLES, axis=0)
    low, high = _extremes(of, tau, y) if orbit.H else (y[0], y[0])
    return {
        name: Signal(
            name, naming.units.get(name, ""), naming.descriptions.get(name, ""), orbit.omega,
            samples[:, k], c[:, k], float(low[k]), float(high[k]), float(squares[k]),
            partial(_one_along, orbit, k),
        )
        for k, name in enumerate(naming.outputs)
    }  # fmt: skip


def measured_as(orbit: Orbit, name: str) -> Signal:
    """Return an output of an orbit by its name; raise `ModelError` where it was lost."""
    if name not in orbit.outputs:
        raise ModelError(
            f"output {name!r} is not known any more: the orbit was read from a file, which holds its outputs, and then "
            "changed; solve for the changed orbit, or ask the orbit as it was read."
        )
    return orbit.outputs[name]


def resting(orbit: Orbit) -> Orbit:
    """Return the orbit of a Hopf point, which shows the mode, with the outputs of the equilibrium recorded."""
    return orbit.replace(recorded=orbit.replace(coefficients=orbit.coefficients[:1], recorded=orbit.recorded).outputs)


def _along(orbit: Orbit, t: Array) -> Array:
    """Return the outputs at times t [s], shape (len(t), number of outputs)."""
    measure = orbit.naming.measure
    assert measure is not None
    return measure(orbit.q(t), orbit.v(t), np.array(list(orbit.parameters.values())))


def _one_along(orbit: Orbit, k: int, t: Array) -> Array:
    return _along(orbit, t)[:, k]


def quadrature(of: Values, panels: int = PANELS[0]) -> tuple[Array, Array, Array]:
    """Return phases, weights and values that integrate the outputs and their squares over the period.

    Panels are halved until both halves agree with the whole, that is, down to the kinks.
    """
    left, length = fourier.phases(panels), np.full(panels, 2 * np.pi / panels)

    def values(left: Array, length: Array) -> tuple[Array, Array]:
        tau = left[:, None] + length[:, None] * (NODES + 1) / 2
        return tau, of(tau.ravel()).reshape(*tau.shape, -1)

    _, y = values(left, length)
    scale, kept = np.abs(y).max(axis=(0, 1)), []
    for level in range(LEVELS):
        halves = np.stack([left, left + length / 2], axis=1).ravel(), np.repeat(length / 2, 2)
        finer, own = values(*halves)
        scale = np.maximum(scale, np.abs(own).max(axis=(0, 1)))
        off = np.zeros(len(left), dtype=bool)
        for power in (1, 2):
            whole = np.einsum("i,nij->nj", WEIGHTS / 2, y**power)
            both = np.einsum("i,nij->nj", WEIGHTS / 4, own**power).reshape(len(left), 2, -1).sum(axis=1)
            share = (length / (2 * np.pi))[:, None]  # what a panel adds to the mean
            off |= (share * np.abs(whole - both) > ACCURACY / panels * scale**power).any(axis=1)
        split = np.repeat(off, 2) & (level + 1 < LEVELS and len(left) < MOST)
        kept.append((finer[~split], halves[1][~split], own[~split]))
        left, length, y = halves[0][split], halves[1][split], own[split]
        if not len(left):
            break
    nodes = np.concatenate([k[0].ravel() for k in kept])
    weights = np.concatenate([(k[1][:, None] * WEIGHTS / 2).ravel() for k in kept])
    return nodes, weights, np.concatenate([k[2].reshape(-1, y.shape[-1]) for k in kept])


def _extremes(of: Values, tau: Array, y: Array) -> tuple[Array, Array]:
    """Return the smallest and largest value of each output, from the best of many phases by ever smaller steps."""
    m, order = y.shape[1], np.argsort(tau)
    tau, y = tau[order], y[order]
    gap = np.r_[np.diff(tau), tau[0] + 2 * np.pi - tau[-1]]
    best = np.r_[y.argmin(axis=0), y.argmax(axis=0)]
    at, step = tau[best], np.maximum(gap[best], gap[best - 1])
    sign, column = np.r_[-np.ones(m), np.ones(m)], np.tile(np.arange(m), 2)
    value = y[best, column]
    for _ in range(ROUNDS):
        near = at[:, None] + step[:, None] * np.linspace(-1, 1, CLOSER)
        own = of(near.ravel()).reshape(2 * m, CLOSER, m)[np.arange(2 * m), :, column]
        place = (sign[:, None] * own).argmax(axis=1)
        at, step = near[np.arange(2 * m), place], step * 2 / (CLOSER - 1)
        value = sign * np.maximum(sign * value, sign * own[np.arange(2 * m), place])
    return value[:m], value[m:]
