"""Make the embedded body's file from its tables of proportions.

python tools/body/make_template.py -o src/depth_pose/body/data/procedural.npz

The implicit surface (`anatomy`, `surface`) is meshed over the half x >= 0, thinned (`remesh`),
mirrored, scaled to the stature and given skin weights (`weights`). Takes some seconds.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from anatomy import BodyField, reference_nodes
from depth_pose.body.body import Body
from depth_pose.body.files import save_body
from depth_pose.body.procedural import TEMPLATE
from depth_pose.core.skeleton import ADULT_STATURE_M, NODE_INDEX
from remesh import mirror, remesh_half
from surface import Array, Mesh, sample_grid, surface_nets
from weights import skin_weights

COMMAND = "python tools/body/make_template.py -o src/depth_pose/body/data/procedural.npz"

_GRID = 0.011
"""Step of the grid, metres: finer than the thinnest part, the toes (0.02 m). Set by hand; not swept."""
_LOW = np.array([-1.5 * _GRID, -0.0301, -0.18])
"""First node of the grid, metres: below the sole, behind the heels, beyond the mid-plane."""
_COUNTS = (68, 168, 40)
"""Nodes of the grid along x, y and z: past fingers, crown and toes."""

_EDGE_M = 0.036
"""Wished edge length, metres; some 2,000 vertices come of it."""
_FINE = (("left_wrist", 0.20, 0.019), ("left_foot", 0.17, 0.025), ("head", 0.16, 0.027))
"""Node, radius about it and wished edge length within, metres; set by hand for hands, feet and head."""
_COARSER = 0.12
"""How fast the wished length grows outside those radii, metres a metre; set by hand."""


def make_template() -> Body:
    """Make the body of `BodyShape()`. Deterministic."""
    field = BodyField()
    mesh = mirror(remesh_half(_fine_half(field), field, _edge_length))
    height = float(mesh.vertices[:, 1].max())
    nodes = reference_nodes()
    weights = skin_weights(mesh, nodes, field)
    vertices = mesh.vertices * [1.0, ADULT_STATURE_M / height, 1.0]
    return Body("procedural", vertices, mesh.faces, weights, nodes, ADULT_STATURE_M)


def sources_hash() -> str:
    """SHA-256 of the sources in this folder."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _fine_half(field: BodyField) -> Mesh:
    """Surface nets of the half x >= 0; the first kept layer of cells straddles the mid-plane."""
    mesh = surface_nets(sample_grid(field, _LOW, _COUNTS, _GRID), _LOW, _GRID)
    vertices = mesh.vertices.copy()
    keep = vertices[:, 0] > -0.5 * _GRID
    vertices[np.abs(vertices[:, 0]) <= 0.5 * _GRID, 0] = 0.0
    faces = mesh.faces[keep[mesh.faces].all(axis=1)]
    used, packed = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], packed.reshape(faces.shape).astype(np.int32))


def _edge_length(points: Array) -> Array:
    """Wished edge length: fine at hands, feet and head."""
    nodes = reference_nodes()
    size = np.full(len(points), _EDGE_M)
    for name, radius, fine in _FINE:
        away = np.linalg.norm(points - nodes[NODE_INDEX[name]], axis=1)
        size = np.minimum(size, fine + _COARSER * np.maximum(away - radius, 0.0))
    return size


def main(output: Annotated[Path, typer.Option("--output", "-o", help="The body file.")] = TEMPLATE) -> None:
    """Make the embedded body's file."""
    body = make_template()
    save_body(body, output, made_by=COMMAND, sources_sha256=sources_hash())
    print(f"{output}: {len(body.vertices)} vertices, content {body.content_hash()[:16]}")


if __name__ == "__main__":
    typer.run(main)
