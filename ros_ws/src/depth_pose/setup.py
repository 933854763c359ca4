"""The package as colcon builds it; all that it says stands in the repository's pyproject.toml.

``src`` and ``launch`` are links to the repository's folders: colcon does not look for packages below
another package, so both packages have to lie side by side.
"""

from pathlib import Path

from setuptools import find_packages, setup

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    from pip._vendor import tomli as tomllib

ROOT = Path(__file__).resolve().parents[3]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
NODES = ("denoise", "matcher", "refine", "recovery", "volume", "fusion")
PROGRAMS = {
    **PROJECT["scripts"],
    **{f"{name}_node": f"depth_pose.ros.nodes.{name}_node:main" for name in NODES},
}

setup(
    name=PROJECT["name"],
    version=PROJECT["version"],
    description=PROJECT["description"],
    license=PROJECT["license"],
    maintainer=PROJECT["authors"][0]["name"],
    maintainer_email=PROJECT["authors"][0]["email"],
    python_requires=PROJECT["requires-python"],
    packages=find_packages("src"),
    package_dir={"": "src"},
    package_data=PYPROJECT["tool"]["setuptools"]["package-data"],
    zip_safe=False,
    entry_points={"console_scripts": [f"{name} = {where}" for name, where in PROGRAMS.items()]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/depth_pose"]),
        ("share/depth_pose", ["package.xml"]),
        ("share/depth_pose/launch", ["launch/depth_pose.launch.py", "launch/fusion.launch.py"]),
        (
            "share/depth_pose/config",
            ["launch/params.yaml", "launch/depth_pose.rviz", "launch/foxglove_layout.json"],
        ),
    ],
)
