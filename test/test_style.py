"""The checks of style, types and arrows, as tests, so that pytest's last line speaks for everything."""

import ast
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
