"""Multi-harmonic balance: the unknowns are the Fourier coefficients and the frequency of the cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hbbogie.errors import ModelError, whole
from hbbogie.methods.assembly import Assembly
from hbbogie.methods.equations import Equations
from hbbogie.methods.layout import Layout, make_layout
from hbbogie.methods.scales import make_equations
from hbbogie.methods.size import check_size, is_sparse
from hbbogie.methods.sparse_assembly import SparseAssembly
from hbbogie.model.parts import is_odd
from hbbogie.model.system import System
from hbbogie.model.turns import check_advance


@dataclass(frozen=True)
class HarmonicBalance:
    """Multi-harmonic balance with the harmonics 0 ... H of the period.

    Parameters
    ----------
    harmonics : int
        Highest harmonic H; 0 gives the equations of the equilibria.
    samples : int, optional
        Samples per period for nonlinear forces that are not piecewise linear. The default 16 (H + 1) is free of
        aliasing for polynomial forces up to degree 15. Half as many are enough up to degree 7.
    odd : bool, optional
        Keep only the odd harmonics. By default this is done if the system is found to be odd for all parameter values.
        With True, it is enough that the system is odd at its present values. Derivatives with respect to the other
        parameters are still correct there, but at values that break the symmetry the equations no longer describe the
        cycles.
    condense : bool
        Eliminate the coordinates that enter linearly, harmonic by harmonic (eq-condensation). If more than
        20 enter nonlinearly none is eliminated, since the equations then have a sparse Jacobian.
    contact : bool
        Integrate piecewise-linear elements exactly between their contact times; otherwise sample them.
    phase : str, optional
        Coordinate whose sine coefficient of the first harmonic is zero; by default the first that enters
        nonlinearly.

    Examples
    --------
    Van der Pol's oscillator is odd, so only odd harmonics are kept. The sine coefficient of the first one is zero,
    which fixes the phase.

    >>> from hbbogie import load_problem
    >>> HarmonicBalance(3).equations(load_problem("van_der_pol").van_der_pol()).unknowns
    ('x, cosine of harmonic 1', 'x, cosine of harmonic 3', 'x, sine of harmonic 3', 'omega')
    """

    harmonics: int
    samples: int | None = None
    odd: bool | None = None
    condense: bool = True
    contact: bool = True
    phase: str | None = None

    def __post_init__(self) -> None:
        whole("HarmonicBalance: harmonics", self.harmonics, 0)
        if self.samples is not None and self.samples < 2 * (2 * self.harmonics + 1):
            raise ModelError(
                f"HarmonicBalance: samples={self.samples} for highest harmonic {self.harmonics}; give at least "
                f"{2 * (2 * self.harmonics + 1)}, or leave it out for {self.default_samples}."
            )
        if self.samples is not None and self.samples % 2:
            raise ModelError(f"HarmonicBalance: samples={self.samples}; give an even number.")

    @property
    def default_samples(self) -> int:
        """Default number of samples per period: 16 (H + 1)."""
        return 16 * (self.harmonics + 1)

    def kept(self, system: System, advance: tuple[float, ...] = ()) -> tuple[int, ...]:
        """Return the harmonics that are unknowns for this system; all where coordinates run on."""
        if advance and self.odd:
            raise ModelError("HarmonicBalance: odd=True, but motions that run on have all harmonics; leave odd out.")
        if advance:
            return tuple(range(self.harmonics + 1))
        odd = system.odd if self.odd is None and self.harmonics else bool(self.odd)
        if odd and not self.harmonics:
            raise ModelError("HarmonicBalance: odd=True leaves no harmonic of 0 ... 0; give harmonics of at least 1.")
        if self.odd and not (system.odd or is_odd(system.dynamics, system.vector())):
            raise ModelError(
                f"HarmonicBalance: odd=True, but system {system.name!r} is not odd at its parameter values: its cycles "
                "have a mean and even harmonics; leave odd out."
            )
        return tuple(h for h in range(self.harmonics + 1) if h % 2 or not odd)

    def check(self, system: System) -> None:
        """Raise `ModelError` where the equations of a system would take too much memory; it takes no time itself."""
        parts = system.parts(self.contact)
        samples = (self.samples or self.default_samples) if parts.remainder_rows else 0
        nonlinear = self.condense or is_sparse(system)
        count = (len(system.nonlinear_coordinates) or 1) if nonlinear else system.n
        odd = system.odd if self.odd is None else self.odd
        check_size(int(self.harmonics), samples, count, system, odd)

    def layout(self, system: System, kept: tuple[int, ...], advance: tuple[float, ...] = ()) -> Layout:
        """Return which coefficients of which coordinates are unknowns."""
        return make_layout(
            system,
            system.parts(self.contact, tuple(i for i, by in enumerate(advance) if by)),
            kept,
            H=self.harmonics,
            samples=self.samples or self.default_samples,
            condense=self.condense,
            phase=self.phase,
            advance=advance,
        )

    def equations(self, system: System) -> Equations:
        """Return the equations of the system's cycles (of its equilibria for H = 0).

        Raises
        ------
        ModelError
            When they would take more than 4 GB of memory; the message says how many harmonics do not.
        """
        return self._equations((), system)

    def _equations(self, advance: tuple[float, ...], system: System) -> Equations:
        self.check(system)
        _check_gaps(system)
        if advance:
            check_advance(system.dynamics, advance)
        kept = self.kept(system, advance)
        assembly = system.once((self, kept, advance), lambda: self._assembly(system, kept, advance))
        found = make_equations(system, assembly, f"harmonic balance, {_list(kept)}")
        with_even = replace(self, odd=False).equations if self.odd is None and 0 not in kept else None
        with_phase = None if self.phase else partial(_with_phase, self)
        return replace(found, with_phase=with_phase, with_even=with_even, running=self._equations)

    def _assembly(self, system: System, kept: tuple[int, ...], advance: tuple[float, ...]) -> Assembly | SparseAssembly:
        """Return the functions of the equations: of many coordinates those whose Jacobian is sparse."""
        if is_sparse(system) and self.harmonics and self.contact and not advance:
            return SparseAssembly(replace(self, condense=False).layout(system, kept), system)
        return Assembly(self.layout(system, kept, advance), system)


def _with_phase(method: HarmonicBalance, name: str, system: System) -> Equations:
    return replace(method, phase=name).equations(system)


def _check_gaps(system: System) -> None:
    """Raise `ModelError` where an element has a gap that is not finite at the system's parameter values."""
    for element in system.elements:
        gaps = np.empty(0) if element.ramps is None else element.ramps(system.vector())[3].full().ravel()
        if not np.isfinite(gaps).all():
            raise ModelError(
                f"element {element.name!r} ({element.law}): its gaps are {', '.join(f'{g:g}' for g in gaps)} at these "
                "parameter values; give values at which they are finite, or leave the element out."
            )


def _list(harmonics: Sequence[int]) -> str:
    if len(harmonics) == 1:
        return f"harmonic {harmonics[0]}"
    step = "odd " if harmonics[0] else ""
    return f"{step}harmonics {harmonics[0]} to {harmonics[-1]}"
