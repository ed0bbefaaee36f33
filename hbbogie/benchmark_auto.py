"""The bogie's branch by AUTO-07p, from the files that `hbbogie export --to auto` writes."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from hbbogie import find_cycles, load_problem
from hbbogie.exchange import to_auto


def traced_by_auto() -> tuple[float, int, float] | None:
    """Follow the branch of Yang's bogie from 190 m/s around its fold, with multipliers, three times.

    Returns
    -------
    (float, int, float) or None
        Shortest time by AUTO's own clock [s], number of points, and the fold [m/s]; None where AUTO is not on the path.
    """
    if shutil.which("auto") is None:
        return None
    system = load_problem("yang1995").bogie(V=189.0)
    cycle = next(c for c in find_cycles(system) if c.verdict == "stable")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in to_auto(system, cycle, "V", (60.0, 190.0)).items():
            text = text.replace("NMX = 300", "NMX = 60")  # to the fold and beyond, and not into the vertical family
            Path(folder, name).write_text(text)
        Path(folder, "once.auto").write_text("run('yang_s_bogie', DS='-')\n")
        done = [subprocess.run(["auto", "once.auto"], cwd=folder, capture_output=True, text=True) for _ in range(3)]
    spent = min(float(value) for one in done for value in re.findall(r"Total Time +(\S+)", one.stdout))
    folds = re.findall(r"LP +\d+ +(\S+)", done[-1].stdout)
    points = re.findall(r"^ +1 +(\d+)  (?:EP|UZ|MX)", done[-1].stdout, re.MULTILINE)
    return spent, int(points[-1]), min(map(float, folds))
