"""Vectors of 16 float32 in registers, for compiled functions.

Numba does not vectorise sums over rows of a table whose indices are only known at run time. The type here makes the
compiler keep such a row in the vector registers of the processor.
"""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.extending import intrinsic, models, register_model

LENGTH = 16
"""Number of elements: a 3 × 4 transform and four zeros, which fill registers of every usual width."""

_FLOAT, _INDEX = ir.FloatType(), ir.IntType(32)
_VECTOR = ir.VectorType(_FLOAT, LENGTH)


class _VectorType(types.Type):
    """Numba's type of a vector."""

    def __init__(self) -> None:
        super().__init__(name="Vector16")


_vector = _VectorType()


@register_model(_VectorType)
class _VectorModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _spread(builder: Any, number: Any) -> Any:
    """Return a vector whose elements are all one number."""
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_INDEX, LENGTH), [0] * LENGTH))


@intrinsic
def zeros(_context):
    """Return a vector of zeros."""
    return _vector(), lambda _context, _builder, _signature, _arguments: ir.Constant(_VECTOR, [0.0] * LENGTH)


@intrinsic
def load(_context, table, _index):
    """Return a row of a (rows, 16) float32 table as a vector."""
    if not (isinstance(table, types.Array) and (table.dtype, table.ndim, table.layout) == (types.float32, 2, "C")):
        raise TypingError(f"found {table}; expected a contiguous 2-d float32 array")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=arguments[0])
        place = builder.mul(arguments[1], ir.Constant(arguments[1].type, LENGTH))
        first = builder.gep(array.data, [place])
        return builder.load(builder.bitcast(first, ir.PointerType(_VECTOR)), align=4)

    return _vector(table, types.intp), generate


@intrinsic
def item(_context, vector, _index):
    """Return one element of a vector."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.extract_element(arguments[0], builder.trunc(arguments[1], _INDEX))

    return types.float32(vector, types.intp), generate


@intrinsic
def add_scaled(_context, total, _factor, vector):
    """Return total + factor · vector."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        product = builder.fmul(_spread(builder, arguments[1]), arguments[2], flags=["fast"])
        return builder.fadd(arguments[0], product, flags=["fast"])

    return _vector(total, types.float32, vector), generate
