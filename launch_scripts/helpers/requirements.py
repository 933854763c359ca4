"""Print requirements of pyproject.toml, one a line: ``requirements.py NAME...``.

A NAME is an extra, a dependency group, a package among the project's dependencies, or ``dependencies``
for all of them.
"""

import re
import sys
from pathlib import Path

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    from pip._vendor import tomli as tomllib

pyproject = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
project = pyproject["project"]
dependencies = project["dependencies"]
known = {re.split(r"[^\w-]", line)[0]: [line] for line in dependencies}
known |= {"dependencies": dependencies, **project["optional-dependencies"], **pyproject["dependency-groups"]}
for name in sys.argv[1:]:
    print("\n".join(known[name]))
