"""Fixtures of stages."""

from ..service.conftest import executor, kung_fu, make_player, make_stage

__all__ = ["executor", "kung_fu", "make_player", "make_stage"]
