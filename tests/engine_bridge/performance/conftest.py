"""A stage for the tests that play on one."""

from ..service.conftest import executor, kung_fu, make_player, make_stage

__all__ = ["executor", "kung_fu", "make_player", "make_stage"]
