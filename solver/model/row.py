"""Rows of 16 float32 in vector registers, for compiled functions.

Numba's vectoriser gives up where a sum runs over rows of a table at places that are known only then. So a row is a type
of its own here, which the compiler turns into whatever registers the processor has.
"""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.extending import intrinsic, models, register_model

WIDTH = 16
"""Numbers in a row: the 3 × 4 transform and four zeros, which make it fill registers of every width."""

_FLOAT, _INDEX = ir.FloatType(), ir.IntType(32)
_VECTOR = ir.VectorType(_FLOAT, WIDTH)


class _RowType(types.Type):
    """A row in registers, as compiled functions see it."""

    def __init__(self) -> None:
        super().__init__(name="Row")


_row = _RowType()


@register_model(_RowType)
class _RowModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _spread(builder: Any, number: Any) -> Any:
    """Put one number into all places of a vector."""
    nothing = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_INDEX, WIDTH), [0] * WIDTH))


@intrinsic
def zeros(_context):
    """Return a row of zeros."""
    return _row(), lambda _context, _builder, _signature, _arguments: ir.Constant(_VECTOR, [0.0] * WIDTH)


@intrinsic
def load(_context, table, _index):
    """Return a row of a (rows, 16) float32 table."""
    if not (isinstance(table, types.Array) and (table.dtype, table.ndim, table.layout) == (types.float32, 2, "C")):
        raise TypingError(f"a table of rows is a contiguous 2-d float32 array, not {table}")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=arguments[0])
        place = builder.mul(arguments[1], ir.Constant(arguments[1].type, WIDTH))
        first = builder.gep(array.data, [place])
        return builder.load(builder.bitcast(first, ir.PointerType(_VECTOR)), align=4)

    return _row(table, types.intp), generate


@intrinsic
def item(_context, row, _index):
    """Return one number of a row."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.extract_element(arguments[0], builder.trunc(arguments[1], _INDEX))

    return types.float32(row, types.intp), generate


@intrinsic
def plus_scaled(_context, total, _factor, row):
    """Return total + factor · row."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        product = builder.fmul(_spread(builder, arguments[1]), arguments[2], flags=["fast"])
        return builder.fadd(arguments[0], product, flags=["fast"])

    return _row(total, types.float32, row), generate
