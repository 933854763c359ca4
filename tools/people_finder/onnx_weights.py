"""Changes of a net (ONNX): weights in 16 bits and back, images and windows of any size, moved integers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

_FEW = 256
"""Tensors of fewer values stay in 32 bits."""

_MOVES = ("Resize", "Slice", "Gather")
"""Operations that copy values (the nets resize to the nearest pixel)."""


def halve(path: Path) -> None:
    """Store a net's weights in 16 bits; the run time converts them once, on loading."""
    model = onnx.load(path)
    widened = []
    for tensor in list(model.graph.initializer):
        values = numpy_helper.to_array(tensor)
        if values.dtype != np.float32 or values.size < _FEW:
            continue
        half = numpy_helper.from_array(values.astype(np.float16), f"{tensor.name}_half")
        model.graph.initializer.remove(tensor)
        model.graph.initializer.append(half)
        widened.append(helper.make_node("Cast", [half.name], [tensor.name], to=TensorProto.FLOAT))
    nodes = widened + list(model.graph.node)
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    onnx.save(model, path)


def widen(model: onnx.ModelProto) -> None:
    """Convert weights stored in 16 bits to 32."""
    halves = {t.name: t for t in model.graph.initializer if t.data_type == TensorProto.FLOAT16}
    for node in [n for n in model.graph.node if n.op_type == "Cast" and n.input[0] in halves]:
        half = halves[node.input[0]]
        wide = numpy_helper.from_array(numpy_helper.to_array(half).astype(np.float32), node.output[0])
        model.graph.initializer.append(wide)
        model.graph.initializer.remove(half)
        model.graph.node.remove(node)


