"""The sensors whose pictures trackers read in tests."""

from ..sensors.conftest import (
    _virtual_sensors,
    openni_folder,
    record,
    render,
    scripted_device,
    scripted_tracker,
    standing,
    unhurried,
    virtual_sensors,
    watch,
)

__all__ = [
    "_virtual_sensors",
    "openni_folder",
    "record",
    "render",
    "scripted_device",
    "scripted_tracker",
    "standing",
    "unhurried",
    "virtual_sensors",
    "watch",
]
