"""Describing functions of laws with several inputs, such as creep laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, told
from hbbogie.results.measuring import quadrature

Array = NDArray[np.float64]


def first_harmonics(force: Callable[..., Any], *inputs: complex) -> NDArray[np.complex128]:
    """Return the first harmonics of forces whose inputs are all sinusoidal, of one frequency.

    This is the describing function of a law with several inputs. The input c cos(tau) + s sin(tau) is given as the
    complex amplitude c - i s, and forces are returned likewise. A force over an input is an equivalent coefficient:
    ``-Fx / xi`` is the longitudinal creep coefficient of a creep law at these amplitudes. It has an imaginary part
    where the phases of the inputs differ by other than a quarter of a period. `DescribingFunction` and the method
    "df1" of `compare` take all nonlinear forces in this way.

    Parameters
    ----------
    force : callable
        Takes arrays, one for each input, and returns a force or several, such as ``law.force`` of a creep law.
    *inputs : complex, unit of each input
        Amplitudes; a real one is that of a cosine.

    Returns
    -------
    ndarray of complex, shape (number of forces,), unit of the forces
        By integration that is refined at kinks, to about 1e-9 of the largest force.

    Raises
    ------
    ModelError
        For amplitudes or forces that are not finite, and another number of inputs than the forces take.

    References
    ----------
    A. Gelb, W. E. Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, McGraw-Hill 1968.

    Examples
    --------
    How the creep coefficients fall with the amplitude of the creepages:

    >>> from hbbogie.railway import ShenHedrickElkins
    >>> law = ShenHedrickElkins(f11=9.4e6, f22=8.7e6, limit=16.4e3)
    >>> xi, eta = 1e-3, 2e-3j  # the lateral creepage a quarter of a period ahead
    >>> Fx, Fy = first_harmonics(law.force, xi, eta)
    >>> [round(float(coefficient), 3) for coefficient in ((-Fx / xi).real / 9.4e6, (-Fy / eta).real / 8.7e6)]
    [0.781, 0.716]
    """
    try:
        w = np.array(inputs, dtype=complex)
    except (TypeError, ValueError):
        w = np.full(1, np.nan, dtype=complex)
    if w.ndim != 1 or not len(w) or not np.isfinite(w).all():
        raise ModelError(f"first_harmonics: got the inputs {told(inputs)}; give finite amplitudes, one for each input.")

    def along(tau: Array) -> Array:
        try:
            forces = np.atleast_2d(np.asarray(force(*(w[:, None] * np.exp(1j * tau)).real), dtype=float))
        except TypeError as error:
            raise ModelError(
                f"first_harmonics: the forces cannot be evaluated with {len(w)} input(s): {error}."
            ) from None
        if forces.shape[1:] != tau.shape or not np.isfinite(forces).all():
            raise ModelError(
                "first_harmonics: the forces are not finite, or not one for each instant; give a function of arrays "
                "that returns arrays, such as law.force."
            )
        return forces.T

    tau, weights, values = quadrature(along)
    return np.asarray((weights * np.exp(-1j * tau)) @ values / np.pi)
