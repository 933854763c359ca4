"""Change a constant of one module on import, as ``CHANGED_CONSTANT=depth_pose.rooms.watch:MOVED_M:2`` says.

Python imports this before anything else where ``PYTHONPATH`` names its folder, in child processes, too.
"""

from __future__ import annotations

import ast
import os
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from typing import Any

_MODULE, _NAME, _FACTOR = os.environ["CHANGED_CONSTANT"].split(":")


class _Loader(SourceFileLoader):
    """Loads a module with the line ``NAME = times(NAME, FACTOR)`` behind NAME's own."""

    def get_code(self, fullname: str) -> Any:
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path))
        body = list[ast.stmt]()
        for statement in tree.body:
            body.append(statement)
            targets = getattr(statement, "targets", [getattr(statement, "target", None)])
            named = [n.id for t in targets if t is not None for n in ast.walk(t) if isinstance(n, ast.Name)]
            if isinstance(statement, ast.Assign | ast.AnnAssign) and _NAME in named:
                line = f"import factors\n{_NAME} = factors.times({_NAME}, {_FACTOR})"
                body += ast.parse(line).body
        return compile(ast.Module(body, []), path, "exec")


class _Finder(MetaPathFinder):
    """Finds the module whose constant is changed."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path, target) if fullname == _MODULE else None
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin)
        return spec


sys.meta_path.insert(0, _Finder())
