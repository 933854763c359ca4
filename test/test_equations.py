"""docs/equations.md and the code: every equation has a function that says so, and none is left out."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "equations.md"
EQUATIONS = [("Ye", n) for n in range(1, 9)] + [("Hirai", n) for n in range(1, 5)]
LINK = re.compile(r"\[`([\w.]+)`\]\(https://github\.com/depth-pose/depth_pose/blob/main/(src/[\w/]+\.py)\)")
LABEL = re.compile(r"(Ye|Hirai) et\s+al\.\s+eqs?\.\s+((?:\d+|,|and|to|\s)+)")


def numbers_of(text: str) -> set[int]:
    """Equations of ``3``, ``7, 8``, ``1 and 2`` or ``1 to 5``."""
    found = {int(n) for n in re.findall(r"\d+", text)}
    for low, high in re.findall(r"(\d+)\s+to\s+(\d+)", text):
        found |= set(range(int(low), int(high) + 1))
    return found


def labels_of(text: str) -> set[tuple[str, int]]:
    return {(paper, n) for paper, rest in LABEL.findall(text) for n in numbers_of(rest)}


@cache
def docstrings(path: str) -> dict[str, str]:
    """Docstrings of a module's functions, classes and methods, by their dotted names; "" is its own."""
    found: dict[str, str] = {}

    def collect(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                found[prefix + child.name] = ast.get_docstring(child) or ""
                collect(child, f"{prefix}{child.name}.")

    tree = ast.parse((ROOT / path).read_text())
    found[""] = ast.get_docstring(tree) or ""
    collect(tree, "")
    return found


@cache
def rows() -> dict[tuple[str, int], set[tuple[str, str]]]:
    """For each equation the functions that its row names, with their files."""
    found = {}
    for line in PAGE.read_text().splitlines():
        if match := re.match(r"\| (Ye|Hirai) (\d+) \|", line):
            key = (match[1], int(match[2]))
            assert key not in found, f"{key} has two rows"
            found[key] = set(LINK.findall(line.split(" | ")[2]))
    return found


def test_each_equation_has_a_row() -> None:
    assert sorted(rows()) == sorted(EQUATIONS)


@pytest.mark.parametrize(("paper", "number"), EQUATIONS)
def test_functions_of_a_row_carry_its_label(paper: str, number: int) -> None:
    functions = rows()[paper, number]
    assert functions
    for name, path in functions:
        assert name in docstrings(path), f"{path} has no {name}"
        assert (paper, number) in labels_of(docstrings(path)[name]), f"{name} does not say {paper} {number}"


def test_a_comment_marks_the_lines_of_each_equation() -> None:
    marks: dict[tuple[str, int], set[str]] = {}
    for file in sorted((ROOT / "src" / "depth_pose").rglob("*.py")):
        for paper, number in re.findall(r"# (Ye|Hirai) et al\. eq\. (\d+):", file.read_text()):
            marks.setdefault((paper, int(number)), set()).add(str(file.relative_to(ROOT)))
    assert sorted(marks) == sorted(EQUATIONS)
    for key, files in marks.items():
        assert files <= {path for _, path in rows()[key]}, f"{key} is marked in {files}"


def test_every_label_in_the_code_is_on_the_page() -> None:
    for file in sorted((ROOT / "src" / "depth_pose").rglob("*.py")):
        path = str(file.relative_to(ROOT))
        for name, text in docstrings(path).items():
            for key in labels_of(text):
                assert key in rows(), f"{path}: there is no {key}"
                if name:
                    assert (name, path) in rows()[key], f"{path}: {name} is not in the row of {key}"


def test_other_functions_on_the_page_exist() -> None:
    links = LINK.findall(PAGE.read_text())
    assert len(links) > len(EQUATIONS)
    for name, path in links:
        assert name in docstrings(path) or Path(path).stem == name, f"{path} has no {name}"


@pytest.mark.parametrize(
    ("text", "numbers"),
    [("eq. 6, for", {6}), ("eqs. 1 to 5)", {1, 2, 3, 4, 5}), ("eqs. 2 and 4", {2, 4}), ("eqs. 7, 8", {7, 8})],
)
def test_labels_are_read(text: str, numbers: set[int]) -> None:
    assert labels_of(f"as Ye et al. {text}") == {("Ye", n) for n in numbers}
