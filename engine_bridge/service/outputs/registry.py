"""The registry of wires: the tables of the service file that open outputs."""

from collections.abc import Iterator

from engine_bridge.service.outputs.osc import OscTable
from engine_bridge.service.outputs.output import OutputTable
from engine_bridge.service.outputs.websocket import WebSocketTable
from engine_bridge.service.outputs.zeromq import NetworkTable
from puppetline.toml_schema import Table


class OutputTables(Table):
    """One row per wire: a key of the service file and its table, or a tuple of tables.

    To add a wire, add a module with an `Output` and its `OutputTable`, and a row.
    """

    network: NetworkTable = NetworkTable()
    osc: tuple[OscTable, ...] = ()
    websocket: WebSocketTable | None = None

    def output_tables(self) -> Iterator[tuple[tuple[str | int, ...], OutputTable]]:
        """Yield the keys and indices of each table in the file, and the table, in the order of the rows."""
        for key in OutputTables.model_fields:
            value = getattr(self, key)
            if isinstance(value, tuple):
                yield from (((key, index), table) for index, table in enumerate(value))
            elif value is not None:
                yield (key,), value
