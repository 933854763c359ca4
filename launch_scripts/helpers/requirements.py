"""Print requirements of pyproject.toml, one a line: ``requirements.py NAME...``.

A NAME is an extra, or a package among the project's dependencies.
"""

import re
import sys
from pathlib import Path

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    from pip._vendor import tomli as tomllib

project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
by_package = {re.split(r"[^\w-]", line)[0]: [line] for line in project["dependencies"]}
for name in sys.argv[1:]:
    print("\n".join(project["optional-dependencies"].get(name) or by_package[name]))
