"""A small problem and jobs on it, for the tests of studies: written to files, run in real processes."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import hbbogie

PROBLEM = '''"""A spring."""
from hbbogie import Coordinate, Parameter, System

def spring(**values):
    x, k, c = Coordinate("x", "m"), Parameter("k", 2.0, "N/m", "stiffness", (0.0, 100.0)), Parameter("c", 1.0, "N s/m")
    return System("spring", [x], [k, c], [x.ddot + c * x.dot + k * x]).with_parameters(**values)

SYSTEM = spring
'''

JOBS = '''"""Jobs on the spring."""
import os, signal, time

def product(system, wait=0.0):
    time.sleep(wait)
    k, c = system.values["k"], system.values["c"]
    return {"product": k * c, "third": k / 3, "name": f"{k:g} times {c:g}", "status": "multiplied"}

product.units = {"product": "N2 s/m2"}

def linear(system):
    return {"y": 3 * system.values["k"] - 2 * system.values["c"] + 1, "dy_dk": 3.0, "dy_dc": -2.0}

def picky(system):
    if system.values["k"] > 3:
        raise ValueError("too stiff\\nand a second line")
    if system.values["c"] > 3:
        return {"y": 1.0, "status": "undecided", "failed": True}
    return {"y": float("nan")}

def deadly(system):
    if system.values["k"] == 3.0:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"y": system.values["k"]}

def deadlier(system):
    if system.values["k"] > 3.0:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"y": system.values["k"]}

def leaving(system):
    if system.values["k"] == 3.0:
        raise SystemExit("enough")
    if system.values["k"] == 4.0:
        raise KeyboardInterrupt
    return {"y": system.values["k"]}

def hanging(system):
    if system.values["k"] == 3.0:
        time.sleep(1000)
    return {"y": system.values["k"]}

def stubborn(system):
    """As helpers of CasADi do with what ends it."""
    try:
        time.sleep(1000)
    except BaseException:
        return {"y": 1.0}

def swallowing(system, raising=True):
    """As helpers of CasADi do: Ctrl-C becomes another exception, or nothing."""
    if system.values["k"] == 3.0:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(10)
        except KeyboardInterrupt:
            if raising:
                raise NotImplementedError("Wrong number or type of arguments") from None
    return {"y": system.values["k"]}

def noisy(system, folder="."):
    print("printed")
    os.system("echo printed by another process")
    os.chdir(folder)
    return {"y": system.values["k"]}

def named(system, name="point", value=1.0):
    return {name: value}

def nothing(system):
    pass

def needy(system, share):
    return {"y": share}

def alone():
    return {"y": 1.0}
'''

STUDY = """title = "Products"
problem = "spring.py"
job = "jobs.py:product"

[options]
wait = {wait}

[points]
sample = "grid"

[points.parameters]
k = {{ low = 1.0, high = 8.0, count = 8 }}
c = [1.0, 2.0, 3.0, 4.0, 5.0]
"""


def write_study(folder: Path, wait: float = 0.0) -> Path:
    (folder / "spring.py").write_text(PROBLEM)
    (folder / "jobs.py").write_text(JOBS)
    path = folder / "products.toml"
    path.write_text(STUDY.format(wait=wait))
    return path


def process(*args: object, **options) -> subprocess.Popen:
    environment = os.environ | {"PYTHONPATH": str(Path(hbbogie.__file__).parent.parent), "PYTHONWARNINGS": ""}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "env": environment}
    return subprocess.Popen([sys.executable, "-m", *map(str, args)], **(pipes | options))


def wait_for(condition, what: str, seconds: float = 60.0):
    """Return what the condition returns as soon as it is true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.02)
    raise AssertionError(f"waited {seconds} s for {what}")


def finished(store: Path) -> int:
    """Return the number of finished points, 0 as long as there is no store."""
    from hbbogie import ModelError
    from hbbogie.studies import Store

    try:
        keep = Store.read(store)
    except ModelError:
        return 0
    done = keep.counts().done
    keep.close()
    return done
