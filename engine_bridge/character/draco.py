"""Decoding of triangles that are compressed by KHR_draco_mesh_compression: arrays only, no documents."""

from collections.abc import Mapping
from typing import Any

import DracoPy
import numpy as np
from numpy.typing import NDArray


def decode(content: bytes, attributes: Mapping[str, int]) -> tuple[NDArray[np.uint32], dict[str, NDArray[Any]]]:
    """Return the corners of compressed triangles, and the attributes of their vertices.

    Parameters
    ----------
    content : bytes
        Compressed bytes.
    attributes : mapping of str to int
        From names in the specification, such as NORMAL, to identifiers in the compressed bytes.

    Returns
    -------
    corners : (3 t,) uint32
    values : dict of str to (n, width)
        Quantised values as floats, others with a type that holds them. Skin weights, whose quantised values need not
        sum to 1, do so again; joints without weight are 0, if they are compressed too.

    Raises
    ------
    ValueError
        The bytes are damaged, have no triangles, or lack an attribute.
    """
    try:
        mesh = DracoPy.decode(content)
        corners, found = mesh.faces.ravel(), {n: mesh.get_attribute_by_unique_id(n) for n in attributes.values()}
    except (DracoPy.FileTypeException, AttributeError, TypeError) as error:
        raise ValueError(str(error)) from error
    if missing := [name for name, number in attributes.items() if found[number] is None]:
        raise ValueError(f"no {' and no '.join(missing)}")
    values = {name: found[number]["data"] for name, number in attributes.items()}
    weights = [name for name in values if name.startswith("WEIGHTS_") and values[name].dtype.kind == "f"]
    total = sum(values[name].sum(axis=1, keepdims=True) for name in weights)
    for name in weights:
        joints = name.replace("WEIGHTS", "JOINTS")
        values[name] = values[name] / np.where(total > 0, total, 1)
        if joints in values:
            values[joints] = np.where(values[name] > 0, values[joints], 0)
    return corners, values
