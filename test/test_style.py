"""The checks of style, types and arrows, as tests, so that pytest's last line speaks for everything."""

import ast
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def _check(*command):
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_lint():
    _check("ruff", "check", ".")


def test_format():
    _check("ruff", "format", "--check", ".")


def test_types():
    _check("mypy")


def test_arrows_run_one_way():
    """`pyproject.toml` has the house: who may import whom, and no circle of files."""
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_kernels_with_fast_arithmetic_are_inlined_into_kernels():
    """What a kernel calls is compiled with it, and by itself as well; the process that compiles both may
    take the latter, those that load the kernel from the cache take the former. Fast arithmetic would
    give them different bits, unless nothing is left to call.
    """
    fast: dict[str, str] = {}
    called: set[str] = set()
    for path in (ROOT / "src").rglob("*.py"):
        for function in ast.walk(ast.parse(path.read_text())):
            if not isinstance(function, ast.FunctionDef):
                continue
            compiled = [ast.unparse(d) for d in function.decorator_list if "njit" in ast.unparse(d)]
            if not compiled:
                continue
            calls = (n.func for n in ast.walk(function) if isinstance(n, ast.Call))
            called |= {c.id if isinstance(c, ast.Name) else getattr(c, "attr", "") for c in calls}
            if "fastmath=True" in compiled[0] and "inline" not in compiled[0]:
                fast[function.name] = f"{path.relative_to(ROOT)}: {function.name}"
    assert [where for name, where in fast.items() if name in called] == []


PRIVATE_USED = {
    "test_articulated.py": {"_REACH"},  # kernels and their NumPy twins share a constant
    "test_personal.py": {"_node_shifts", "_fill_row"},  # kernels compared with NumPy twins
    "test_contact.py": {"_closest"},  # as well
    "test_viewer_gate.py": {"_gui_input_handle_from_uuid"},  # viser offers no public list of its inputs
    "test_tracker.py": {"_repr_html_"},  # the name that notebooks ask for
    # a busy machine needs longer than the supervisor grants; xdist offers no public place for a dead worker
    "conftest.py": {"_STOP_PATIENCE_S", "_reschedule"},
    "decoders_files.py": {"_expected_crc"},  # zipfile cannot read past a wrong checksum otherwise
}
"""Underscore names that tests may use, by file. A test module that needs another is given a public one."""


def test_tests_use_public_names():
    """Tests import and reach for no underscore name of another module, but for a few with a reason.

    Modules ``_NAME_kernels`` and the like may be imported: their functions are compared with NumPy.
    """
    tuples = {"_replace", "_asdict", "_fields", "_make", "_exit"}
    private = re.compile(r"_[A-Za-z]\w*(?<!__)").fullmatch
    used: dict[str, set[str]] = {}
    for path in sorted((ROOT / "test").rglob("*.py")):
        found = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("depth_pose."):
                found |= {
                    a.name for a in node.names if private(a.name) and not _is_module(node.module, a.name)
                }
            elif isinstance(node, ast.Attribute) and ast.unparse(node.value) not in ("self", "cls"):
                found |= {node.attr} if private(node.attr) else set()
            elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("setattr", "getattr")):
                names = [a.value for a in node.args if isinstance(a, ast.Constant)]
                found |= {n for n in names if isinstance(n, str) and private(n)}
        used[path.name] = used.get(path.name, set()) | (found - tuples)
    assert {name: found for name, found in used.items() if found} == PRIVATE_USED


def _is_module(package: str, name: str) -> bool:
    return (ROOT / "src" / package.replace(".", "/") / f"{name}.py").exists()
