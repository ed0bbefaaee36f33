"""What one sees in the figures of reports."""

from __future__ import annotations

CAPTIONS = {
    "amplitude": "Peak of the cycles over the parameter. Solid blue cycles are stable, dashed orange ones unstable; a "
    "motion leaves the latter to either side.",
    "frequency": "Frequency of the cycles over the parameter, stable ones solid, unstable ones dashed.",
    "multipliers": "Multipliers of each cycle. Disturbances grow with those outside the unit circle; one is always 1.",
    "phase_portrait": "Velocity over displacement during one period of each cycle.",
    "waveform": "One period of every coordinate.",
    "spectrum": "Amplitudes of the harmonics of each cycle. Where they fall to nothing, the series is long enough.",
    "backbone": "Peak over frequency of cycles of every amplitude, as in a conservative system.",
    "tornado": "Change of each critical value, in per cent, when a parameter is raised by one per cent.",
    "chart": "Folds and Hopf points in the plane of both parameters. Between the curves rest and cycles coexist.",
    "comparison": "Left: the cycles by each method. Right: their errors against the converged ones.",
    "basin": "How motions end, by the parameter and the size of the initial disturbance.",
    "hysteresis": "Amplitude while the parameter slowly falls and rises, over the branches of cycles.",
    "delays": "How far beyond the critical value oscillation dies out or starts, by the rate of change.",
    "time_history": "The motion over time.",
    "bifurcation": "Peaks of the cycles over the parameter, over the whole range and about the fold. Stable ones are "
    "solid, unstable ones dashed.",
    "gains": "What is gained for each per cent by which a limit or bound is relaxed.",
    "distribution": "Distribution of the result over the sampled inputs.",
    "sensitivity": "Share of the variance that each input causes, alone and together with others, with 95 % intervals.",
    "map": "The result in the plane of two inputs.",
    "scatter": "One result over another, a dot for each point of the study.",
    "parallel": "One line for each point of the study: its inputs, coloured by the result.",
    "prediction": "What the gradient at the nominal point predicts, over what was computed.",
    "conicity": "Equivalent conicity over the amplitude of the lateral motion.",
    "contact": "Where wheel and rail touch for each lateral shift.",
}


def caption_of(name: str) -> str:
    """Return what one sees in the figure of that name; the name itself in words where nothing more is known."""
    own = name.removeprefix("branch_").strip("0123456789_")
    found = [key for key in CAPTIONS if own == key or own.endswith(f"_{key}") or name.endswith(key)]
    return CAPTIONS[max(found, key=len)] if found else f"{name.replace('_', ' ').strip().capitalize()}."