def float_weights(model: onnx.ModelProto) -> dict[str, np.ndarray]:
    """Return all weights as floats, also those stored as integers, by the names that layers read."""
    widen(model)
    values = {t.name: numpy_helper.to_array(t) for t in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type == "DequantizeLinear" and node.input[0] in values:
            whole, scale, zero = (values[name] for name in node.input)
            by_channel = (-1,) + (1,) * (whole.ndim - 1) if scale.ndim else ()
            off = whole.astype(np.float32) - zero.reshape(by_channel)
            values[node.output[0]] = (off * scale.reshape(by_channel)).astype(np.float32)
    return values


def free_sides(path: Path) -> None:
    """Let a net take images of any height and width: a cut before a joint follows what it is joined to."""
    model = onnx.load(path)
    graph = model.graph
    values = {t.name: numpy_helper.to_array(t) for t in graph.initializer}
    made_by = {name: node for node in graph.node for name in node.output}
    for joint in [n for n in graph.node if n.op_type == "Concat"]:
        cut = made_by[joint.input[1]]
        while cut.op_type == "Slice":
            axis = values[cut.input[3]]
            names = [f"{cut.name}_{part}" for part in ("axis", "shape", "end")]
            graph.initializer.append(numpy_helper.from_array(axis, names[0]))
            size = [
                helper.make_node("Shape", [joint.input[0]], [names[1]]),
                helper.make_node("Gather", names[1::-1], [names[2]]),
            ]
            for node in size:
                graph.node.insert(list(graph.node).index(cut), node)
            cut.input[2] = names[2]
            cut = made_by[cut.input[0]]
    for value in (*graph.input, *graph.output):
        for dimension, name in zip(value.type.tensor_type.shape.dim[2:], ("rows", "columns"), strict=True):
            dimension.dim_param = f"{value.name}_{name}"
    del graph.value_info[:]  # sizes between the layers
    _remove_unused(graph)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def free_window(path: Path) -> None:
    """Let the fine part of a joint net take any window of its crop.

    What it holds for the whole crop becomes inputs (`depth_pose.detect.crop_window.cells_of`): the places of
    cells, and the coarse cell that each fine one joins. Sizes of reshapes follow the input.
    """
    model = onnx.shape_inference.infer_shapes(onnx.load(path))
    graph = model.graph
    sizes = {v.name: [d.dim_value for d in v.type.tensor_type.shape.dim] for v in graph.value_info}
    values = {t.name: t for t in graph.initializer}
    held = {n.output[0]: n.input[0] for n in graph.node if n.op_type == "Cast" and n.input[0] in values}
    new: dict[str, tuple[int, list[int | str]]] = {}
    cells = 0
    for node in [n for n in graph.node if not n.name.startswith("/coarse/")]:
        tensor = values.get(held.get(node.input[-1], node.input[-1]))
        sides = tuple(tensor.dims) if tensor is not None else ()
        if node.op_type == "Add" and sides[:3] == (1, 1, 3):
            node.input[1], cells = "cells", sides[3]
            new["cells"] = TensorProto.FLOAT, [1, 1, 3, "cells"]
        elif node.op_type == "Gather" and len(sides) == 1:
            (axis,) = (a.i for a in node.attribute if a.name == "axis")
            node.input[1] = {2: "coarse_rows", 3: "coarse_columns"}[axis]
            new[node.input[1]] = TensorProto.INT64, [node.input[1]]
    for node in [n for n in graph.node if n.op_type == "Reshape" and n.input[1] in values]:
        if not node.name.startswith("/coarse/") and (sides := sizes[node.output[0]])[-1] == cells:
            follows = numpy_helper.from_array(np.array([*sides[:-1], -1]), node.input[1])
            values[node.input[1]].CopyFrom(follows)
    for value in (*graph.input, *graph.output):
        if value.name in ("features", "mask"):
            dims = list(value.type.tensor_type.shape.dim)[-2:]
            for dimension, name in zip(dims, ("rows", "columns"), strict=True):
                dimension.dim_param = f"{value.name}_{name}"
    graph.input.extend(helper.make_tensor_value_info(name, *kind) for name, kind in new.items())
    _remove_unused(graph)
    del graph.value_info[:]  # sizes between the layers
    onnx.checker.check_model(model)
    onnx.save(model, path)


def move_integers(path: Path) -> None:
    """Let a net copy and join integers in place of the floats that they stand for, with the same answers."""
    model = onnx.load(path)
    graph = model.graph
    made_by = {name: node for node in graph.node for name in node.output}
    for node in [n for n in graph.node if n.op_type in _MOVES]:
        source: onnx.NodeProto | None = node
        while source is not None and source.op_type in _MOVES:
            source = made_by.get(source.input[0])
        if source is None or source.op_type != "DequantizeLinear" or source.input[0] not in made_by:
            continue
        floats = node.output[0]
        readers = [(n, k) for n in graph.node for k, name in enumerate(n.input) if name == floats]
        name, at = floats, list(graph.node).index(node)
        for kind in ("QuantizeLinear", "DequantizeLinear"):
            given, name, at = name, f"{floats}_{kind}", at + 1
            graph.node.insert(at, helper.make_node(kind, [given, *source.input[1:]], [name], name=name))
            made_by[name] = graph.node[at]
        for reader, k in readers:
            reader.input[k] = name
    onnx.checker.check_model(model)
    onnx.save(model, path)


def double_by_copies(path: Path) -> None:
    """Let a net double images by copying rows, with the same answers; a resize looks up every value.

    Channels are moved last, as integer convolutions have them, so the run time moves nothing.
    """
    model = onnx.load(path)
    graph = model.graph
    for axes, factors in (("wide", [1, 1, 2, 1]), ("tall", [1, 2, 2, 1])):
        graph.initializer.append(numpy_helper.from_array(np.array(factors, np.int64), axes))
    for node in [n for n in graph.node if n.op_type == "Resize"]:
        name, at = node.name, list(graph.node).index(node)
        graph.node.remove(node)

        last, sides, rows, doubled = (f"{name}_{part}" for part in ("last", "sides", "rows", "doubled"))
        steps = [
            _node("Transpose", last, node.input[0], perm=[0, 2, 3, 1]),
            _node("Shape", sides, last),
            _node("Mul", f"{sides}_wide", sides, "wide"),
            _node("Mul", f"{sides}_tall", sides, "tall"),
            _node("Concat", f"{rows}_pairs", last, last, axis=3),
            _node("Reshape", rows, f"{rows}_pairs", f"{sides}_wide"),
            _node("Concat", f"{rows}_twice", rows, rows, axis=2),
            _node("Reshape", doubled, f"{rows}_twice", f"{sides}_tall"),
            _node("Transpose", node.output[0], doubled, perm=[0, 3, 1, 2]),
        ]
        for step in reversed(steps):
            graph.node.insert(at, step)
    _remove_unused(graph)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def _remove_unused(graph: onnx.GraphProto) -> None:
    """Remove conversions and weights that no node reads."""
    used = {name for node in graph.node for name in node.input} | {o.name for o in graph.output}
    for node in [n for n in graph.node if n.op_type == "Cast" and n.output[0] not in used]:
        graph.node.remove(node)
    used = {name for node in graph.node for name in node.input}
    for tensor in [t for t in graph.initializer if t.name not in used]:
        graph.initializer.remove(tensor)


def _node(kind: str, output: str, *inputs: str, **options: object) -> onnx.NodeProto:
    """Return a node with one output, named as that."""
    return helper.make_node(kind, inputs, [output], name=output, **options)
