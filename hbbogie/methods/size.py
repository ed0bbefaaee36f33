"""What harmonic balance takes of memory and time, told before anything is built."""

from __future__ import annotations

from hbbogie.errors import ModelError
from hbbogie.model.system import System

LARGEST = 4e9  # memory that the equations and their derivatives may take [bytes]
# measured on systems of one to three nonlinear coordinates with 63 to 511 harmonics, right within a factor of 1.5
PER_ENTRY, PER_SAMPLE = 100, 12  # numbers of 8 bytes for each entry of the Jacobian, and of the matrix of all samples
PER_BLOCK = 100  # the same for each nonlinear coordinate and pair of harmonics where the Jacobian is sparse
MANY = 20  # coordinates that enter nonlinearly beyond which the Jacobian is sparse
MANY_STATES = 64  # beyond which state matrices are taken as sparse, and cycles are not polished by shooting
SECONDS = 12e-9  # time to build them, for each byte [s]


def is_sparse(system: System) -> bool:
    """Tell whether the balance of a system is assembled and solved with a sparse Jacobian, without condensation."""
    return len(system.nonlinear_coordinates) > MANY


def has_many_states(system: System) -> bool:
    """Tell whether full matrices over the states, one for each step of a period, would take too long."""
    return system.n_states > MANY_STATES


def has_coupled_groups(system: System) -> bool:
    """Tell whether motions of groups of bodies lead to cycles sooner than branches, which are many and take long."""
    return has_many_states(system) and len(system.groups) > 1


def check_size(harmonics: int, samples: int, coordinates: int, system: System, odd: bool) -> None:
    """Raise `ModelError` where the equations of so many harmonics would take too much memory.

    Parameters
    ----------
    harmonics : int
        The highest.
    samples : int
        Per period, 0 where nothing is sampled.
    coordinates : int
        Those whose coefficients are unknowns, or, where the Jacobian is sparse, those that enter nonlinearly.
    system : System
    odd : bool
        Whether only odd harmonics are kept.
    """
    of_one = harmonics * (1 if odd else 2)
    unknowns = coordinates * of_one
    entries = PER_BLOCK * unknowns * of_one if is_sparse(system) else PER_ENTRY * unknowns**2
    size = 8.0 * (entries + PER_SAMPLE * samples * 2 * harmonics)
    if size > LARGEST:
        most = int(harmonics * (LARGEST / size) ** 0.5)  # the size goes with the square
        raise ModelError(
            f"HarmonicBalance: harmonics={harmonics} of {system.name!r} are {unknowns} unknowns, whose equations would "
            f"take about {size / 1e9:.3g} GB of memory and {_time(SECONDS * size)} to build; the limit is "
            f"{LARGEST / 1e9:g} GB. Give at most {max(most, 1)}. A cycle that takes more is one for shooting, as in "
            "find_cycles(..., harmonics='auto')."
        )


def _time(seconds: float) -> str:
    for unit, length in (("years", 3.15e7), ("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.3g} s"
