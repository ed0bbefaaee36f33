"""What harmonic balance takes of memory and time, told before anything is built."""

from __future__ import annotations

from hbbogie.errors import ModelError

LARGEST = 4e9  # memory that the equations and their derivatives may take [bytes]
# measured on systems of one to three nonlinear coordinates with 63 to 511 harmonics, right within a factor of 1.5
PER_ENTRY, PER_SAMPLE = 100, 12  # numbers of 8 bytes for each entry of the Jacobian, and of the matrix of all samples
SECONDS = 12e-9  # time to build them, for each byte [s]


def check_size(harmonics: int, samples: int, coordinates: int, system: str, odd: bool) -> None:
    """Raise `ModelError` where the equations of so many harmonics would take too much memory.

    Parameters
    ----------
    harmonics : int
        The highest.
    samples : int
        Per period, 0 where nothing is sampled.
    coordinates : int
        Those whose coefficients are unknowns.
    system : str
        Its name, for people.
    odd : bool
        Whether only odd harmonics are kept.
    """
    unknowns = coordinates * harmonics * (1 if odd else 2)
    size = 8.0 * (PER_ENTRY * unknowns**2 + PER_SAMPLE * samples * 2 * harmonics)
    if size > LARGEST:
        most = int(harmonics * (LARGEST / size) ** 0.5)  # the size goes with the square
        raise ModelError(
            f"HarmonicBalance: harmonics={harmonics} of {system!r} are {unknowns} unknowns, whose equations would take "
            f"about {size / 1e9:.3g} GB of memory and {_time(SECONDS * size)} to build; the limit is "
            f"{LARGEST / 1e9:g} GB. Give at most {max(most, 1)}. A cycle that takes more is one for shooting, as in "
            "find_cycles(..., harmonics='auto')."
        )


def _time(seconds: float) -> str:
    for unit, length in (("years", 3.15e7), ("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.3g} s"
