"""Whether the points of profiles are close enough for the conicity: what changes without every other one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.errors import ModelError
from hbbogie.railway.conicity import equivalent_conicity
from hbbogie.railway.contact import contact_geometry
from hbbogie.railway.profiles import FEWEST, Profile

Array = NDArray[np.float64]


def sampling_error(
    wheel: Profile,
    rail: Profile,
    shift: ArrayLike,
    amplitude: ArrayLike,
    *,
    left_wheel: Profile | None = None,
    left_rail: Profile | None = None,
    **geometry: Any,
) -> dict[str, Array]:
    """Return by how much the equivalent conicity changes where every other point of the profiles is left out.

    This bounds the error from the distance of the points: the cubic spline through all of them is some ten times closer
    to the profile than one through half of them. Where the error matters, give points that are closer together.

    Parameters
    ----------
    wheel, rail : Profile
        Of both sides, or of the right one.
    shift : array_like, shape (m,), mm
        Lateral shifts at which the contact is computed, as of `contact_geometry`.
    amplitude : array_like, shape (n,), mm
    left_wheel, left_rail : Profile, optional
        Of the left side.
    **geometry
        Other keywords of `contact_geometry`.

    Returns
    -------
    dict of ndarray, shape (n,)
        For "wheel" and "rail", the larger of the changes without the even and without the odd points of those
        profiles; infinite where no contact or no conicity is found without them, NaN where there is none with them.

    Raises
    ------
    ModelError
        As `contact_geometry` and `equivalent_conicity`.

    Examples
    --------
    >>> import numpy as np
    >>> from hbbogie.railway import Profile, s1002_height, sampling_error, uic60
    >>> shift, points = np.linspace(-8.0, 8.0, 161), np.arange(-65.0, 60.0, 5.0)
    >>> wheel = Profile("every 5 mm", points, s1002_height(points))
    >>> bool(sampling_error(wheel, uic60(), shift, [3.0])["wheel"][0] > 0.05)
    True
    """
    given = {"wheel": wheel, "rail": rail, "left_wheel": left_wheel, "left_rail": left_rail}
    reference, changes = _conicity(given, shift, amplitude, geometry), {}
    for part in ("wheel", "rail"):
        rows = []
        for first in (0, 1):
            try:
                thinned = {
                    name: _thinned(profile, first) if profile is not None and name.endswith(part) else profile
                    for name, profile in given.items()
                }
                rows.append(np.abs(_conicity(thinned, shift, amplitude, geometry) - reference))
            except ModelError:  # there are too few points, or half of them make no wheel on a rail
                rows.append(np.full_like(reference, np.inf))
        worst = np.where(np.isnan(rows), np.inf, rows).max(axis=0)
        changes[part] = np.where(np.isnan(reference), np.nan, worst)
    return changes


def _conicity(
    profiles: Mapping[str, Profile | None], shift: ArrayLike, amplitude: ArrayLike, geometry: Mapping[str, Any]
) -> Array:
    options: dict[str, Any] = {**profiles, **geometry}
    contact = contact_geometry(shift=shift, **options)
    return equivalent_conicity(shift, contact.radius_difference, amplitude).equivalent


def _thinned(profile: Profile, first: int) -> Profile:
    """Return a profile by every other of its points and both ends."""
    kept = np.arange(len(profile.y)) % 2 == first
    kept[[0, -1]] = True
    if kept.sum() < FEWEST:
        raise ModelError(f"profile {profile.name!r}: it has {len(kept)} points, too few to leave some out.")
    return Profile(profile.name, profile.y[kept], profile.z[kept])
