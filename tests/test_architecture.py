"""The shape of the package: who imports whom, how long things are."""

from __future__ import annotations

import ast
from pathlib import Path

import hbbogie

PACKAGE = Path(hbbogie.__file__).parent
# imports go down, or sideways without a circle
FLOORS = {
    "errors": 0, "fourier": 0, "ramps": 0, "processes": 0,
    "laws": 1, "elements": 1, "results": 1,
    "analysis": 2, "system": 2,
    "equations": 3, "integration": 3, "settling": 3, "variation": 3, "stability": 3, "hill": 3, "shooting": 3,
    "jumps": 3, "eigenvalues": 3,
    "methods": 4, "solvers": 4, "optimum": 4, "rootfinding": 4, "ramp": 4, "minimax": 4,
    "guesses": 5, "verification": 5, "normal_form": 5, "solution_curve": 5, "switching": 5, "arclength": 5,
    "settled": 5,
    "bifurcations": 6, "onset": 6, "continuation": 6, "cycles": 6, "hopf_curve": 6, "following": 6, "probe": 6,
    "identification": 6, "misfit": 6, "attraction": 6, "outcomes": 6,
    "fold_curve": 7, "critical": 7, "coexistence": 7, "isolated": 7, "critical_report": 7, "plot": 7, "curves": 7,
    "tables": 7, "figures": 7, "motion": 7, "report": 7, "problem": 7, "comparison": 7, "comparison_report": 7,
    "charts": 7, "chart_report": 7, "basin": 7, "time_domain": 7, "hysteresis": 7, "curvature": 7, "design_point": 7,
    "criteria": 7, "design_task": 7, "design": 7, "single_level": 7, "robust": 7, "design_report": 7, "studies": 7,
    "terminal": 8, "commands": 8, "cli_methods": 8, "cli_chart": 8, "cli": 8, "benchmark": 8, "__main__": 8,
    "cli_motion": 8, "cli_design": 8, "cli_study": 8,
}  # fmt: skip


def _modules():
    for path in sorted(PACKAGE.rglob("*.py")):
        relative = path.relative_to(PACKAGE)
        if relative.parts[0] == "problems" or str(relative) == "__init__.py":
            continue
        yield path, relative.parts[0].removesuffix(".py")


def _imports(path, top_level_only=False):
    """Names of the package's modules that a file imports; imports for type checking do not count."""
    tree = ast.parse(path.read_text())
    typing_only = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and getattr(block.test, "id", "") == "TYPE_CHECKING"
        for node in ast.walk(block)
    }
    nodes = tree.body if top_level_only else list(ast.walk(tree))
    for node in nodes:
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            if node.module == "hbbogie":
                yield from (alias.name for alias in node.names)
            elif node.module.startswith("hbbogie."):
                yield node.module.split(".")[1]
            else:
                yield "external:" + node.module.split(".")[0]
        elif isinstance(node, ast.Import):
            yield from ("external:" + alias.name.split(".")[0] for alias in node.names)


def test_every_module_has_a_floor():
    assert {name for _, name in _modules()} <= set(FLOORS)


def test_imports_do_not_go_up():
    for path, name in _modules():
        for imported in _imports(path):
            if imported in FLOORS and FLOORS[name] < 8:
                assert FLOORS[imported] <= FLOORS[name], f"{path.name} imports {imported}"


def test_no_circles():
    edges = {}
    for path, name in _modules():
        edges.setdefault(name, set()).update(i for i in _imports(path) if i in FLOORS and i != name)
    done, active = set(), []

    def visit(name):
        assert name not in active, f"circle: {' -> '.join([*active, name])}"
        if name in done:
            return
        active.append(name)
        for other in edges.get(name, ()):
            visit(other)
        active.pop()
        done.add(name)

    for name in edges:
        visit(name)


def test_only_plot_imports_matplotlib():
    for path, name in _modules():
        if name != "plot":
            assert "external:matplotlib" not in set(_imports(path)), path


def test_plot_imports_results_only():
    for path, name in _modules():
        if name == "plot":
            assert set(_imports(path)) & set(FLOORS) <= {"results", "errors", "fourier", "plot"}, path


def test_methods_do_not_import_solvers():
    for path, name in _modules():
        if name == "methods":
            assert "solvers" not in set(_imports(path)), path


def test_modules_and_functions_are_short():
    for path, _ in _modules():
        text = path.read_text()
        assert text.count("\n") <= 350, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                documentation = ast.get_docstring(node, clean=False) or ""
                length = node.end_lineno - node.lineno - documentation.count("\n")
                assert length <= 65, f"{path.name}: {node.name} has {length} lines without its docstring"
